#include "cli/jobs/align.h"

#include <algorithm>

#include <nlohmann/json.hpp>

#include "align/subject_mask.h"
#include "capture/sequence.h"
#include "cli/options.h"
#include "core/error.h"
#include "core/interrupt.h"
#include "core/parallel.h"
#include "core/progress.h"
#include "db/scan_loader.h"

namespace lightstage::cli {

namespace {

struct TrackingPoint {
  core::Nanoseconds time;
  double residual;  // display values, after warping
};

// Between two tracking frames, their residuals in proportion of time.
double residual_at(const std::vector<TrackingPoint>& points, core::Nanoseconds time) {
  const auto after = std::find_if(points.begin(), points.end(), [&](const TrackingPoint& p) { return p.time >= time; });
  if (after == points.begin()) return points.front().residual;
  if (after == points.end()) return points.back().residual;
  const TrackingPoint& a = *std::prev(after);
  const double part = double(time - a.time) / double(after->time - a.time);
  return a.residual + part * (after->residual - a.residual);
}

const char* to_string(align::FlowPreset preset) {
  switch (preset) {
    case align::FlowPreset::kFast:
      return "fast";
    case align::FlowPreset::kMedium:
      return "medium";
    case align::FlowPreset::kFine:
      return "fine";
  }
  return "";
}

double median(std::vector<double> values) {
  const auto middle = values.begin() + std::ptrdiff_t(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

// One camera: adds its images to the product and its figures to the report.
class CameraAlignment {
 public:
  CameraAlignment(db::Store& store, const db::Scan& scan, const std::string& camera, const AlignOptions& options)
      : store_(store), scan_(scan), camera_(camera), options_(options), dark_(db::dark_level(store, scan, camera)) {
    for (const db::Frame& frame : store.frames(scan.id, camera)) {
      const db::StepKind kind = scan.steps.at(std::size_t(frame.step_index)).kind;
      if (kind == db::StepKind::kTracking) tracking_frames_.push_back(frame);
      if (kind == db::StepKind::kLight) light_frames_.push_back(frame);
    }
  }

  void run(db::NewProduct& product, AlignReport& report) {
    track(product, report);
    warp_light_frames(product, report);
  }

 private:
  void track(db::NewProduct& product, AlignReport& report) {
    const int key_step = capture::key_step(scan_.steps);
    const auto key_frame = std::find_if(tracking_frames_.begin(), tracking_frames_.end(),
                                        [&](const db::Frame& f) { return f.step_index == key_step; });
    if (key_frame == tracking_frames_.end()) {
      throw core::StoreError("scan '" + scan_.name + "', camera '" + camera_ + "': its key tracking frame (step " +
                             std::to_string(key_step) + ") is missing; run `lightstage capture --resume --name " +
                             scan_.name + "`");
    }
    const core::Image key = db::load_frame(store_, *key_frame, dark_);
    const core::Image mask = align::subject_mask(key);
    core::Progress progress("optical flow, " + camera_, tracking_frames_.size());
    std::vector<double> motions;
    for (const db::Frame& frame : tracking_frames_) {
      core::throw_if_interrupted();
      const core::Image picture = db::load_frame(store_, frame, dark_);
      align::FlowField flow = frame.step_index == key_step ? align::FlowField(key.height(), key.width(), 2)
                                                           : align::compute_flow(key, picture, options_.preset);
      const double after = align::residual(key, align::warp(picture, flow), mask);
      const core::Nanoseconds time = pose_time(scan_, frame);
      points_.push_back({time, after});
      if (frame.step_index != key_step) {
        motions.push_back(align::median_motion_px(flow, mask));
        report.residual_before += align::residual(key, picture, mask);
        report.residual_after += after;
        ++report.tracking_frames;
      }
      product.images.push_back(
          {.role = "flow", .index = frame.step_index, .object = store_.put_object(flow), .value = after});
      motion_.add(time, std::move(flow));
      progress.advance();
    }
    if (!motions.empty()) {
      report.median_motion_px = std::max(report.median_motion_px, median(motions));
      report.largest_motion_px = std::max(report.largest_motion_px, *std::max_element(motions.begin(), motions.end()));
    }
  }

  void warp_light_frames(db::NewProduct& product, AlignReport& report) {
    core::Progress progress("warping, " + camera_, light_frames_.size());
    // Warping uses all threads within a batch; reading and storing go in order through the one store connection.
    const std::size_t batch = std::size_t(4 * core::thread_count());
    for (std::size_t begin = 0; begin < light_frames_.size(); begin += batch) {
      core::throw_if_interrupted();
      const std::size_t end = std::min(light_frames_.size(), begin + batch);
      std::vector<core::Image> pictures;
      for (std::size_t i = begin; i < end; ++i) pictures.push_back(db::load_frame(store_, light_frames_[i], dark_));
      core::parallel_for(pictures.size(), 1, [&](std::size_t first, std::size_t last) {
        for (std::size_t i = first; i < last; ++i) {
          pictures[i] = align::warp(pictures[i], motion_.at(pose_time(scan_, light_frames_[begin + i])));
        }
      });
      for (std::size_t i = begin; i < end; ++i) {
        const db::Frame& frame = light_frames_[i];
        product.images.push_back({.role = "aligned",
                                  .index = frame.step_index,
                                  .object = store_.put_object(pictures[i - begin]),
                                  .value = residual_at(points_, pose_time(scan_, frame))});
        ++report.aligned;
        progress.advance();
      }
    }
  }

  db::Store& store_;
  const db::Scan& scan_;
  const std::string& camera_;
  const AlignOptions& options_;
  core::Image dark_;
  std::vector<db::Frame> tracking_frames_, light_frames_;
  std::vector<TrackingPoint> points_;  // in order of time, as frames are in order of step
  align::MotionTrack motion_;
};

}  // namespace

core::Nanoseconds pose_time(const db::Scan& scan, const db::Frame& frame) {
  return frame.timestamp_ns + scan.steps.at(std::size_t(frame.step_index)).exposure_ns / 2;
}

align::MotionTrack stored_motion(const db::Store& store, const db::Scan& scan, const db::Product& alignment,
                                 const std::string& camera) {
  const std::vector<db::Frame> frames = store.frames(scan.id, camera);
  align::MotionTrack motion;
  for (const db::ProductImage& image : alignment.images) {
    if (image.role != "flow") continue;
    const auto frame =
        std::find_if(frames.begin(), frames.end(), [&](const db::Frame& f) { return f.step_index == image.index; });
    if (frame != frames.end()) motion.add(pose_time(scan, *frame), store.object(image.object));
  }
  return motion;
}

AlignReport align_scan(db::Store& store, const db::Scan& scan, const AlignOptions& options) {
  const bool tracked = std::any_of(scan.steps.begin(), scan.steps.end(),
                                   [](const db::Step& step) { return step.kind == db::StepKind::kTracking; });
  if (!tracked) {
    throw core::UsageError("scan '" + scan.name +
                           "' has no tracking frames to align by; capture with --tracking-every");
  }
  AlignReport report;
  for (const std::string& camera : scan.cameras) {
    db::NewProduct product;
    product.kind = "alignment";
    product.scan_id = scan.id;
    product.parameters = json_text({{"camera", camera}, {"flow", to_string(options.preset)}});
    product.input_scans = {scan.id};
    CameraAlignment(store, scan, camera, options).run(product, report);
    store.add_product(product);
  }
  if (report.tracking_frames > 0) {
    report.residual_before /= double(report.tracking_frames);
    report.residual_after /= double(report.tracking_frames);
  }
  return report;
}

}  // namespace lightstage::cli
