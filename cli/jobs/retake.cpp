#include "cli/jobs/retake.h"

#include <algorithm>
#include <map>
#include <set>

#include "core/error.h"

namespace lightstage::cli {

namespace {

// A light at an exposure.
using Shot = std::pair<int, std::int64_t>;

Shot shot_of(const db::Step& step) {
  return {*step.light_index, step.exposure_ns};
}

// Those with a frame that the camera's newest alignment uses.
std::set<Shot> usable_shots(const db::Store& store, const db::Scan& scan, const std::string& camera) {
  const std::string what = "scan '" + scan.name + "', camera '" + camera + "': ";
  const std::string align = "run `lightstage align " + scan.name + "` first, which finds what is to be taken again";
  std::set<int> taken;
  for (const db::Frame& frame : store.frames(scan.id, camera)) taken.insert(frame.step_index);
  const auto alignment = store.newest_product("alignment", scan, camera);
  if (!alignment) throw core::UsageError(what + "it is not aligned; " + align);
  std::map<int, bool> used;
  for (const db::ProductImage& image : alignment->images) {
    if (image.role == "aligned" || image.role == "excluded") used[image.index] = image.role == "aligned";
  }
  std::set<Shot> usable;
  for (const db::Step& step : scan.steps) {
    if (!taken.contains(step.step_index)) {
      throw core::UsageError(what + "the frame of step " + std::to_string(step.step_index) +
                             " is missing; go on with `lightstage capture --resume --name " + scan.name + "` first");
    }
    if (step.kind != db::StepKind::kLight) continue;
    const auto found = used.find(step.step_index);
    if (found == used.end()) throw core::UsageError(what + "its alignment is older than its frames; " + align);
    if (found->second) usable.insert(shot_of(step));
  }
  return usable;
}

// Lights from one tracking frame to the next.
std::size_t longest_run(const std::vector<db::Step>& steps) {
  std::size_t longest = 0, run = 0;
  for (const db::Step& step : steps) {
    if (step.kind == db::StepKind::kTracking) run = 0;
    if (step.kind == db::StepKind::kLight) longest = std::max(longest, ++run);
  }
  return longest;
}

}  // namespace

std::vector<db::Step> retake_steps(const db::Store& store, const db::Scan& scan) {
  const auto tracking = std::find_if(scan.steps.begin(), scan.steps.end(),
                                     [](const db::Step& step) { return step.kind == db::StepKind::kTracking; });
  if (tracking == scan.steps.end()) {
    throw core::UsageError("scan '" + scan.name +
                           "' has no tracking frames, by which to know the pose of single lights that are taken again; "
                           "capture the pass again");
  }
  std::set<Shot> lacking;
  for (const std::string& camera : scan.cameras) {
    const std::set<Shot> usable = usable_shots(store, scan, camera);
    for (const db::Step& step : scan.steps) {
      if (step.kind == db::StepKind::kLight && !usable.contains(shot_of(step))) lacking.insert(shot_of(step));
    }
  }
  if (lacking.empty()) {
    throw core::UsageError("scan '" + scan.name + "': nothing is to be taken again; every light has an aligned frame");
  }
  std::vector<db::Step> steps;
  const auto append = [&](db::Step step) {
    step.step_index = int(scan.steps.size() + steps.size());
    steps.push_back(std::move(step));
  };
  const std::size_t period = longest_run(scan.steps);
  std::size_t lights = 0;
  for (const db::Step& step : scan.steps) {
    if (step.kind != db::StepKind::kLight || lacking.erase(shot_of(step)) == 0) continue;
    if (lights++ % period == 0) append(*tracking);
    append(step);
  }
  append(*tracking);
  return steps;
}

}  // namespace lightstage::cli
