// What a scenario showed, as the line that people read and the summary that programs read.
#pragma once

#include <cstddef>
#include <nlohmann/json.hpp>
#include <string>

#include "core/clock.h"

namespace lightstage::hil {

class ReportLine {
 public:
  explicit ReportLine(std::string scenario);
  // Prints the line and adds it to summary.jsonl in output_folder(). Failed, unless pass() was called.
  ~ReportLine();
  ReportLine(const ReportLine&) = delete;
  ReportLine& operator=(const ReportLine&) = delete;

  void add_fault(std::size_t count = 1) { faults_ += count; }
  void add_frame(std::size_t count = 1) { frames_ += count; }
  void add_retaken(std::size_t count) { retaken_ += count; }
  void set_wrong(std::size_t count) { wrong_ = count; }
  void set_lights_left_on(std::size_t count) { lights_left_on_ = count; }
  // Anything else worth knowing.
  void add_figure(const std::string& name, double value) { figures_[name] = value; }
  void pass() { passed_ = true; }

 private:
  std::string scenario_;
  core::SystemClock clock_;
  core::Nanoseconds start_;
  std::size_t faults_ = 0, frames_ = 0, retaken_ = 0, wrong_ = 0, lights_left_on_ = 0;
  bool passed_ = false;
  nlohmann::json figures_ = nlohmann::json::object();
};

}  // namespace lightstage::hil
