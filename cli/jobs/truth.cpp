#include "cli/jobs/truth.h"

#include <algorithm>
#include <cmath>

#include "cli/jobs/align.h"
#include "core/display.h"
#include "core/error.h"
#include "core/interrupt.h"
#include "core/progress.h"
#include "sim/sensor.h"

namespace lightstage::cli {

namespace {

const sim::Simulation& simulation_of(const CaptureProvenance& provenance, const db::Scan& scan) {
  if (!provenance.simulation) {
    throw core::UsageError("scan '" + scan.name +
                           "' was not captured on the simulated stage: there is no truth to compare with");
  }
  return *provenance.simulation;
}

double median_of(std::vector<float>& values) {
  return core::quantile(values, 0.5);
}

// Sum of squared differences of display values over the mask, and how many values it is of.
struct SquaredError {
  double sum = 0;
  double values = 0;

  void add(core::ImageView a, core::ImageView b, core::ImageView mask, double exposure) {
    for (int y = 0; y < a.height(); ++y) {
      for (int x = 0; x < a.width(); ++x) {
        if (mask(y, x) <= 0.5f) continue;
        for (int c = 0; c < a.channels(); ++c) {
          const auto shown = [exposure](float v) {
            return double(core::display_encode(std::min(float(v / exposure), 1.0f)));
          };
          const double e = shown(a(y, x, c)) - shown(b(y, x, c));
          sum += e * e;
          values += 1;
        }
      }
    }
  }
  double psnr_db() const { return sum > 0 ? -10 * std::log10(sum / values) : INFINITY; }
};

}  // namespace

SimulatedTruth::SimulatedTruth(const db::Store& store, const std::string& scan_name, const std::string& camera)
    : scan_(store.scan(scan_name)),
      provenance_(capture_provenance(scan_)),
      camera_(camera_of(provenance_.stage, camera)),
      world_(simulation_of(provenance_, scan_)),
      key_time_(key_time(store)),
      flat_(db::flat_field(store, scan_, camera_.name)) {}

core::Nanoseconds SimulatedTruth::key_time(const db::Store& store) const {
  const int key = key_step(scan_);
  for (const db::Frame& frame : store.frames(scan_.id, camera_.name)) {
    if (frame.step_index == key) return pose_time(scan_, frame);
  }
  if (key < 0) return 0;
  throw core::StoreError("scan '" + scan_.name + "' lacks its key frame (step " + std::to_string(key) +
                         "); run `lightstage capture --resume --name " + scan_.name + "`");
}

core::Image SimulatedTruth::as_seen(core::ImageView radiance) const {
  // A noiseless sensor at an exposure too short to clip: what is left is the lens's vignetting, unless a flat field takes it out of the frames.
  sim::SensorSpec sensor = world_.simulation().sensor;
  sensor.noise = false;
  if (flat_.id) sensor.vignetting = 0;
  constexpr core::Nanoseconds kTooShortToClip = 10;
  return sim::sense(radiance, sensor, camera_.responsivity, kTooShortToClip, 0);
}

std::vector<core::Image> SimulatedTruth::render(std::span<const core::Direction> directions) const {
  std::vector<core::Image> images = world_.render_directions(camera_.model, directions, key_time_);
  for (core::Image& image : images) image = as_seen(image);
  return images;
}

SimulatedTruth::CalibrationError SimulatedTruth::calibration_error(const db::LoadedScan& loaded) const {
  std::vector<float> angles, gains;
  for (std::size_t i = 0; i < loaded.scan.light_count(); ++i) {
    const core::Light& found = loaded.scan.light(i);
    const core::Light& truth = world_.true_lights().at(std::size_t(loaded.light_index[i]));
    angles.push_back(float(core::degrees_from_radians(core::angle_radians(found.direction, truth.direction))));
    for (std::size_t c = 0; c < 3; ++c) {
      if (truth.gain[c] > 0) gains.push_back(float(std::abs(found.gain[c] / truth.gain[c] - 1)));
    }
  }
  return {.lights = angles.size(),
          .median_degrees = median_of(angles),
          .p95_degrees = core::quantile(angles, 0.95),
          .largest_degrees = core::quantile(angles, 1),
          .median_gain_error = gains.empty() ? NAN : median_of(gains)};
}

SimulatedTruth::AlignmentError SimulatedTruth::alignment_error(const db::Store& store, double exposure) const {
  const auto alignment = store.newest_product("alignment", scan_, camera_.name);
  if (!alignment)
    throw core::UsageError("scan '" + scan_.name + "' is not aligned; run `lightstage align " + scan_.name + "`");
  const align::MotionTrack motion = stored_motion(store, scan_, *alignment, camera_.name);
  const std::vector<db::Frame> frames = store.frames(scan_.id, camera_.name);
  const core::Image dark = db::dark_level(store, scan_, camera_.name);
  const core::Image mask = world_.coverage(camera_.model, key_time_);

  AlignmentError error;
  std::vector<float> end_point_errors;
  SquaredError unaligned, aligned;
  core::Progress progress("comparing with the true motion", alignment->images.size());
  for (const db::ProductImage& image : alignment->images) {
    core::throw_if_interrupted();
    progress.advance();
    if (image.role != "aligned") continue;
    const auto frame =
        std::find_if(frames.begin(), frames.end(), [&](const db::Frame& f) { return f.step_index == image.index; });
    if (frame == frames.end() || !db::step_of(scan_, image.index).light_index) {
      throw core::StoreError("alignment " + std::to_string(alignment->id) + " of scan '" + scan_.name +
                             "' is damaged: it aligns step " + std::to_string(image.index) + ", which shows no light");
    }
    const core::Nanoseconds time = pose_time(scan_, *frame);
    const core::Image truth = world_.true_flow(camera_.model, key_time_, time);
    const align::FlowField found = motion.at(time);
    for (int y = 0; y < truth.height(); ++y) {
      for (int x = 0; x < truth.width(); ++x) {
        if (mask(y, x) <= 0.5f || !std::isfinite(truth(y, x, 0))) continue;
        end_point_errors.push_back(std::hypot(truth(y, x, 0) - found(y, x, 0), truth(y, x, 1) - found(y, x, 1)));
      }
    }
    const capture::LightLevel light{.light_index = *db::step_of(scan_, image.index).light_index};
    const core::Image still = as_seen(world_.render(camera_.model, std::span(&light, 1), key_time_));
    unaligned.add(core::to_rgb(db::load_frame(store, *frame, dark, flat_.image)), still, mask, exposure);
    aligned.add(core::to_rgb(store.object(image.object)), still, mask, exposure);
    ++error.frames;
  }
  if (end_point_errors.empty()) return error;
  error.median_epe_px = median_of(end_point_errors);
  error.p95_epe_px = core::quantile(end_point_errors, 0.95);
  error.psnr_unaligned_db = unaligned.psnr_db();
  error.psnr_aligned_db = aligned.psnr_db();
  return error;
}

}  // namespace lightstage::cli
