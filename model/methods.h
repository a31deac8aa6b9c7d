// Methods by name.
#pragma once

#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "model/interpolator.h"
#include "model/network_interpolator.h"

namespace lightstage::model {

// The values in which images are summed: linear light (as physics does) or display-encoded ones (closer to what eyes and the
// published metrics judge, since an error in the dark counts for more).
enum class Domain { kLinear, kDisplay };

struct MethodInfo {
  std::string name;
  std::string summary;   // one line: what it does and what it is for
  std::string citation;  // "Sun et al. 2020, Light Stage Super-Resolution"
};

// nearest, linear, barycentric, rbf, blend, superres; in this order.
const std::vector<MethodInfo>& methods();

struct MethodOptions {
  Domain domain = Domain::kDisplay;  // of linear, barycentric and rbf; nearest is the same in both, networks work display-encoded
  int neighbours = 8;                // k of linear; networks take theirs from the checkpoint
  std::optional<double> sharpness;   // s of linear; default_sharpness of the scan's spacing otherwise
  NetworkOptions network;            // of superres
  std::filesystem::path model_file;  // checkpoint for blend and superres
};

// Throws UsageError for a name that does not exist (with the nearest one) or a network without model file or with
// another network's, BadInput for
// a checkpoint that cannot be used.
std::unique_ptr<LightInterpolator> make_interpolator(std::string_view method, const core::OlatScan& scan,
                                                     const MethodOptions& options = {});

}  // namespace lightstage::model
