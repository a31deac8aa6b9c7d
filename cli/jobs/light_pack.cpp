#include "cli/jobs/light_pack.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <set>

#include <nlohmann/json.hpp>

#include "cli/options.h"
#include "core/error.h"
#include "core/parallel.h"

namespace lightstage::cli {

namespace {

constexpr const char* kKind = "light_pack";
constexpr const char* kBasis = "basis";  // index k; its value is the factor of its coefficients
constexpr const char* kCoefficients =
    "coefficients";  // 2 rank x lights: what half floats hold of each basis picture's, and of the rest
constexpr int kFormat = 1;
constexpr int kLargestExponent = 15;  // of what is stored: half floats reach to 2^16

core::StoreError broken(const db::Store& store, const db::Product& product, const std::string& problem) {
  return core::StoreError(store.folder().string() + ": light_pack (product " + std::to_string(product.id) + ") " +
                          problem + "; make it again with `lightstage superres ... --compress`");
}

std::uintmax_t bytes_of(const db::Store& store, const std::vector<db::ProductImage>& images) {
  std::set<std::string> files;  // equal pictures are one object
  for (const db::ProductImage& image : images) files.insert(store.object_path(image.object).string());
  std::uintmax_t bytes = 0;
  for (const std::string& file : files) {
    std::error_code missing;
    const std::uintmax_t size = std::filesystem::file_size(file, missing);
    if (!missing) bytes += size;
  }
  return bytes;
}

PackInfo info_of(const db::Store& store, const db::Product& product) {
  try {
    const auto json = nlohmann::json::parse(product.parameters);
    if (json.value("format", 0) != kFormat)
      throw broken(store, product, "was written by another version of this program");
    return {.id = product.id,
            .asked_error = json.at("asked_error").get<double>(),
            .rank = json.at("rank").get<std::size_t>(),
            .errors = {json.at("error").get<double>(), json.at("largest_light_error").get<double>(),
                       json.at("display_error").get<double>()},
            .bytes = bytes_of(store, product.images)};
  } catch (const nlohmann::json::exception&) {
    throw broken(store, product, "does not say what it is");
  }
}

// The power of two by which values up to `largest` are divided for half floats.
double stored_factor(double largest) {
  int exponent = 0;
  std::frexp(largest, &exponent);
  return std::ldexp(1.0, exponent - kLargestExponent);
}

// Rows of what half floats keep of each basis picture's coefficients, divided by their factor, over rows of what that leaves: 20 binary digits together.
core::Image coefficient_rows(const relight::LightPack& pack, std::size_t lights, std::vector<double>& factors) {
  const std::size_t rank = pack.rank();
  core::Image rows(int(2 * rank), int(lights), 1);
  for (std::size_t k = 0; k < rank; ++k) {
    double largest = 0;
    for (std::size_t i = 0; i < lights; ++i) largest = std::max(largest, std::abs(pack.coefficients[i * rank + k]));
    factors.push_back(stored_factor(largest));
    for (std::size_t i = 0; i < lights; ++i) {
      const double value = pack.coefficients[i * rank + k] / factors[k];
      constexpr double kStep = 64;  // of 2^15: nine digits, exact in half floats; eleven follow
      const double coarse = std::nearbyint(value / kStep) * kStep;
      rows(int(k), int(i)) = float(coarse);
      rows(int(rank + k), int(i)) = float(value - coarse);
    }
  }
  return rows;
}

const db::ProductImage* find_image(const db::Product& product, const std::string& role, int index) {
  const auto found = std::find_if(product.images.begin(), product.images.end(), [&](const db::ProductImage& image) {
    return image.role == role && image.index == index;
  });
  return found == product.images.end() ? nullptr : &*found;
}

}  // namespace

PackInfo store_pack(db::Store& store, const db::LoadedScan& scan, db::Id scan_id, const relight::LightPack& pack,
                    double asked_error) {
  const std::size_t lights = scan.scan.light_count();
  db::NewProduct product;
  product.kind = kKind;
  product.scan_id = scan_id;
  product.input_scans = {scan_id};
  product.input_products = scan.products();
  product.parameters = json_text({{"format", kFormat},
                                  {"asked_error", asked_error},
                                  {"lights", lights},
                                  {"rank", pack.rank()},
                                  {"error", pack.errors.relative},
                                  {"largest_light_error", pack.errors.largest_light},
                                  {"display_error", pack.errors.display}});
  std::vector<double> factors;
  if (pack.rank() > 0) {
    const core::Image rows = coefficient_rows(pack, lights, factors);
    product.images.push_back({.role = kCoefficients, .index = 0, .object = store.put_object(rows)});
  }
  for (std::size_t k = 0; k < pack.rank(); ++k) {
    const core::Image picture = relight::unmasked(pack.basis[k], scan.scan.mask());
    product.images.push_back(
        {.role = kBasis, .index = int(k), .object = store.put_object(picture), .value = factors[k]});
  }
  store.add_product(product);
  return *find_pack(store, scan_id);
}

std::optional<PackInfo> find_pack(const db::Store& store, db::Id scan_id) {
  const auto product = store.newest_product(kKind, scan_id);
  return product ? std::optional(info_of(store, *product)) : std::nullopt;
}

std::unique_ptr<relight::PackedScan> load_pack(const db::Store& store, const db::LoadedScan& scan, db::Id scan_id) {
  const auto product = store.newest_product(kKind, scan_id);
  if (!product) throw core::StoreError("scan '" + scan.scan.name() + "' has no pack");
  const PackInfo info = info_of(store, *product);
  if (info.rank > product->images.size()) throw broken(store, *product, "lacks basis pictures");
  const std::size_t lights = scan.scan.light_count();
  relight::LightPack pack;
  pack.errors = info.errors;
  pack.basis.resize(info.rank);
  pack.coefficients.resize(info.rank * lights);
  std::vector<const db::ProductImage*> images;
  for (std::size_t k = 0; k < info.rank; ++k) {
    images.push_back(find_image(*product, kBasis, int(k)));
    if (images.back() == nullptr) throw broken(store, *product, "lacks basis picture " + std::to_string(k));
  }
  const core::ImageSize size = scan.scan.image_size();
  core::parallel_for(info.rank, 1, [&](std::size_t first, std::size_t last) {
    for (std::size_t k = first; k < last; ++k) {
      const core::Image picture = store.object(images[k]->object);
      if (picture.height() != size.height || picture.width() != size.width)
        throw broken(store, *product, "is of pictures of another size");
      pack.basis[k] = relight::masked_pixels(picture, scan.scan.mask());
    }
  });
  if (info.rank > 0) {
    const db::ProductImage* image = find_image(*product, kCoefficients, 0);
    if (image == nullptr) throw broken(store, *product, "lacks its coefficients");
    const core::Image rows = store.object(image->object);
    if (rows.size() != core::ImageSize{int(2 * info.rank), int(lights), 1})
      throw broken(store, *product, "is of another number of lights");
    for (std::size_t k = 0; k < info.rank; ++k)
      for (std::size_t i = 0; i < lights; ++i)
        pack.coefficients[i * info.rank + k] =
            images[k]->value * (double(rows(int(k), int(i))) + double(rows(int(info.rank + k), int(i))));
  }
  return std::make_unique<relight::PackedScan>(std::move(pack), scan.scan);
}

bool takes_pack(const MethodChoice& choice, const db::Store& store, const db::Scan& scan) {
  const bool knobs = !choice.model.empty() || !choice.knobs.empty();
  const bool has_pack = store.newest_product(kKind, scan.id).has_value();
  if (choice.method != "pack") return (choice.method.empty() || choice.method == "auto") && !knobs && has_pack;
  if (!has_pack)
    throw core::UsageError("scan '" + scan.name +
                           "' has no pack; `lightstage superres SCAN --compress --out NEW` makes a virtual scan that "
                           "has one, or packs the scan NEW that it made before");
  if (knobs) throw core::UsageError("a pack has no knobs: its pictures were made when the scan was");
  return true;
}

nlohmann::ordered_json to_json(const PackInfo& pack) {
  return {{"asked_error", pack.asked_error},      {"rank", pack.rank},
          {"error", pack.errors.relative},        {"largest_light_error", pack.errors.largest_light},
          {"display_error", pack.errors.display}, {"bytes", pack.bytes}};
}

}  // namespace lightstage::cli
