// The log that a crash has left beside a catalogue, with bytes of it changed.
#include <fstream>
#include <iterator>
#include <string>
#include <vector>

#include "core/error.h"
#include "db/store.h"
#include "db/store/catalogue.h"
#include "db/store/log_damage.h"
#include "fuzz/target.h"

namespace lightstage::fuzz {

namespace {

namespace fs = std::filesystem;

std::string bytes_of(const fs::path& file) {
  std::ifstream stream(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(stream), {}};
}

// A catalogue with several transactions that stand in its log alone, as a killed program leaves it.
struct Left {
  std::string catalogue, log;
};
const Left& left() {
  static const Left files = [] {
    const fs::path folder = scratch() / "written";
    fs::remove_all(folder);
    db::Store store = db::Store::create(folder);
    for (int i = 0; i < 8; ++i) {
      store.add_product({.kind = "colour", .stage_key = "tiny", .parameters = std::string(std::size_t(i) * 1000, ' ')});
    }
    return Left{bytes_of(db::catalogue_path(folder)), bytes_of(db::log_path(folder))};
  }();
  return files;
}

bool is_refused(const fs::path& folder) {
  try {
    db::refuse_damaged_log(folder);
    return false;
  } catch (const core::StoreError&) {
    return true;
  }
}

// Patches: an offset of three bytes, a length, and so many bytes to change by exclusive or, so that an unchanged bit is a zero. A length of 255 cuts the log there.
const Registration kLog({"log",
                         [](Bytes bytes) {
                           std::string log = left().log;
                           Input input(bytes);
                           while (!input.empty() && !log.empty()) {
                             const std::size_t at = input.number(3) % log.size();
                             const std::size_t length = input.byte();
                             if (length == 255) log.resize(at);
                             const Bytes patch = input.take(length % 64 + 1);
                             for (std::size_t i = 0; i < patch.size() && at + i < log.size(); ++i) {
                               log[at + i] = char(log[at + i] ^ char(patch[i]));
                             }
                           }
                           const fs::path folder = scratch() / "left";
                           fs::remove_all(folder);
                           fs::create_directories(folder);
                           write(db::catalogue_path(folder), left().catalogue);
                           write(db::log_path(folder), log);
                           const bool damaged = is_refused(folder);
                           const db::LogRepair repair = db::repair_log(folder);
                           require(damaged == !repair.damaged_copy.empty(),
                                   "what is refused is repaired, and nothing else");
                           require(!is_refused(folder), "a repaired log is not refused");
                           require(
                               damaged ? bytes_of(repair.damaged_copy) == log : bytes_of(db::log_path(folder)) == log,
                               "what was there is kept");
                         },
                         1024, 20});

}  // namespace

}  // namespace lightstage::fuzz
