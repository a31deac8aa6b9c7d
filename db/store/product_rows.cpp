// Store: products, calibrations among them.
#include <set>

#include "core/clock.h"
#include "core/error.h"
#include "core/version.h"
#include "db/store/impl.h"

namespace lightstage::db {
namespace {

constexpr const char* kProductColumns =
    "SELECT id, kind, name, scan_id, stage_key, parameters, created_utc, program_version FROM products ";

bool is_finite(core::Vec3 v) {
  return std::isfinite(v.x) && std::isfinite(v.y) && std::isfinite(v.z);
}

void check_lights(const std::vector<CalibratedLight>& lights) {
  std::set<int> seen;
  for (const CalibratedLight& light : lights) {
    const std::string place = "calibration, light " + std::to_string(light.light_index) + ": ";
    if (light.light_index < 0) throw core::BadInput(place + "lights count from 0");
    if (!seen.insert(light.light_index).second) throw core::BadInput(place + "listed twice");
    if (light.light.position && !is_finite(*light.light.position))
      throw core::BadInput(place + "its position is not finite");
    for (const double gain : light.light.gain) {
      // Images are divided by it.
      if (!std::isfinite(gain) || gain <= 0) throw core::BadInput(place + "its gain is not a positive number");
    }
    if (!std::isfinite(light.sigma_degrees) || light.sigma_degrees < 0) {
      throw core::BadInput(place + "its sigma is not a number >= 0");
    }
  }
}

std::vector<Id> read_ids(SQLite::Statement row) {
  std::vector<Id> ids;
  while (row.executeStep()) ids.push_back(row.getColumn(0).getInt64());
  return ids;
}

}  // namespace

Id Store::add_product(const NewProduct& product) {
  const std::string what = product.kind + " '" + product.name + "'";
  if (product.kind.empty()) throw core::BadInput("a product needs a kind");
  require_json(json_or_empty(product.parameters), what + ": its parameters");
  for (const ProductImage& image : product.images) {
    if (!std::isfinite(image.value)) {
      throw core::BadInput(what + ", image '" + image.role + "' " + std::to_string(image.index) +
                           ": its value is not finite");
    }
  }
  return impl_->write([&] {
    if (!product.name.empty() && this->product(product.kind, product.name)) {
      throw core::UsageError(folder().string() + ": there is a " + what + " already; choose another name");
    }
    impl_->change(
        "INSERT INTO products (kind, name, scan_id, stage_key, parameters, created_utc, program_version) "
        "VALUES (?, ?, ?, ?, ?, ?, ?)",
        product.kind, product.name, product.scan_id, product.stage_key, json_or_empty(product.parameters),
        core::utc_timestamp(), std::string_view(core::kVersion));
    const Id id = impl_->database.getLastInsertRowid();
    for (std::size_t i = 0; i < product.input_scans.size(); ++i) {
      impl_->change("INSERT INTO product_input_scans (product_id, position, scan_id) VALUES (?, ?, ?)", id, int(i),
                    product.input_scans[i]);
    }
    for (std::size_t i = 0; i < product.input_products.size(); ++i) {
      impl_->change("INSERT INTO product_input_products (product_id, position, input_id) VALUES (?, ?, ?)", id, int(i),
                    product.input_products[i]);
    }
    for (const ProductImage& image : product.images) {
      impl_->know_object(image.object);
      impl_->change("INSERT INTO product_images (product_id, role, image_index, object, value) VALUES (?, ?, ?, ?, ?)",
                    id, image.role, image.index, image.object, image.value);
    }
    return id;
  });
}

Id Store::add_calibration(const NewProduct& product, const std::vector<CalibratedLight>& lights) {
  if (product.kind != "calibration") throw core::BadInput("a product of kind '" + product.kind + "' is no calibration");
  check_lights(lights);
  return impl_->write([&] {
    const Id id = add_product(product);
    SQLite::Statement insert(
        impl_->database,
        "INSERT INTO calibrated_lights (product_id, light_index, placed, direction_x, direction_y, "
        "direction_z, "
        "position_x, position_y, position_z, gain_r, gain_g, gain_b, sigma_degrees, reason) "
        "VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)");
    for (const CalibratedLight& entry : lights) {
      const core::Direction& direction = entry.light.direction;
      const auto& position = entry.light.position;
      const auto coordinate = [&](double core::Vec3::*axis) {
        return position ? std::optional<double>((*position).*axis) : std::nullopt;
      };
      const auto& gain = entry.light.gain;
      bind_all(insert, id, entry.light_index, int(entry.placed), direction.x(), direction.y(), direction.z(),
               coordinate(&core::Vec3::x), coordinate(&core::Vec3::y), coordinate(&core::Vec3::z), gain[0], gain[1],
               gain[2], entry.sigma_degrees, entry.reason);
      insert.exec();
      insert.reset();
    }
    return id;
  });
}

Product Store::Impl::product_from(SQLite::Statement& row) const {
  Product product;
  product.id = row.getColumn(0).getInt64();
  product.kind = row.getColumn(1).getString();
  product.name = row.getColumn(2).getString();
  if (!row.getColumn(3).isNull()) product.scan_id = row.getColumn(3).getInt64();
  product.stage_key = row.getColumn(4).getString();
  const std::string place = folder.string() + ": product " + std::to_string(product.id) + ": ";
  product.parameters = shallow_json(row.getColumn(5).getString(), place + "its parameters");
  product.created_utc = row.getColumn(6).getString();
  product.program_version = row.getColumn(7).getString();
  product.input_scans =
      read_ids(query("SELECT scan_id FROM product_input_scans WHERE product_id = ? ORDER BY position", product.id));
  product.input_products =
      read_ids(query("SELECT input_id FROM product_input_products WHERE product_id = ? ORDER BY position", product.id));
  auto images = query(
      "SELECT role, image_index, object, value FROM product_images WHERE product_id = ? ORDER BY role, "
      "image_index",
      product.id);
  while (images.executeStep()) {
    product.images.push_back({images.getColumn(0).getString(), int_at(images, 1, place + "image"),
                              ContentHash::from_hex(images.getColumn(2).getString()), images.getColumn(3).getDouble()});
  }
  return product;
}

template <class... Values>
std::optional<Product> Store::Impl::first_product(const std::string& condition, const Values&... values) const {
  return explaining(folder, [&]() -> std::optional<Product> {
    auto row = query((kProductColumns + condition).c_str(), values...);
    if (!row.executeStep()) return std::nullopt;
    return product_from(row);
  });
}

std::vector<Product> Store::products(std::string_view kind) const {
  return explaining(folder(), [&] {
    std::vector<Product> all;
    auto row = impl_->query((std::string(kProductColumns) + "WHERE kind = ? ORDER BY id").c_str(), kind);
    while (row.executeStep()) all.push_back(impl_->product_from(row));
    return all;
  });
}

std::optional<Product> Store::newest_product(std::string_view kind, Id scan_id) const {
  return impl_->first_product("WHERE kind = ? AND scan_id = ? ORDER BY id DESC LIMIT 1", kind, scan_id);
}

std::optional<Product> Store::newest_product(std::string_view kind, const Scan& scan, std::string_view camera) const {
  if (scan.cameras.empty()) return std::nullopt;
  return impl_->first_product(
      "WHERE kind = ? AND scan_id = ? AND coalesce(json_extract(parameters, '$.camera'), ?) = ? ORDER BY id "
      "DESC LIMIT 1",
      kind, scan.id, scan.cameras.front(), camera);
}

std::optional<Product> Store::product(std::string_view kind, std::string_view name) const {
  if (name.empty()) return std::nullopt;
  return impl_->first_product("WHERE kind = ? AND name = ?", kind, name);
}

std::optional<Product> Store::newest_calibration(std::string_view stage_key) const {
  return impl_->first_product("WHERE kind = 'calibration' AND stage_key = ? ORDER BY id DESC LIMIT 1", stage_key);
}

std::optional<Product> Store::newest_of_camera(std::string_view kind, std::string_view stage_key,
                                               std::string_view camera) const {
  return impl_->first_product(
      "WHERE kind = ? AND stage_key = ? AND coalesce(json_extract(parameters, '$.camera'), ?) = ? ORDER BY id "
      "DESC LIMIT 1",
      kind, stage_key, camera, camera);
}

std::vector<CalibratedLight> Store::calibrated_lights(Id calibration_id) const {
  return explaining(folder(), [&] {
    std::vector<CalibratedLight> lights;
    auto row = impl_->query(
        "SELECT light_index, placed, direction_x, direction_y, direction_z, position_x, position_y, "
        "position_z, "
        "gain_r, gain_g, gain_b, sigma_degrees, reason FROM calibrated_lights WHERE product_id = ? ORDER BY "
        "light_index",
        calibration_id);
    const auto vector_at = [&](int column) {
      return core::Vec3{row.getColumn(column).getDouble(), row.getColumn(column + 1).getDouble(),
                        row.getColumn(column + 2).getDouble()};
    };
    const std::string place = folder().string() + ": calibration " + std::to_string(calibration_id) + ": ";
    while (row.executeStep()) {
      CalibratedLight entry;
      entry.light_index = int_at(row, 0, place + "light");
      entry.placed = row.getColumn(1).getInt() != 0;
      try {
        entry.light.direction = core::Direction::from_vector(vector_at(2));
      } catch (const core::BadInput& error) {
        throw core::StoreError(place + "light " + std::to_string(entry.light_index) + ": " + error.what());
      }
      if (!row.getColumn(5).isNull()) entry.light.position = vector_at(5);
      const core::Vec3 gain = vector_at(8);
      entry.light.gain = {gain.x, gain.y, gain.z};
      entry.sigma_degrees = row.getColumn(11).getDouble();
      entry.reason = row.getColumn(12).getString();
      lights.push_back(std::move(entry));
    }
    try {
      check_lights(lights);
    } catch (const core::BadInput& error) {
      throw core::StoreError(folder().string() + ": " + error.what());
    }
    return lights;
  });
}

}  // namespace lightstage::db
