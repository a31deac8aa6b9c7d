// What a captured scan's `provenance` holds: enough to resume it, to know its cameras, and for simulated ones to render truth.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "capture/sequence.h"
#include "capture/stage.h"
#include "db/store.h"
#include "sim/simulation.h"

namespace lightstage::cli {

struct CaptureProvenance {
  capture::Stage stage;  // with the cameras as used (their real picture size)
  capture::Sequence sequence;
  // Of the sequence: the steps of the pass itself. Those from here on take lights again (cli/jobs/retake.h).
  std::size_t pass_steps = 0;
  std::optional<sim::Simulation> simulation;  // its stage is `stage`
  // Which limits of the stage's lights (capture/light_limits.h) the sequence exceeds, in words: somebody took it all the same, by --i-know.
  std::vector<std::string> exceeded_limits;
};

std::string to_json(const CaptureProvenance& provenance);

// Throws UsageError when the scan was not captured (imported, virtual).
CaptureProvenance capture_provenance(const db::Scan& scan);
bool is_captured(const db::Scan& scan);

// The key step (capture::key_step) of the scan's pass, which what was retaken later does not change.
int key_step(const db::Scan& scan);

// The camera of that name; the first one for an empty name. UsageError when the stage has none of that name.
const capture::StageCamera& camera_of(const capture::Stage& stage, const std::string& name);

}  // namespace lightstage::cli
