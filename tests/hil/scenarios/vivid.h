// The kernel's virtual camera driver (vivid): another driver than uvcvideo, with formats and faults that no UVC camera has.
#pragma once

#include <string>

#include "capture/stage.h"

namespace lightstage::hil {

// Number `index` of the four that the virtual machine has. Throws std::runtime_error when it is not there.
class Vivid {
 public:
  explicit Vivid(int index);

  const std::string& node() const { return node_; }
  // By the name that the driver gives the control: "Wrap Sequence Number".
  void set(const std::string& control, int value);
  // One of a menu's items.
  void choose(const std::string& control, const std::string& item);

  // How a stage file would describe it.
  capture::StageCamera camera(int width, int height) const;
  capture::CameraDevice device(const std::string& pixel_format) const;

 private:
  int index_;
  std::string node_;
};

}  // namespace lightstage::hil
