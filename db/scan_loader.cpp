#include "db/scan_loader.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <mutex>
#include <set>

#include <nlohmann/json.hpp>

#include "core/error.h"
#include "core/exposure_merge.h"
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
  std::int64_t exposure_ns = 0;
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
    sources[entry->second].shots.push_back({object, step.exposure_ns, frame->second->saturation});
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

bool made_with(const Store& store, const Product& product, std::string_view kind) {
  const std::vector<Product> all = store.products(kind);
  return std::any_of(all.begin(), all.end(), [&](const Product& p) {
    return std::find(product.input_products.begin(), product.input_products.end(), p.id) !=
           product.input_products.end();
  });
}

// What is taken off and divided out of the frames of one camera.
struct Corrections {
  std::map<std::int64_t, core::Image> dark;  // by exposure
  core::Image flat;
  std::optional<ColourMatrix> colour;
  std::string place;                                                            // scan and camera, for the warning
  std::shared_ptr<std::once_flag> warned = std::make_shared<std::once_flag>();  // of values that no exposure shows
};

void warn_of_saturation(const Corrections& corrections, int light_index, const core::MergedExposures& merged) {
  constexpr double kWorthSaying = 1e-3;
  const double share = double(merged.saturated_values) / double(merged.image.values().size());
  if (share < kWorthSaying) return;
  std::call_once(*corrections.warned, [&] {
    core::warn(corrections.place + ": under light " + std::to_string(light_index) + " " +
               core::number_text(100 * share, 2) +
               " % of the values saturate in every exposure; a shorter one is needed to see how bright they are");
  });
}

core::Image read_light(const ObjectFiles& objects, const LightSource& source, const Corrections& corrections) {
  const auto dark = [&](const Shot& shot) -> core::ImageView {
    const auto found = corrections.dark.find(shot.exposure_ns);
    return found == corrections.dark.end() ? core::ImageView() : found->second.view();
  };
  core::Image image;
  if (source.shots.size() == 1) {
    image = objects.read(source.shots.front().object);
    subtract_dark(image, dark(source.shots.front()));
  } else {
    std::vector<core::Image> images;
    std::vector<core::Exposure> exposures;
    for (const Shot& shot : source.shots) images.push_back(objects.read(shot.object));
    constexpr double kSecondsPerNanosecond = 1e-9;
    for (std::size_t i = 0; i < images.size(); ++i) {
      const Shot& shot = source.shots[i];
      exposures.push_back({images[i], double(shot.exposure_ns) * kSecondsPerNanosecond, shot.saturation, dark(shot)});
    }
    try {
      core::MergedExposures merged = core::merge_exposures(exposures);
      warn_of_saturation(corrections, source.light_index, merged);
      image = std::move(merged.image);
    } catch (const core::BadInput& error) {
      throw core::StoreError("light " + std::to_string(source.light_index) + ": " + error.what());
    }
  }
  divide_by_flat(image, corrections.flat);
  divide_by_gain(image, source.light.gain);
  if (corrections.colour) apply_colour(image, *corrections.colour);
  return image;
}

// The newest flat field of the scan's camera, if it has the size of the frames.
FlatField known_flat(const Store& store, const Scan& scan, std::string_view camera, core::ImageSize size) {
  const auto product = store.newest_of_camera("flat_field", scan.stage_key, camera);
  if (!product) return {};
  const auto image = std::find_if(product->images.begin(), product->images.end(),
                                  [](const ProductImage& i) { return i.role == "flat"; });
  if (image == product->images.end()) {
    throw core::StoreError(store.folder().string() + ": flat field " + std::to_string(product->id) + " has no image");
  }
  const core::ImageSize found = store.object_size(image->object);
  if (found.height != size.height || found.width != size.width ||
      (found.channels != size.channels && found.channels != 1)) {
    core::warn("scan '" + scan.name + "', camera '" + std::string(camera) +
               "': the camera's flat field is of another size than its frames and is not used");
    return {};
  }
  return {store.object(image->object), product->id};
}

// The newest colour matrix of the scan's camera.
struct KnownColour {
  std::optional<ColourMatrix> matrix;
  std::optional<Id> id;
};

KnownColour known_colour(const Store& store, const Scan& scan, std::string_view camera) {
  const auto product = store.newest_of_camera("colour", scan.stage_key, camera);
  if (!product) return {};
  try {
    return {nlohmann::json::parse(product->parameters).at("matrix").get<ColourMatrix>(), product->id};
  } catch (const nlohmann::json::exception&) {
    throw core::StoreError(store.folder().string() + ": colour " + std::to_string(product->id) +
                           " holds no matrix of 3 x 3 numbers");
  }
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
    core::Image seen = store.object(image.object);
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
  for (const std::optional<Id>& product : {calibration_id, alignment_id, mask_id, flat_id, colour_id}) {
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
  const core::ImageSize size = store.object_size(sources->front().shots.front().object);
  Corrections corrections;
  corrections.place = "scan '" + scan.name + "', camera '" + camera + "'";
  // Aligned images are free of ambient light already, and of vignetting if there was a flat field then.
  if (!alignment) {
    for (const LightSource& source : *sources) {
      for (const Shot& shot : source.shots) {
        if (corrections.dark.contains(shot.exposure_ns)) continue;
        corrections.dark.emplace(shot.exposure_ns, dark_level(store, scan, camera, shot.exposure_ns));
      }
    }
  }
  std::optional<Id> flat_id;
  if (!alignment || !made_with(store, *alignment, "flat_field")) {
    FlatField flat = known_flat(store, scan, camera, size);
    corrections.flat = std::move(flat.image);
    flat_id = flat.id;
  }
  const KnownColour colour = known_colour(store, scan, camera);
  corrections.colour = colour.matrix;

  std::vector<core::Light> lights;
  std::vector<int> light_index;
  for (const LightSource& source : *sources) {
    lights.push_back(source.light);
    light_index.push_back(source.light_index);
  }
  auto loader = [objects = ObjectFiles(store.folder()), sources,
                 corrections = std::make_shared<const Corrections>(std::move(corrections))](std::size_t i) {
    return read_light(objects, (*sources)[i], *corrections);
  };
  return LoadedScan{core::OlatScan(scan.name, std::move(lights), size,
                                   without_unseen(store, read_mask(store, mask), alignment), std::move(loader)),
                    std::move(light_index),
                    known.calibration_id,
                    alignment ? std::optional<Id>(alignment->id) : std::nullopt,
                    mask ? std::optional<Id>(mask->id) : std::nullopt,
                    flat_id,
                    colour.id};
}

core::Image dark_level(const Store& store, const Scan& scan, std::string_view camera, std::int64_t exposure_ns) {
  std::map<int, const Step*> dark_steps;
  std::int64_t longest = 0;
  bool exact = false;
  for (const Step& step : scan.steps) {
    if (step.kind != StepKind::kDark) continue;
    dark_steps[step.step_index] = &step;
    longest = std::max(longest, step.exposure_ns);
    exact = exact || step.exposure_ns == exposure_ns;
  }
  std::vector<core::Image> images;
  for (const Frame& frame : store.frames(scan.id, camera)) {
    const auto step = dark_steps.find(frame.step_index);
    if (step == dark_steps.end() || step->second->exposure_ns != (exact ? exposure_ns : longest)) continue;
    images.push_back(store.object(frame.object));
  }
  if (images.empty()) return {};
  const std::vector<core::ImageView> views(images.begin(), images.end());
  const std::vector<double> weights(images.size(), 1.0 / double(images.size()));
  return core::weighted_sum(views, weights);
}

FlatField flat_field(const Store& store, const Scan& scan, std::string_view camera) {
  const std::vector<Frame> frames = store.frames(scan.id, camera);
  if (frames.empty()) return {};
  return known_flat(store, scan, camera, store.object_size(frames.front().object));
}

core::Image load_frame(const Store& store, const Frame& frame, core::ImageView dark, core::ImageView flat) {
  core::Image image = store.object(frame.object);
  subtract_dark(image, dark);
  divide_by_flat(image, flat);
  return image;
}

}  // namespace lightstage::db
