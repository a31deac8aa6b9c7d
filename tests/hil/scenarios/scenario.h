// One scenario: a stage whose devices are emulated, faults, passes over it, and the proof that nothing wrong was stored.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "capture/sequence.h"
#include "capture/session.h"
#include "capture/stage.h"
#include "core/clock.h"
#include "db/store.h"
#include "hil/scenarios/emulated_rig.h"
#include "hil/scenarios/report_line.h"
#include "support/support.h"

namespace lightstage::hil {

struct RigStage {
  std::size_t lights = 100;
  std::vector<std::string> pixel_formats = {"Y16", "GREY"};  // of each camera
  int width = 160;                                           // of pictures: 320, 160 or 80 pixels, and 3/4 as high
  bool common_trigger = false;                               // one line for all cameras; else one each
  bool strobe = false;                                       // camera 0's is heard on a GPIO line
  bool free_running = false;
  bool dmx = false;  // the lights hang on the DMX widget; else on the LED controller
};

// As a lab would describe the emulated rig. Level 1 gives radiance 1.
capture::Stage make_rig_stage(const RigStage& options = {});

// The switch on the cameras' backs, for as long as this lives.
class FreeRunningCameras {
 public:
  explicit FreeRunningCameras(bool free_running);
  ~FreeRunningCameras();
  FreeRunningCameras(const FreeRunningCameras&) = delete;
  FreeRunningCameras& operator=(const FreeRunningCameras&) = delete;
};

struct PassOptions {
  int tracking_every = 10;
  core::Nanoseconds exposure = 5 * core::kMillisecond;
  capture::Timing timing = capture::Timing::kLockstep;
};
capture::Sequence make_rig_sequence(const capture::Stage& stage, const PassOptions& options = {});

// What a store that should hold a whole pass lacks.
struct StoreCheck {
  std::size_t frames = 0;   // that are there
  std::size_t missing = 0;  // steps without a camera's frame
  std::size_t wrong = 0;    // frames that show anything but their step's light, all of it, and nothing else
  std::string first_wrong;  // which and why
};
StoreCheck check_store(const db::Store& store, const db::Scan& scan, const capture::Stage& stage);

class Scenario {
 public:
  // The rig starts counting anew.
  explicit Scenario(const std::string& name);

  // A line of the rig's fault script.
  void fault(const std::string& line);

  // The scan "pass" in the scenario's store.
  void add_scan(const capture::Stage& stage, const capture::Sequence& sequence);

  // Takes with the rig's devices what the scan lacks (it is added where it is not there). Throws what run_session and
  // HardwareRig throw.
  capture::SessionReport capture(const capture::Stage& stage, const capture::Sequence& sequence,
                                 const capture::SessionOptions& options = {});

  // The same pass with nothing stored: how fast the devices go.
  capture::SessionReport dry_run(const capture::Stage& stage, const capture::Sequence& sequence);

  // Mean time from a trigger to its frame in the last dry_run(); of passes that lost nothing.
  double trigger_to_frame_ms() const { return trigger_to_frame_ms_; }

  // Every frame is there and shows its step's light alone; every fault happened; no light is on.
  void require_all_right(const capture::Stage& stage);

  ReportLine& report() { return report_; }
  db::Store& store() { return store_; }
  std::filesystem::path store_folder() const { return folder_ / "store"; }

 private:
  ReportLine report_;
  test::TemporaryFolder folder_;
  db::Store store_;
  core::SystemClock clock_;
  double trigger_to_frame_ms_ = 0;
};

}  // namespace lightstage::hil
