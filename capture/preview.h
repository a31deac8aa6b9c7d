// The operator's picture of a running pass.
#pragma once

#include <filesystem>
#include <memory>
#include <string>

#include "capture/devices.h"

namespace lightstage::capture {

struct PreviewOptions {
  int every = 1;                // every n-th frame of each camera is shown, the first one included
  std::filesystem::path still;  // image file, of the camera whose frame comes first; empty: none
  std::string tev_address =
      "127.0.0.1:14158";  // "HOST:PORT" of a tev viewer (where it listens by default); empty: none
};

// Shows frames while they are captured: as a still that is replaced in one go, so that whoever reads it finds a whole
// picture, and in the image viewer tev, one image a camera ("lightstage CAMERA"). Shown is linear radiance over the
// sensor's clipping level, so that 1 (in the still, sRGB-encoded: white) is where it clips, at any exposure; pixels are means
// of whole boxes so that no side is longer than 1024.
//
// A pass is not slowed: show() makes the small copy, a thread of its own writes and sends. While that is busy each camera's
// newest frame waits and older ones are dropped. Where no viewer listens, or one goes away or stops reading, a note says so and
// it is tried again every 5 seconds. A still that cannot be written any more (disk full) is one warning.
class Preview {
 public:
  // Writes a black still, so that what is wrong with the path is known before the pass. Throws UsageError for `every` below
  // 1, BadInput for a still that cannot be written and for an address that makes no sense or has an unknown name. That
  // nobody listens is no error.
  explicit Preview(const PreviewOptions& options);
  // Shows what still waits; takes a few seconds at worst (a viewer that does not read).
  ~Preview();
  Preview(const Preview&) = delete;
  Preview& operator=(const Preview&) = delete;

  // For SessionOptions::on_frame: any thread, one call at a time.
  void show(const std::string& camera, const CameraFrame& frame);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace lightstage::capture
