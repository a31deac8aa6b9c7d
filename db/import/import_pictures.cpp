// From a set of pictures on disk to a scan in the store.
#include <nlohmann/json.hpp>

#include "core/error.h"
#include "core/interrupt.h"
#include "core/parallel.h"
#include "core/progress.h"
#include "db/check/damaged.h"
#include "db/check/thumbnail.h"
#include "db/importers.h"
#include "db/load/light_image.h"

namespace lightstage::db {

namespace fs = std::filesystem;

namespace {

constexpr const char* kCamera = "camera";

std::string to_text(core::ImageSize size) {
  return std::to_string(size.width) + "x" + std::to_string(size.height) + (size.channels < 3 ? " grey" : " colour");
}

// As read_picture gives it.
core::ImageSize without_alpha(core::ImageSize size) {
  if (size.channels != 1) size.channels = 3;
  return size;
}

core::Image read_picture(const fs::path& path, core::Encoding encoding) {
  core::Image image = core::read_image(path, {.encoding = encoding});
  return image.channels() == 1 || image.channels() == 3 ? image : core::to_rgb(image);
}

// White inside; 1 and 0.
core::Image read_mask(const fs::path& path) {
  core::Image mask = core::to_luminance(core::read_image(path, {.encoding = core::Encoding::kLinear}));
  bool any = false;
  for (float& value : mask.values()) {
    value = value >= 0.5F ? 1.0F : 0.0F;
    any = any || value > 0;
  }
  if (!any) throw core::BadInput(path.string() + ": the mask is black everywhere; it must be white on the subject");
  return mask;
}

// The size of all pictures, from their headers. Throws BadInput naming the first that differs.
core::ImageSize common_size(const PictureSet& set) {
  const auto& first = set.pictures.front().path;
  const core::ImageSize size = without_alpha(core::read_image_size(first));
  const auto require = [&](const fs::path& path, bool same_channels) {
    core::ImageSize other = without_alpha(core::read_image_size(path));
    if (!same_channels) other.channels = size.channels;
    if (other != size) {
      throw core::BadInput(path.string() + ": the picture is " + to_text(other) + ", but " + first.filename().string() +
                           " is " + to_text(size) + "; all must be alike");
    }
  };
  for (const PictureEntry& picture : set.pictures) require(picture.path, true);
  if (set.ambient) require(*set.ambient, true);
  if (set.mask) require(*set.mask, false);
  return size;
}

// Everything about the set that can be known without writing anything.
struct Inspection {
  core::ImageSize size;
  core::Image mask;
  std::vector<Damage> damaged;
};

// Reads every picture once, so that what is wrong with any of them shows before the store is touched.
Inspection inspect(const PictureSet& set, core::Encoding encoding) {
  Inspection inspection{common_size(set), {}, {}};
  core::Image ambient;
  if (set.ambient) ambient = read_picture(*set.ambient, encoding);
  if (set.mask) inspection.mask = read_mask(*set.mask);

  core::Progress progress("check " + set.source.filename().string(), set.pictures.size());
  std::vector<DamageFeatures> features(set.pictures.size());
  core::parallel_for(set.pictures.size(), 1, [&](std::size_t first, std::size_t last) {
    for (std::size_t i = first; i < last; ++i) {
      core::throw_if_interrupted();
      core::Image image = read_picture(set.pictures[i].path, encoding);
      subtract_dark(image, ambient);
      divide_by_gain(image, set.pictures[i].intensity);
      features[i] = {thumbnail(image, kDamageSide), row_detail(image, kDetailSide)};
      progress.advance();
    }
  });
  std::vector<core::Direction> directions;
  for (const PictureEntry& picture : set.pictures) directions.push_back(picture.direction);
  DamageFeatures mask;
  if (set.mask) mask = {thumbnail(inspection.mask, kDamageSide), thumbnail(inspection.mask, kDetailSide)};
  inspection.damaged = find_damaged(directions, features, mask);
  return inspection;
}

std::vector<CalibratedLight> calibration_of(const PictureSet& set, const std::vector<Damage>& damaged) {
  std::vector<CalibratedLight> lights;
  for (std::size_t i = 0; i < set.pictures.size(); ++i) {
    CalibratedLight entry;
    entry.light_index = int(i);
    entry.light.direction = set.pictures[i].direction;
    entry.light.gain = set.pictures[i].intensity;
    lights.push_back(std::move(entry));
  }
  for (const Damage& damage : damaged) {
    CalibratedLight& entry = lights[damage.index];
    char ratio[32];
    std::snprintf(ratio, sizeof ratio, "%.1f", damage.error_ratio);
    entry.placed = false;
    entry.reason = set.pictures[damage.index].path.filename().string() +
                   (damage.in_detail ? ": its rows do" : ": it does") + " not fit the pictures of the lights around (" +
                   ratio + " times their own spread): damaged or mislabelled";
  }
  return lights;
}

std::string_view name_of(core::Encoding encoding) {
  switch (encoding) {
    case core::Encoding::kLinear:
      return "linear";
    case core::Encoding::kSrgb:
      return "srgb";
    case core::Encoding::kAuto:
      break;
  }
  return "auto";
}

// Which file became which step, with the hash of its bytes, so that the original can be found again.
std::string provenance_of(const PictureSet& set, core::Encoding encoding) {
  const auto file = [](const fs::path& path) {
    return nlohmann::json{{"file", fs::absolute(path).lexically_normal().string()},
                          {"xxh3_128", hash_file(path).hex()}};
  };
  nlohmann::json import{{"format", set.format},
                        {"source", fs::absolute(set.source).lexically_normal().string()},
                        {"encoding", name_of(encoding)},
                        {"pictures", nlohmann::json::array()}};
  for (const PictureEntry& picture : set.pictures) import["pictures"].push_back(file(picture.path));
  if (set.mask) import["mask"] = file(*set.mask);
  if (set.ambient) import["ambient"] = file(*set.ambient);
  // File names need not be UTF-8; what is not is replaced rather than refused.
  return nlohmann::json{{"import", import}}.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
}

NewScan scan_of(const PictureSet& set, const std::string& name, core::Encoding encoding) {
  NewScan scan;
  scan.name = name;
  scan.kind = ScanKind::kImported;
  scan.stage_key = "scan:" + name;
  scan.cameras = {kCamera};
  for (std::size_t i = 0; i < set.pictures.size(); ++i) {
    scan.steps.push_back({.step_index = int(i), .kind = StepKind::kLight, .light_index = int(i)});
  }
  if (set.ambient) scan.steps.push_back({.step_index = int(set.pictures.size()), .kind = StepKind::kDark});
  scan.provenance = provenance_of(set, encoding);
  return scan;
}

}  // namespace

ImportReport import_pictures(Store& store, const PictureSet& set, const std::string& name,
                             std::optional<core::Encoding> encoding) {
  if (set.pictures.empty()) throw core::BadInput(set.source.string() + ": no pictures to import");
  store.require_free_name(name);
  const core::Encoding stored_as = encoding.value_or(set.encoding);
  const Inspection inspection = inspect(set, stored_as);
  const NewScan scan = scan_of(set, name, stored_as);
  const std::vector<CalibratedLight> lights = calibration_of(set, inspection.damaged);

  std::vector<ContentHash> objects;
  core::Progress progress("import " + name, set.pictures.size());
  for (const PictureEntry& picture : set.pictures) {
    core::throw_if_interrupted();
    objects.push_back(store.put_object(read_picture(picture.path, stored_as)));
    progress.advance();
  }
  if (set.ambient) objects.push_back(store.put_object(read_picture(*set.ambient, stored_as)));
  std::optional<ContentHash> mask;
  if (set.mask) mask = store.put_object(inspection.mask);

  ImportReport report;
  // All rows at once: whatever ends the program before this line, the store shows nothing of the scan.
  store.atomically([&] {
    report.scan_id = store.add_scan(scan);
    for (std::size_t i = 0; i < objects.size(); ++i) {
      store.add_frame({.scan_id = report.scan_id, .camera = kCamera, .step_index = int(i)}, objects[i]);
    }
    if (mask) {
      NewProduct product;
      product.kind = "mask";
      product.scan_id = report.scan_id;
      product.input_scans = {report.scan_id};
      product.images = {{"mask", 0, *mask, 0}};
      store.add_product(product);
    }
    NewProduct calibration;
    calibration.kind = "calibration";
    calibration.scan_id = report.scan_id;
    calibration.stage_key = scan.stage_key;
    calibration.parameters = nlohmann::json{{"method", "import"}, {"format", set.format}}.dump();
    calibration.input_scans = {report.scan_id};
    store.add_calibration(calibration, lights);
    if (set.colour) {
      NewProduct colour;
      colour.kind = "colour";
      colour.stage_key = scan.stage_key;
      colour.parameters = nlohmann::json{{"matrix", *set.colour}}.dump();
      colour.input_scans = {report.scan_id};
      store.add_product(colour);
    }
  });
  report.pictures = set.pictures.size();
  report.size = inspection.size;
  for (const CalibratedLight& light : lights) {
    if (!light.placed) report.excluded.push_back(light);
  }
  return report;
}

}  // namespace lightstage::db
