// Eight or so cameras that never tire, for the load test of the store.
#pragma once

#include <memory>

#include "capture/session.h"
#include "core/clock.h"
#include "core/image.h"

namespace lightstage::cli {

struct StoreStageOptions {
  int cameras = 8;
  int width = 1920, height = 1080;
  double frames_per_s = 60;  // that a camera can take
  std::size_t lights = 125;  // at most as many as the pictures have rows
};

// Cameras, lights and trigger behind the device interfaces, on the real clock. Rendering must not be what is measured, so each camera's view of a head with shot
// and read noise, quantised to 16 bits (sim/sensor.h), is rendered once; the picture of a light is that one, its rows moved round by a number that belongs to light
// and round. So all pictures of a round differ, are as hard to compress as photographs, and show which light was on, exactly; a camera's driver would
// copy as many bytes.
class StoreStage {
 public:
  StoreStage(const StoreStageOptions& options, core::Clock& clock);
  ~StoreStage();

  capture::Rig rig();
  std::vector<std::string> camera_names() const;
  // Frames that follow are those of another pass.
  void begin_round(int round);
  // What a frame of this round must show.
  core::Image picture(std::size_t camera, int light) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace lightstage::cli
