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
    state.scans_done = json.at("scans_done").get<std::set<Id>>();
    state.report.frames = json.at("frames").get<std::size_t>();
    state.report.errors = json.at("errors").get<std::vector<std::string>>();
    return state;
  } catch (const core::BadInput&) {
  } catch (const nlohmann::json::exception&) {
  }
  return std::nullopt;
}

void write_verify_state(const fs::path& store_folder, const VerifyState& state) {
  const nlohmann::json json{
      {"scans_done", state.scans_done}, {"frames", state.report.frames}, {"errors", state.report.errors}};
  // A link that came with a stranger's store would be written through.
  std::error_code none;
  if (fs::is_symlink(state_path(store_folder), none)) fs::remove(state_path(store_folder), none);
  try {
    core::write_file_atomically(state_path(store_folder),
                                json.dump(1, ' ', true, nlohmann::json::error_handler_t::replace) + "\n");
  } catch (const core::BadInput&) {
  }
}

void remove_verify_state(const fs::path& store_folder) {
  std::error_code ignored;
  fs::remove(state_path(store_folder), ignored);
}

}  // namespace lightstage::db
