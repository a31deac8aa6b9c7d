// A learned measure of errors that the user brings: a network as a TorchScript file.
#pragma once

#include <filesystem>
#include <memory>
#include <string>

#include "core/image.h"

namespace lightstage::model {

// The file's method forward(a, b) takes two float32 tensors [1, 3, height, width], display-encoded values in [0, 1], and returns a tensor of one
// number. A TorchScript file is a program: loading one runs it.
class LearnedMetric {
 public:
  // Throws BadInput naming the file when it is missing or no TorchScript module.
  explicit LearnedMetric(const std::filesystem::path& file);
  ~LearnedMetric();
  LearnedMetric(LearnedMetric&&) noexcept;

  // The file's name without its extension: what its values are reported as.
  const std::string& name() const;

  // What the module says of two display-encoded pictures of one size, one channel or three; outside the mask (inside where > 0.5; empty:
  // everywhere) both are black. Throws BadInput for sizes that do not fit, and naming the file when the module fails on them or returns
  // anything else than one finite number.
  double operator()(core::ImageView a, core::ImageView b, core::ImageView mask) const;

 private:
  struct Module;
  std::filesystem::path file_;
  std::string name_;
  std::unique_ptr<Module> module_;
};

}  // namespace lightstage::model
