#include "db/store/verify_state.h"

#include <nlohmann/json.hpp>

#include "core/error.h"
#include "core/file.h"

namespace lightstage::db {

namespace fs = std::filesystem;

namespace {

fs::path state_path(const fs::path& store_folder) {
  return store_folder / "verify.json";
}

}  // namespace

std::optional<VerifyState> read_verify_state(const fs::path& store_folder) {
  try {
    const auto json = nlohmann::json::parse(core::read_text_file(state_path(store_folder)));
    VerifyState state;
    state.store_id = json.at("store").get<std::string>();
    for (const auto& scan : json.at("sound")) {
      state.sound.emplace(scan.at("scan").get<Id>(), ContentHash::from_hex(scan.at("contents").get<std::string>()));
    }
    return state;
  } catch (const core::BadInput&) {
  } catch (const core::StoreError&) {
  } catch (const nlohmann::json::exception&) {
  }
  return std::nullopt;
}

void write_verify_state(const fs::path& store_folder, const VerifyState& state) {
  nlohmann::json json{{"store", state.store_id}, {"sound", nlohmann::json::array()}};
  for (const auto& [id, contents] : state.sound) json["sound"].push_back({{"scan", id}, {"contents", contents.hex()}});
  // A link that came with a stranger's store would be written through.
  std::error_code none;
  if (fs::is_symlink(state_path(store_folder), none)) fs::remove(state_path(store_folder), none);
  try {
    core::write_file_atomically(state_path(store_folder), json.dump(1) + "\n");
  } catch (const core::BadInput&) {
  }
}

void remove_verify_state(const fs::path& store_folder) {
  std::error_code ignored;
  fs::remove(state_path(store_folder), ignored);
}

}  // namespace lightstage::db
