#include "cli/relight/picture_files.h"

#include <algorithm>
#include <cstdint>

#include "cli/jobs/stored_json.h"
#include "cli/options.h"
#include "core/error.h"
#include "core/version.h"
#include "db/content_hash.h"

namespace lightstage::cli {

namespace {

using nlohmann::ordered_json;

// As it stands in the store, where names that are not UTF-8 cannot.
std::string name_on_record(const std::filesystem::path& file) {
  const std::string name = std::filesystem::absolute(file).lexically_normal().string();
  return ordered_json::parse(json_text(name)).get<std::string>();
}

}  // namespace

PicturePlace::PicturePlace(const std::filesystem::path& out, std::size_t pictures) : out_(out) {
  is_folder_ = !out.has_filename() || std::filesystem::is_directory(out) || (pictures > 1 && !out.has_extension());
  if (is_folder_) return;
  if (pictures > 1)
    throw core::UsageError("--out: " + std::to_string(pictures) + " pictures need a folder; write '" +
                           std::filesystem::path(out).replace_extension().string() + "/'");
  if (out.extension() != ".exr")
    throw core::UsageError("--out: '" + out.string() + "' must end in .exr, or in / for a folder");
}

std::filesystem::path PicturePlace::folder() const {
  if (is_folder_) return out_;
  return out_.has_parent_path() ? out_.parent_path() : ".";
}

std::filesystem::path PicturePlace::file(const Sequence& sequence, int frame) const {
  if (!is_folder_) return out_;
  std::string name = sequence.stem;
  if (sequence.rig.frames > 1) {
    const std::string number = std::to_string(frame);
    const std::size_t digits = std::max<std::size_t>(4, std::to_string(sequence.rig.frames - 1).size());
    name += "_" + std::string(digits - number.size(), '0') + number;
  }
  return out_ / (name + ".exr");
}

PictureFiles::PictureFiles(db::Store& store, const db::Scan& scan, std::vector<db::Id> input_products,
                           const std::filesystem::path& folder)
    : store_(store) {
  product_.kind = "picture";
  product_.scan_id = scan.id;
  product_.input_scans = {scan.id};
  product_.input_products = std::move(input_products);
  const std::string below = name_on_record(folder / "");
  for (const db::Product& product : store.products("picture")) {
    if (product.scan_id != scan.id) continue;
    const auto parameters = ordered_json::parse(product.parameters, nullptr, /*allow_exceptions=*/false);
    if (!parameters.is_object() || !parameters.contains("recipe") || !parameters.contains("file_hash")) continue;
    reading_json("picture " + std::to_string(product.id), [&] {
      const std::string file = parameters.value("file", std::string());
      if (!file.starts_with(below)) return;
      entries_.emplace(file, Entry{parameters.value("file_hash", std::string()),
                                   making(parameters.at("recipe"), product, product.program_version),
                                   parameters.value("stops", 0.0)});
    });
  }
}

db::ContentHash PictureFiles::making(const ordered_json& recipe, const db::NewProduct& inputs,
                                     const std::string& version) const {
  const std::string text = json_text({recipe, *inputs.scan_id, inputs.input_scans, inputs.input_products, version});
  return db::hash_bytes({reinterpret_cast<const std::uint8_t*>(text.data()), text.size()});
}

std::optional<double> PictureFiles::made_already(const std::filesystem::path& exr, const ordered_json& recipe) const {
  const std::filesystem::path png = relight::picture_files(exr).png;
  if (!std::filesystem::exists(exr)) {
    // Where this program was killed between the two files, or an .exr was removed, the picture is on record.
    if (std::filesystem::exists(png) && !entries_.contains(name_on_record(exr)))
      throw core::UsageError(png.string() + " was not made by this command; remove it, or choose another --out");
    return std::nullopt;
  }
  const db::ContentHash wanted = making(recipe, product_, core::kVersion);
  const std::string hash = db::hash_file(exr).hex();
  const auto [first, last] = entries_.equal_range(name_on_record(exr));
  for (auto entry = first; entry != last; ++entry) {
    if (entry->second.file_hash != hash || entry->second.making != wanted) continue;
    if (!std::filesystem::exists(png)) return std::nullopt;
    return entry->second.stops;
  }
  throw core::UsageError(exr.string() +
                         " was made in another way than is asked for now, or changed since; remove it to " +
                         "have it made again, or choose another --out");
}

relight::WrittenPicture PictureFiles::write(const std::filesystem::path& exr, core::ImageView linear, double stops,
                                            const ordered_json& recipe, const ordered_json& origin) {
  return relight::write_picture(exr, linear, stops, [&](const std::filesystem::path& written) {
    db::NewProduct picture = product_;
    ordered_json parameters{{"file", std::filesystem::absolute(exr).lexically_normal().string()},
                            {"file_hash", db::hash_file(written).hex()},
                            {"stops", stops}};
    parameters.update(origin);
    parameters["recipe"] = recipe;
    picture.parameters = json_text(parameters);
    store_.add_product(picture);
  });
}

}  // namespace lightstage::cli
