#include "cli/jobs/align.h"

#include <algorithm>
#include <map>
#include <set>

#include <nlohmann/json.hpp>

#include "align/agreement.h"
#include "align/subject_mask.h"
#include "cli/jobs/provenance.h"
#include "cli/jobs/stored_json.h"
#include "cli/options.h"
#include "core/disk_space.h"
#include "core/error.h"
#include "core/interrupt.h"
#include "core/parallel.h"
#include "core/progress.h"
#include "db/object_room.h"
#include "db/scan_loader.h"

namespace lightstage::cli {

namespace {

double median(std::vector<double> values) {
  const auto middle = values.begin() + std::ptrdiff_t(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

const char* to_string(align::Between between) {
  return between == align::Between::kLinear ? "linear" : "catmull-rom";
}

struct TimedFrame {
  db::Frame frame;
  core::Nanoseconds time;
};

struct TrackingFrame : TimedFrame {
  align::Agreement agreement;
  double residual_before = 0;
  db::ContentHash flow, confidence;
  std::string objection;  // empty: it is used
};

// One camera: adds its images to the product and its figures to the report.
class CameraAlignment {
 public:
  CameraAlignment(db::Store& store, const db::Scan& scan, const std::string& camera, const AlignOptions& options)
      : store_(store),
        scan_(scan),
        camera_(camera),
        options_(options),
        dark_(db::dark_level(store, scan, camera)),
        flat_(db::flat_field(store, scan, camera)) {
    for (const db::Frame& frame : store.frames(scan.id, camera)) {
      const db::StepKind kind = db::step_of(scan, frame.step_index).kind;
      if (kind == db::StepKind::kTracking) tracked_steps_.insert(frame.step_index);
      if (kind == db::StepKind::kTracking)
        tracking_frames_.push_back({{frame, pose_time(scan, frame)}, {}, 0, {}, {}, {}});
      if (kind == db::StepKind::kLight) light_frames_.push_back({frame, pose_time(scan, frame)});
    }
    const auto by_time = [](const TimedFrame& a, const TimedFrame& b) { return a.time < b.time; };
    std::stable_sort(tracking_frames_.begin(), tracking_frames_.end(), by_time);
    std::stable_sort(light_frames_.begin(), light_frames_.end(), by_time);
  }

  void run(db::NewProduct& product, AlignReport& report) {
    if (flat_.id) product.input_products.push_back(*flat_.id);  // loading knows by it what the images were divided by
    track();
    judge(report);
    for (const TrackingFrame& tracked : tracking_frames_) {
      const double after = tracked.agreement.residual;
      product.images.push_back(
          {.role = "flow", .index = tracked.frame.step_index, .object = tracked.flow, .value = after});
      product.images.push_back(
          {.role = "flow_confidence", .index = tracked.frame.step_index, .object = tracked.confidence, .value = after});
    }
    warp_light_frames(product, report);
  }

 private:
  // Flow takes about 230 bytes a pixel: of large pictures not as many at a time as there are threads.
  std::size_t frames_at_a_time() const {
    constexpr std::size_t kPixelsAtATime = 1 << 25;
    const std::size_t pixels = std::size_t(size_.height) * std::size_t(size_.width);
    return std::clamp<std::size_t>(kPixelsAtATime / std::max<std::size_t>(1, pixels), 1,
                                   std::size_t(core::thread_count()));
  }

  // Calls compute(i) for the frames of a batch on all threads, then store(i) in order through the one store connection.
  template <typename Load, typename Compute, typename Store>
  void in_batches(std::size_t count, const Load& load, const Compute& compute, const Store& store) const {
    const std::size_t batch = frames_at_a_time();
    for (std::size_t begin = 0; begin < count; begin += batch) {
      core::throw_if_interrupted();
      const std::size_t end = std::min(count, begin + batch);
      for (std::size_t i = begin; i < end; ++i) load(i);
      core::parallel_for(end - begin, 1, [&](std::size_t first, std::size_t last) {
        for (std::size_t i = first; i < last; ++i) compute(begin + i);
      });
      for (std::size_t i = begin; i < end; ++i) store(i);
    }
  }

  void track() {
    const int key_step = cli::key_step(scan_);
    const auto key_frame = std::find_if(tracking_frames_.begin(), tracking_frames_.end(),
                                        [&](const TrackingFrame& f) { return f.frame.step_index == key_step; });
    if (key_frame == tracking_frames_.end()) {
      throw core::StoreError("scan '" + scan_.name + "', camera '" + camera_ + "': its key tracking frame (step " +
                             std::to_string(key_step) + ") is missing; run `lightstage capture --resume --name " +
                             scan_.name + "`");
    }
    key_ = std::size_t(key_frame - tracking_frames_.begin());
    const core::Image key = db::load_frame(store_, key_frame->frame, dark_, flat_.image);
    mask_ = align::subject_mask(key);
    size_ = key.size();
    if (const std::string objection = align::key_objection(key, mask_, key_frame->frame.saturation);
        !objection.empty()) {
      throw core::BadInput("scan '" + scan_.name + "', camera '" + camera_ + "': its key frame (step " +
                           std::to_string(key_step) + ") " + objection +
                           (dark_.empty() ? "" : " once the dark frames are subtracted") +
                           ", so nothing can be aligned to it; capture the pass again");
    }
    core::Progress progress("optical flow, " + camera_, tracking_frames_.size());
    struct Work {
      core::Image picture;
      align::FlowField flow;
      core::Image confidence;
    };
    std::map<std::size_t, Work> work;
    in_batches(
        tracking_frames_.size(),
        [&](std::size_t i) { work[i].picture = db::load_frame(store_, tracking_frames_[i].frame, dark_, flat_.image); },
        [&](std::size_t i) {
          Work& own = work.at(i);
          own.flow = align::FlowField(key.height(), key.width(), 2);
          align::FlowField back = own.flow;
          if (i != key_) {
            own.flow = align::compute_flow(key, own.picture, options_.preset, options_.shrink);
            if (align::stands_still(own.flow, mask_)) {
              own.flow = back;
            } else {
              back = align::compute_flow(own.picture, key, options_.preset, options_.shrink);
            }
          }
          own.confidence = align::flow_confidence(own.flow, back);
          tracking_frames_[i].residual_before = align::residual(key, own.picture, mask_);
          tracking_frames_[i].agreement = align::agreement_of(key, own.picture, own.flow, own.confidence, mask_);
        },
        [&](std::size_t i) {
          tracking_frames_[i].flow = store_.put_object(work.at(i).flow);
          tracking_frames_[i].confidence = store_.put_object(work.at(i).confidence);
          work.erase(i);
          progress.advance();
        });
  }

  void judge(AlignReport& report) {
    std::vector<align::Agreement> others;
    for (std::size_t i = 0; i < tracking_frames_.size(); ++i) {
      if (i != key_) others.push_back(tracking_frames_[i].agreement);
    }
    std::vector<std::string> objections = align::objections(others, std::max(size_.width, size_.height));
    objections.insert(objections.begin() + std::ptrdiff_t(key_), std::string());
    std::vector<double> motions;
    for (std::size_t i = 0; i < tracking_frames_.size(); ++i) {
      TrackingFrame& tracked = tracking_frames_[i];
      tracked.objection = objections[i];
      if (!tracked.objection.empty()) {
        report.excluded.push_back({camera_, tracked.frame.step_index, std::nullopt, tracked.objection});
      }
      if (i == key_) continue;
      motions.push_back(tracked.agreement.motion_px);
      report.residual_before += tracked.residual_before;
      report.residual_after += tracked.agreement.residual;
      report.believed += tracked.agreement.believed;
      ++report.tracking_frames;
    }
    if (motions.empty()) return;
    report.median_motion_px = std::max(report.median_motion_px, median(motions));
    report.largest_motion_px = std::max(report.largest_motion_px, *std::max_element(motions.begin(), motions.end()));
  }

  // The tracking frames around a time.
  std::pair<const TrackingFrame*, const TrackingFrame*> around(core::Nanoseconds time) const {
    const auto after = std::find_if(tracking_frames_.begin(), tracking_frames_.end(),
                                    [&](const TrackingFrame& f) { return f.time >= time; });
    if (after == tracking_frames_.end()) return {&tracking_frames_.back(), &tracking_frames_.back()};
    if (after == tracking_frames_.begin()) return {&*after, &*after};
    return {&*std::prev(after), &*after};
  }

  // Between two tracking frames, their residuals in proportion of time.
  double residual_at(core::Nanoseconds time) const {
    const auto [before, after] = around(time);
    if (before == after) return after->agreement.residual;
    const double part = double(time - before->time) / double(after->time - before->time);
    return before->agreement.residual + part * (after->agreement.residual - before->agreement.residual);
  }

  // Why a light's frame is not to be used; empty when it is.
  std::string objection_to(const TimedFrame& light) const {
    // In the table of steps: a pass that was broken off lacks the tracking frame after its last lights.
    for (const int direction : {-1, 1}) {
      int step = light.frame.step_index + direction;
      while (step >= 0 && step < int(scan_.steps.size()) && kind_of(step) != db::StepKind::kTracking) step += direction;
      if (step < 0 || step >= int(scan_.steps.size()) || tracked_steps_.contains(step)) continue;
      return "next to the tracking frame of step " + std::to_string(step) + ", which was not taken";
    }
    const auto [before, after] = around(light.time);
    for (const TrackingFrame* frame : {before, after}) {
      if (frame->objection.empty()) continue;
      return "next to the tracking frame of step " + std::to_string(frame->frame.step_index) + ", where the subject " +
             frame->objection;
    }
    return {};
  }

  db::StepKind kind_of(int step) const { return db::step_of(scan_, step).kind; }
  int light_of(const TimedFrame& frame) const { return *db::step_of(scan_, frame.frame.step_index).light_index; }

  // Lights of which no frame is to be used.
  std::set<int> lost_lights() const {
    std::set<int> lost, usable;
    for (const TimedFrame& light : light_frames_) (objection_to(light).empty() ? usable : lost).insert(light_of(light));
    std::erase_if(lost, [&](int light) { return usable.contains(light); });
    return lost;
  }

  void require_enough(std::size_t lost) const {
    std::set<int> lights;
    std::string why;
    for (const TimedFrame& light : light_frames_) {
      lights.insert(light_of(light));
      if (why.empty()) why = objection_to(light);
    }
    if (2 * lost <= lights.size()) return;
    throw core::BadInput(
        "scan '" + scan_.name + "', camera '" + camera_ + "': the frames of " + std::to_string(lost) + " of " +
        std::to_string(lights.size()) + " lights cannot be aligned (" + why +
        "); capture it again, with the head supported, more tracking frames (--tracking-every) or a shorter pass");
  }

  // Adds the tracking frames' flows, from the next one on, until the motion at `time` cannot change any more.
  void extend(align::MotionTrack& motion, std::size_t& next, core::Nanoseconds time) const {
    while (next < tracking_frames_.size() && !(motion.settled_until() && *motion.settled_until() >= time)) {
      const TrackingFrame& tracked = tracking_frames_[next++];
      if (!tracked.objection.empty()) continue;
      motion.add(tracked.time, store_.object(tracked.flow), store_.object(tracked.confidence));
    }
  }

  void warp_light_frames(db::NewProduct& product, AlignReport& report) {
    const std::set<int> lost = lost_lights();
    require_enough(lost.size());
    report.lost_lights.insert(lost.begin(), lost.end());
    core::Progress progress("warping, " + camera_, light_frames_.size());
    align::MotionTrack motion(options_.between);
    std::size_t next = 0;
    struct Work {
      core::Image picture, confidence;
      align::FlowField flow;
    };
    core::Image seen(size_.height, size_.width, 1);
    std::fill(seen.values().begin(), seen.values().end(), 1.0F);
    std::map<std::size_t, Work> work;
    in_batches(
        light_frames_.size(),
        [&](std::size_t i) {
          // The first of a batch is the earliest: what lies before is of no more use.
          if (work.empty()) motion.forget_before(light_frames_[i].time);
          extend(motion, next, light_frames_[i].time);
          work[i].picture = db::load_frame(store_, light_frames_[i].frame, dark_, flat_.image);
        },
        [&](std::size_t i) {
          Work& own = work.at(i);
          const core::Nanoseconds time = light_frames_[i].time;
          own.flow = motion.at(time);
          own.picture = align::warp(own.picture, own.flow);
          own.confidence = motion.confidence_at(time);
          align::clear_outside(own.confidence, own.flow);
        },
        [&](std::size_t i) {
          const TimedFrame& light = light_frames_[i];
          const int step = light.frame.step_index;
          const std::string objection = objection_to(light);
          const double value = residual_at(light.time);
          const bool used = objection.empty();
          add_image(product, used ? "aligned" : "excluded", step, store_.put_object(work.at(i).picture), value);
          add_image(product, "confidence", step, store_.put_object(work.at(i).confidence), value);
          if (used) {
            ++report.aligned;
            clear_hidden(seen, work.at(i).confidence, work.at(i).flow);
          } else {
            report.excluded.push_back({camera_, step, light_of(light), objection});
          }
          work.erase(i);
          progress.advance();
        });
    add_image(product, "seen", 0, store_.put_object(seen), 0);
    report.masked = std::max(report.masked, share_cleared(seen));
  }

  // Sets to 0 what a frame does not show: on the subject where its confidence is 0, elsewhere what lies outside its picture.
  void clear_hidden(core::Image& seen, const core::Image& confidence, const align::FlowField& flow) const {
    core::Image inside = seen;
    align::clear_outside(inside, flow);
    for (std::size_t p = 0; p < seen.values().size(); ++p) {
      const bool subject = mask_.values()[p] > 0.5F;
      if (subject ? confidence.values()[p] <= 0 : inside.values()[p] <= 0) seen.values()[p] = 0;
    }
  }

  // Of the subject.
  double share_cleared(const core::Image& seen) const {
    std::size_t subject = 0, cleared = 0;
    for (std::size_t p = 0; p < seen.values().size(); ++p) {
      if (mask_.values()[p] <= 0.5F) continue;
      ++subject;
      cleared += seen.values()[p] <= 0;
    }
    return subject == 0 ? 0 : double(cleared) / double(subject);
  }

  static void add_image(db::NewProduct& product, const char* role, int index, const db::ContentHash& object,
                        double value) {
    product.images.push_back({.role = role, .index = index, .object = object, .value = value});
  }

  db::Store& store_;
  const db::Scan& scan_;
  const std::string& camera_;
  const AlignOptions& options_;
  core::Image dark_;
  db::FlatField flat_;
  std::vector<TrackingFrame> tracking_frames_;  // by time
  std::set<int> tracked_steps_;                 // that have a frame
  std::vector<TimedFrame> light_frames_;        // by time
  std::size_t key_ = 0;                         // of the tracking frames
  core::ImageSize size_;                        // of the pictures
  core::Image mask_;                            // the subject in the key pose
};

}  // namespace

core::Nanoseconds pose_time(const db::Scan& scan, const db::Frame& frame) {
  return frame.timestamp_ns + db::step_of(scan, frame.step_index).exposure_ns / 2;
}

align::MotionTrack stored_motion(const db::Store& store, const db::Scan& scan, const db::Product& alignment,
                                 const std::string& camera) {
  const std::vector<db::Frame> frames = store.frames(scan.id, camera);
  std::string between;
  std::set<int> excluded;
  reading_json("alignment " + std::to_string(alignment.id), [&] {
    const auto parameters = nlohmann::json::parse(alignment.parameters);
    // Alignments stored before there was a choice went linearly, and excluded nothing.
    between = parameters.value("between", "linear");
    for (const auto& frame : parameters.value("excluded", nlohmann::json::array()))
      excluded.insert(frame.at("step").get<int>());
  });
  align::MotionTrack motion(between == to_string(align::Between::kCatmullRom) ? align::Between::kCatmullRom
                                                                              : align::Between::kLinear);
  for (const db::ProductImage& image : alignment.images) {
    if (image.role != "flow" || excluded.contains(image.index)) continue;
    const auto frame =
        std::find_if(frames.begin(), frames.end(), [&](const db::Frame& f) { return f.step_index == image.index; });
    if (frame != frames.end()) motion.add(pose_time(scan, *frame), store.object(image.object));
  }
  return motion;
}

void require_room_for_alignment(const db::Store& store, const db::Scan& scan) {
  std::uintmax_t bytes = 0;
  for (const std::string& camera : scan.cameras) {
    for (const db::Frame& frame : store.frames(scan.id, camera)) {
      const core::ImageSize size = store.object_size(frame.object);
      // The picture, or of a tracking frame the flow, and the confidence.
      bytes += db::most_bytes(size) + db::most_bytes({size.height, size.width, 1});
    }
  }
  core::require_room(store.folder(), bytes, "aligning '" + scan.name + "'");
}

AlignReport align_scan(db::Store& store, const db::Scan& scan, const AlignOptions& options) {
  const bool tracked = std::any_of(scan.steps.begin(), scan.steps.end(),
                                   [](const db::Step& step) { return step.kind == db::StepKind::kTracking; });
  if (!tracked) {
    throw core::UsageError("scan '" + scan.name +
                           "' has no tracking frames to align by; capture with --tracking-every, or give --robust, "
                           "which registers pictures under different lights and is weaker");
  }
  require_room_for_alignment(store, scan);
  AlignReport report;
  std::vector<db::NewProduct> products;
  for (const std::string& camera : scan.cameras) {
    db::NewProduct product;
    product.kind = "alignment";
    product.scan_id = scan.id;
    product.input_scans = {scan.id};
    const std::size_t excluded_before = report.excluded.size();
    CameraAlignment(store, scan, camera, options).run(product, report);
    nlohmann::ordered_json excluded = nlohmann::ordered_json::array();
    for (std::size_t i = excluded_before; i < report.excluded.size(); ++i) {
      excluded.push_back({{"step", report.excluded[i].step_index}, {"reason", report.excluded[i].reason}});
    }
    product.parameters = json_text({{"camera", camera},
                                    {"flow", align::name_of(options.preset)},
                                    {"shrink", options.shrink},
                                    {"between", to_string(options.between)},
                                    {"excluded", excluded}});
    products.push_back(std::move(product));
  }
  // All cameras or none: what ends the program before leaves the scan as it was.
  store.atomically([&] {
    for (const db::NewProduct& product : products) store.add_product(product);
  });
  if (report.tracking_frames > 0) {
    report.residual_before /= double(report.tracking_frames);
    report.residual_after /= double(report.tracking_frames);
    report.believed /= double(report.tracking_frames);
  }
  return report;
}

}  // namespace lightstage::cli
