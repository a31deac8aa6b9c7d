// Alignment on a simulated head that moves through a pass, against the simulator's truth.
#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <memory>
#include <vector>

#include "align/flow.h"
#include "align/motion_track.h"
#include "core/direction.h"
#include "core/image.h"
#include "core/olat_scan.h"
#include "sim/world.h"

namespace lightstage::cli {

enum class MotionKind {
  kSway,   // to and fro, up and down, while turning a little
  kTurn,   // on the spot: what is near moves more than what is far, and is hidden by it
  kShift,  // without turning
};

struct MovingPassOptions {
  std::size_t lights = 162;
  int pixels = 256;      // of the square picture
  double motion_px = 6;  // from the key frame to the tracking frame that is farthest from it; median over the subject
  MotionKind kind = MotionKind::kSway;
  std::uint64_t seed = 1;  // of head, motion and noise
};

// A pass in memory: a frame every 25 ms with the noise of the simulated sensor. Time is counted in frames.
class MovingPass {
 public:
  explicit MovingPass(const MovingPassOptions& options);

  int frame_count() const { return int(options_.lights); }
  int key() const { return frame_count() / 2; }
  static core::Nanoseconds time_of(int frame);
  const core::Image& coverage() const { return coverage_; }  // the truth, by which errors are judged
  const core::Image& subject() const { return subject_; }    // as alignment finds it
  double motion_px() const { return motion_px_; }            // reached

  // Rendered once each.
  const core::Image& tracking_frame(int frame) const;  // under all lights
  const align::FlowField& true_flow(int frame) const;  // from the key pose; NaN off the subject

  core::Image light_frame(int frame) const;                    // under the light of that index
  core::OlatScan scan(std::vector<core::Image> images) const;  // of the pass's lights
  // Without noise, in the key pose.
  std::vector<core::Image> truth(const std::vector<core::Direction>& directions) const;
  // Halfway between lights and their nearest neighbours, where blending has most to do.
  std::vector<core::Direction> between_lights(std::size_t count) const;

 private:
  MovingPassOptions options_;
  std::unique_ptr<sim::World> world_;
  core::Image coverage_, subject_;
  double motion_px_ = 0;
  mutable std::map<int, core::Image> tracking_frames_, true_flows_;
};

struct AlignKnobs {
  align::FlowPreset flow = align::FlowPreset::kFine;
  int shrink = 1;
  int every = 11;  // a tracking frame every so many frames, and at both ends
  align::Between between = align::Between::kCatmullRom;
};

struct AlignRow {
  AlignKnobs knobs;
  double seconds = 0;                        // flow there and back for the whole pass, all threads
  double median_epe_px = 0, p95_epe_px = 0;  // of frames between tracking frames, over the subject
  double believed = 0;                       // share of the subject where flow there and back agree
  double masked = 0;                         // share of the subject that some frame hides
};

// Tracks the pass by these knobs. `motion` takes what was found, when it is wanted.
AlignRow track_pass(const MovingPass& pass, const AlignKnobs& knobs, align::MotionTrack* motion = nullptr);

// Linear blending of the pass's frames as taken and after alignment, display values against the truth in the key pose; and of the same
// frames had the subject stood still.
struct BlendingGain {
  double unaligned_db = 0, aligned_db = 0, still_db = 0;
  // Of the subject, what a frame hides (mean over frames).
  double hidden = 0;
  // Root mean square error of aligned frames' display values where they hide the subject, and where they show it.
  double error_hidden = 0, error_shown = 0;
};
BlendingGain blending_gain(const MovingPass& pass, const align::MotionTrack& motion, std::size_t directions);

// Registration of photographed faces under different lights, each of which moved a little between frames. Lists of pictures that their
// importer leaves out are left out here too; damage is not looked for.
struct FacesRow {
  std::string name;
  std::size_t pictures = 0, objected = 0;
  double median_motion_px = 0;  // undone
  double residual_before_px = 0,
         residual_after_px = 0;  // median over pictures of the flow from what their neighbours predict
  double sharpness_gain = 1;     // mean squared gradient of the mean picture, after over before
  double injected_median_px = 0, injected_p95_px = 0;  // error with which known further shifts of up to 2 px are found
  core::Image mean_before, mean_after;
};
FacesRow register_faces(const std::filesystem::path& yale_folder);

// The same of a simulated head that stands still under single lights from in front, in pictures of 1024 x 1024 pixels that are each moved by up
// to 3 pixels both ways and turned by up to 0.17 degrees. Without mean pictures. `seconds` takes how long registration took, on all threads.
FacesRow register_simulated(std::uint64_t seed, double& seconds);

// Which tracking frames are called changed, over passes of several heads: sound ones, and ones in which both eyes are closed in one frame, by an
// ellipse of the colour around it where heads have their eyes.
struct BlinkRow {
  std::size_t sound_frames = 0, false_alarms = 0;
  std::size_t blinks = 0, found = 0;
  std::size_t accused = 0;  // sound frames of the passes with a blink that were objected to
};
BlinkRow blinks(const MovingPassOptions& options, const AlignKnobs& knobs, std::size_t heads);

// What alignment does to a subject that stands still: length of the flow over the subject, in pixels.
struct StillRow {
  double median_px = 0, p95_px = 0;
  double raw_p95_px = 0;  // before it is recognised as standing still
};
StillRow still_subject(const MovingPassOptions& options, const AlignKnobs& knobs);

}  // namespace lightstage::cli
