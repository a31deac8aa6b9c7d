#include "cli/relight/picture_method.h"

#include "db/content_hash.h"

namespace lightstage::cli {

PictureMethod::PictureMethod(const MethodChoice& asked, const db::Store& store, const db::Scan& scan, bool linear_light)
    : scan_id_(scan.id) {
  if (takes_pack(asked, store, scan)) {
    pack_ = find_pack(store, scan.id);
    choice_.method = "pack";
    return;
  }
  choice_ = resolve(asked, store, scan.id);
  if (linear_light) {
    choice_.options.domain = model::Domain::kLinear;
    choice_.knobs["--domain"] = "linear";
  }
}

nlohmann::ordered_json PictureMethod::json() const {
  const std::filesystem::path& model = model_file();
  nlohmann::ordered_json json{
      {"method", name()},
      {"knobs", pack_ ? nlohmann::ordered_json::object() : knob_values(choice_)},
      {"model_hash", model.empty() ? "" : db::hash_file(model).hex()},
  };
  if (pack_) json["pack"] = pack_->id;
  return json;
}

std::vector<db::Id> PictureMethod::inputs(const db::LoadedScan& scan) const {
  std::vector<db::Id> products = scan.products();
  if (pack_) products.push_back(pack_->id);
  return products;
}

std::unique_ptr<model::LightInterpolator> PictureMethod::interpolator(const db::Store& store,
                                                                      const db::LoadedScan& scan) const {
  if (pack_) return load_pack(store, scan, scan_id_);
  return model::make_interpolator(choice_.method, scan.scan, choice_.options);
}

}  // namespace lightstage::cli
