#include "db/scan_loader.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <set>

#include "core/error.h"
#include "core/image_file.h"
#include "core/progress.h"
#include "core/text.h"
#include "db/load/light_image.h"
#include "db/store/object_files.h"

namespace lightstage::db {
namespace {

std::string choose_camera(const Scan& scan, const std::string& wanted) {
  if (scan.cameras.empty()) throw core::UsageError("scan '" + scan.name + "' has no camera");
  if (wanted.empty()) return scan.cameras.front();
  if (std::find(scan.cameras.begin(), scan.cameras.end(), wanted) == scan.cameras.end()) {
    throw core::UsageError("scan '" + scan.name + "' has no camera '" + wanted + "'" +
                           core::did_you_mean(wanted, scan.cameras));
  }
  return wanted;
}

// Lights by index, of the newest calibration of the scan's stage or else the nominal ones.
struct KnownLights {
  std::map<int, core::Light> lights;
  std::optional<Id> calibration_id;
};

KnownLights known_lights(const Store& store, const Scan& scan, const std::vector<core::Light>& nominal) {
  KnownLights known;
  if (const auto calibration = store.newest_calibration(scan.stage_key)) {
    known.calibration_id = calibration->id;
    for (const CalibratedLight& entry : store.calibrated_lights(calibration->id)) {
      if (entry.placed) known.lights.emplace(entry.light_index, entry.light);
    }
    return known;
  }
  for (std::size_t i = 0; i < nominal.size(); ++i) known.lights.emplace(int(i), nominal[i]);
  if (known.lights.empty()) {
    throw core::UsageError("scan '" + scan.name + "': nobody has calibrated the lights of its stage '" +
                           scan.stage_key + "'; run `lightstage calibrate`, or give a stage file with nominal lights");
  }
  return known;
}

// Where the images of one light's exposures are.
struct Shot {
  ContentHash object;
  double seconds = 0;
  double saturation = 0;
};

struct LightSource {
  int light_index = 0;
  core::Light light;
  std::vector<Shot> shots;
};

// The images of the scan's light steps, aligned ones where there is an alignment, in order of each light's
// first step.
std::vector<LightSource> light_sources(const Scan& scan, const std::map<int, core::Light>& lights,
                                       const std::vector<Frame>& frames, const std::optional<Product>& alignment,
                                       const std::string& camera) {
  std::map<int, const Frame*> frame_of_step;
  for (const Frame& frame : frames) frame_of_step[frame.step_index] = &frame;
  std::map<int, ContentHash> aligned;
  std::set<int> excluded;
  if (alignment) {
    for (const ProductImage& image : alignment->images) {
      if (image.role == "aligned") aligned[image.index] = image.object;
      if (image.role == "excluded") excluded.insert(image.index);
    }
  }
  std::vector<LightSource> sources;
  std::map<int, std::size_t> source_of_light;
  using LightAtExposure = std::pair<int, std::int64_t>;
  std::set<LightAtExposure> taken, used, left_out;
  for (const Step& step : scan.steps) {
    if (step.kind != StepKind::kLight || !lights.contains(*step.light_index)) continue;
    const LightAtExposure shot{*step.light_index, step.exposure_ns};
    if (excluded.contains(step.step_index)) {
      taken.insert(shot);
      left_out.insert(shot);
      continue;
    }
    const std::string place = "scan '" + scan.name + "', camera '" + camera + "', step " +
                              std::to_string(step.step_index) + " (light " + std::to_string(*step.light_index) + ")";
    const auto frame = frame_of_step.find(step.step_index);
    if (frame == frame_of_step.end()) {
      if (taken.contains(shot)) continue;  // it was to be taken again, and was not
      throw core::StoreError(place + ": the frame is missing; take it with `lightstage capture --resume`");
    }
    ContentHash object = frame->second->object;
    if (alignment) {
      if (!aligned.contains(step.step_index)) {
        throw core::StoreError(place + ": the newest alignment lacks this frame; run `lightstage align` again");
      }
      object = aligned[step.step_index];
    }
    taken.insert(shot);
    used.insert(shot);
    const auto [entry, is_new] = source_of_light.emplace(*step.light_index, sources.size());
    if (is_new) sources.push_back({*step.light_index, lights.at(*step.light_index), {}});
    constexpr double kSecondsPerNanosecond = 1e-9;
    sources[entry->second].shots.push_back(
        {object, double(step.exposure_ns) * kSecondsPerNanosecond, frame->second->saturation});
  }
  std::erase_if(left_out, [&](const LightAtExposure& shot) { return used.contains(shot); });
  if (!left_out.empty()) {
    core::warn("scan '" + scan.name + "', camera '" + camera + "': " + std::to_string(left_out.size()) +
               " frames could not be aligned and are left out");
  }
  if (sources.empty()) {
    throw core::UsageError("scan '" + scan.name + "' has no frame lit by a single light whose direction is known");
  }
  return sources;
}

core::Image read_light(const ObjectFiles& objects, const LightSource& source, core::ImageView dark) {
  core::Image image;
  if (source.shots.size() == 1) {
    image = objects.read(source.shots.front().object);
  } else {
    std::vector<Exposure> exposures;
    for (const Shot& shot : source.shots)
      exposures.push_back({objects.read(shot.object), shot.seconds, shot.saturation});
    image = merge_exposures(exposures);
  }
  subtract_dark(image, dark);
  divide_by_gain(image, source.light.gain);
  return image;
}

// The mask product's image, one channel; empty where there is none.
core::Image read_mask(const Store& store, const std::optional<Product>& mask) {
  if (!mask) return {};
  for (const ProductImage& image : mask->images) {
    if (image.role == "mask") return core::to_luminance(store.object(image.object));
  }
  throw core::StoreError(store.folder().string() + ": mask product " + std::to_string(mask->id) + " has no image");
}

// The mask without what lies outside the picture in a frame of the alignment; as it is where nothing does.
core::Image without_unseen(const Store& store, core::Image mask, const std::optional<Product>& alignment) {
  if (!alignment) return mask;
  for (const ProductImage& image : alignment->images) {
    if (image.role != "seen") continue;
    const core::Image seen = store.object(image.object);
    const auto values = seen.values();
    if (std::all_of(values.begin(), values.end(), [](float v) { return v > 0; })) return mask;
    if (mask.empty()) return seen;
    if (mask.size() != seen.size()) return mask;  // OlatScan says what is wrong with it
    for (std::size_t i = 0; i < values.size(); ++i) mask.values()[i] *= values[i];
  }
  return mask;
}

}  // namespace

std::vector<Id> LoadedScan::products() const {
  std::vector<Id> all;
  for (const std::optional<Id>& product : {calibration_id, alignment_id, mask_id}) {
    if (product) all.push_back(*product);
  }
  return all;
}

LoadedScan load_scan(const Store& store, std::string_view name, const LoadOptions& options) {
  const Scan scan = store.scan(name);
  const std::string camera = choose_camera(scan, options.camera);
  const KnownLights known = known_lights(store, scan, options.nominal_lights);
  const auto alignment =
      options.use_alignment ? store.newest_product("alignment", scan, camera) : std::optional<Product>();
  const auto mask = store.newest_product("mask", scan, camera);
  auto sources = std::make_shared<const std::vector<LightSource>>(
      light_sources(scan, known.lights, store.frames(scan.id, camera), alignment, camera));
  // Aligned images are free of ambient light already.
  auto dark = std::make_shared<const core::Image>(alignment ? core::Image() : dark_level(store, scan, camera));

  std::vector<core::Light> lights;
  std::vector<int> light_index;
  for (const LightSource& source : *sources) {
    lights.push_back(source.light);
    light_index.push_back(source.light_index);
  }
  const core::ImageSize size = store.object_size(sources->front().shots.front().object);
  auto loader = [objects = ObjectFiles(store.folder()), sources, dark](std::size_t i) {
    return read_light(objects, (*sources)[i], *dark);
  };
  return LoadedScan{core::OlatScan(scan.name, std::move(lights), size,
                                   without_unseen(store, read_mask(store, mask), alignment), std::move(loader)),
                    std::move(light_index), known.calibration_id,
                    alignment ? std::optional<Id>(alignment->id) : std::nullopt,
                    mask ? std::optional<Id>(mask->id) : std::nullopt};
}

core::Image dark_level(const Store& store, const Scan& scan, std::string_view camera) {
  std::map<int, StepKind> kind_of_step;
  for (const Step& step : scan.steps) kind_of_step[step.step_index] = step.kind;
  std::vector<core::Image> images;
  for (const Frame& frame : store.frames(scan.id, camera)) {
    if (kind_of_step[frame.step_index] == StepKind::kDark) images.push_back(store.object(frame.object));
  }
  if (images.empty()) return {};
  const std::vector<core::ImageView> views(images.begin(), images.end());
  const std::vector<double> weights(images.size(), 1.0 / double(images.size()));
  return core::weighted_sum(views, weights);
}

core::Image load_frame(const Store& store, const Frame& frame, core::ImageView dark) {
  core::Image image = store.object(frame.object);
  subtract_dark(image, dark);
  return image;
}

}  // namespace lightstage::db
