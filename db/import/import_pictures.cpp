// From a set of pictures on disk to a scan in the store.
#include <cstdio>
#include <map>
#include <mutex>
#include <set>

#include <nlohmann/json.hpp>

#include "core/disk_space.h"
#include "core/error.h"
#include "core/interrupt.h"
#include "core/parallel.h"
#include "core/progress.h"
#include "db/check/damaged.h"
#include "db/check/swapped.h"
#include "db/check/thumbnail.h"
#include "db/importers.h"
#include "db/load/light_image.h"
#include "db/object_room.h"

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

// Everything about the set that can be known without writing anything.
struct Inspection {
  core::ImageSize size;
  core::Image mask;
  std::map<std::size_t, std::string> unusable;  // pictures by place in the set, with the reason
  std::set<std::size_t> unreadable;             // of these, the files that gave no picture

  bool is_readable(std::size_t picture) const { return !unreadable.contains(picture); }
};

// The size of all readable pictures, from their headers. Throws BadInput naming the first that differs.
core::ImageSize common_size(const PictureSet& set, Inspection& inspection) {
  std::optional<std::size_t> first;
  core::ImageSize size;
  const auto require = [&](const fs::path& path, core::ImageSize other) {
    if (other == size) return;
    throw core::BadInput(path.string() + ": the picture is " + to_text(other) + ", but " +
                         set.pictures[*first].path.filename().string() + " is " + to_text(size) +
                         "; all must be alike");
  };
  for (std::size_t i = 0; i < set.pictures.size(); ++i) {
    core::ImageSize own;
    try {
      own = without_alpha(core::read_image_size(set.pictures[i].path));
    } catch (const core::BadInput& error) {
      inspection.unusable[i] = error.what();
      inspection.unreadable.insert(i);
      continue;
    }
    if (!first) size = own;
    if (!first) first = i;
    require(set.pictures[i].path, own);
  }
  if (!first) throw core::BadInput(inspection.unusable.begin()->second);
  if (set.ambient) require(*set.ambient, without_alpha(core::read_image_size(*set.ambient)));
  if (set.mask) {
    core::ImageSize own = core::read_image_size(*set.mask);
    own.channels = size.channels;
    require(*set.mask, own);
  }
  return size;
}

// A few pictures that cannot be read are left out like damaged ones; when they are many, something else is wrong.
void require_few_unreadable(const PictureSet& set, const Inspection& inspection) {
  constexpr std::size_t kOneIn = 10;
  const std::size_t count = inspection.unreadable.size();
  if (count == 0 || count * kOneIn <= set.pictures.size()) return;
  std::string message = inspection.unusable.at(*inspection.unreadable.begin());
  if (count > 1) {
    message += "; with it " + std::to_string(count) + " of the set's " + std::to_string(set.pictures.size()) +
               " pictures cannot be read, too many to be left out";
  }
  throw core::BadInput(message);
}

void find_unfit(const PictureSet& set, const std::vector<DamageFeatures>& features,
                const std::vector<core::Image>& swap_shapes, Inspection& inspection) {
  DamageFeatures mask;
  core::Image swap_mask;
  if (set.mask) {
    mask = {thumbnail(inspection.mask, kDamageSide), thumbnail(inspection.mask, kDetailSide)};
    swap_mask = thumbnail(inspection.mask, kShapeSide);
  }
  // Of the pictures that are left, by every search.
  struct Left {
    std::vector<std::size_t> places;
    std::vector<core::Direction> directions;
    std::vector<DamageFeatures> features;
    std::vector<core::Image> shapes, swap_shapes;
  };
  const auto what_is_left = [&] {
    Left left;
    for (std::size_t i = 0; i < set.pictures.size(); ++i) {
      if (inspection.unusable.contains(i)) continue;
      left.places.push_back(i);
      left.directions.push_back(set.pictures[i].direction);
      left.features.push_back(features[i]);
      left.shapes.push_back(features[i].shape);
      left.swap_shapes.push_back(swap_shapes[i]);
    }
    return left;
  };
  const auto name = [&](std::size_t picture) { return set.pictures[picture].path.filename().string(); };
  const auto rounded = [](double value) {
    char text[32];
    std::snprintf(text, sizeof text, "%.1f", value);
    return std::string(text);
  };
  Left left = what_is_left();
  for (const Damage& black : find_black(left.directions, left.shapes, mask.shape)) {
    inspection.unusable[left.places[black.index]] = name(left.places[black.index]) + ": it is black (" +
                                                    rounded(100 * black.ratio) +
                                                    " % as bright as the set's other pictures)";
  }
  // Before torn ones: two that stand in each other's place are outliers as well, and accuse those around them.
  left = what_is_left();
  for (const auto& [a, b] : find_swapped(left.directions, left.swap_shapes, swap_mask)) {
    for (const auto& [own, other] : {std::pair(a, b), std::pair(b, a)}) {
      inspection.unusable[left.places[own]] =
          name(left.places[own]) + ": it seems swapped with " + name(left.places[other]) +
          ": each fits the pictures around the other's light better than those around its own";
    }
  }
  left = what_is_left();
  for (const Damage& damage : find_damaged(left.directions, left.features, mask)) {
    inspection.unusable[left.places[damage.index]] =
        name(left.places[damage.index]) + (damage.kind == DamageKind::kRows ? ": its rows do" : ": it does") +
        " not fit the pictures of the lights around (" + rounded(damage.ratio) +
        " times their own spread): damaged or mislabelled";
  }
}

// Reads every picture once, so that what is wrong with any of them shows before the store is touched.
Inspection inspect(const PictureSet& set, core::Encoding encoding) {
  Inspection inspection;
  inspection.size = common_size(set, inspection);
  core::Image ambient;
  if (set.ambient) ambient = read_picture(*set.ambient, encoding);
  if (set.mask) inspection.mask = read_mask(*set.mask);

  core::Progress progress("check " + set.source.filename().string(), set.pictures.size());
  std::vector<DamageFeatures> features(set.pictures.size());
  std::vector<core::Image> swap_shapes(set.pictures.size());
  std::mutex mutex;
  std::map<std::size_t, std::string> unreadable;
  core::parallel_for(set.pictures.size(), 1, [&](std::size_t first, std::size_t last) {
    for (std::size_t i = first; i < last; ++i) {
      core::throw_if_interrupted();
      progress.advance();
      if (!inspection.is_readable(i)) continue;
      core::Image image;
      try {
        image = read_picture(set.pictures[i].path, encoding);
      } catch (const core::BadInput& error) {
        const std::lock_guard lock(mutex);
        unreadable.emplace(i, error.what());
        continue;
      }
      subtract_dark(image, ambient);
      divide_by_gain(image, set.pictures[i].intensity);
      features[i] = {thumbnail(image, kDamageSide), row_detail(image, kDetailSide)};
      swap_shapes[i] = thumbnail(image, kShapeSide);
    }
  });
  for (const auto& [place, reason] : unreadable) {
    inspection.unusable[place] = reason;
    inspection.unreadable.insert(place);
  }
  require_few_unreadable(set, inspection);
  find_unfit(set, features, swap_shapes, inspection);
  return inspection;
}

std::vector<CalibratedLight> calibration_of(const PictureSet& set, const Inspection& inspection) {
  std::vector<CalibratedLight> lights;
  for (std::size_t i = 0; i < set.pictures.size(); ++i) {
    CalibratedLight entry;
    entry.light_index = int(i);
    entry.light.direction = set.pictures[i].direction;
    entry.light.gain = set.pictures[i].intensity;
    if (const auto found = inspection.unusable.find(i); found != inspection.unusable.end()) {
      entry.placed = false;
      entry.reason = found->second;
    }
    lights.push_back(std::move(entry));
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

NewScan scan_of(const PictureSet& set, const Inspection& inspection, const std::string& name, core::Encoding encoding) {
  NewScan scan;
  scan.name = name;
  scan.kind = ScanKind::kImported;
  scan.stage_key = "scan:" + name;
  scan.cameras = {kCamera};
  for (std::size_t i = 0; i < set.pictures.size(); ++i) {
    if (!inspection.is_readable(i)) continue;
    scan.steps.push_back({.step_index = int(scan.steps.size()), .kind = StepKind::kLight, .light_index = int(i)});
  }
  if (set.ambient) scan.steps.push_back({.step_index = int(scan.steps.size()), .kind = StepKind::kDark});
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
  const NewScan scan = scan_of(set, inspection, name, stored_as);
  const std::vector<CalibratedLight> lights = calibration_of(set, inspection);

  const std::size_t pictures = set.pictures.size() + (set.ambient ? 1 : 0) + (set.mask ? 1 : 0);
  core::require_room(store.folder(), most_bytes(inspection.size, pictures), "importing '" + name + "'");
  std::vector<ContentHash> objects;
  core::Progress progress("import " + name, set.pictures.size());
  for (std::size_t i = 0; i < set.pictures.size(); ++i) {
    core::throw_if_interrupted();
    progress.advance();
    if (inspection.is_readable(i)) objects.push_back(store.put_object(read_picture(set.pictures[i].path, stored_as)));
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
