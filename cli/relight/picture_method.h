// By what the pictures of a command are made: a method of model/method_info.h or, for a virtual scan that was packed, its pack.
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include "cli/jobs/light_pack.h"
#include "cli/jobs/method_options.h"
#include "db/scan_loader.h"
#include "db/store.h"

namespace lightstage::cli {

class PictureMethod {
 public:
  // With `linear_light` the method takes linear values: environments are sums of very many lights, and only light adds up, not display values. Throws as
  // takes_pack and resolve.
  PictureMethod(const MethodChoice& asked, const db::Store& store, const db::Scan& scan, bool linear_light);

  const std::string& name() const { return choice_.method; }
  const std::filesystem::path& model_file() const { return choice_.options.model_file; }
  const std::optional<PackInfo>& pack() const { return pack_; }

  // What of it decides how a picture looks; hashes the model file.
  nlohmann::ordered_json json() const;
  // The products that a picture is made from.
  std::vector<db::Id> inputs(const db::LoadedScan& scan) const;
  // Throws what loading a pack or model throws.
  std::unique_ptr<model::LightInterpolator> interpolator(const db::Store& store, const db::LoadedScan& scan) const;

 private:
  db::Id scan_id_;
  std::optional<PackInfo> pack_;
  MethodChoice choice_;
};

}  // namespace lightstage::cli
