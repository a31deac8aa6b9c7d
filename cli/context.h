// What every command needs: the store, where results go, and whether they are wanted as JSON.
#pragma once

#include <filesystem>
#include <iosfwd>
#include <string>

#include <nlohmann/json_fwd.hpp>

#include "db/store.h"

namespace lightstage::cli {

class Context {
 public:
  explicit Context(std::ostream& out) : out_(out) {}

  std::filesystem::path store_folder;  // --store, else $LIGHTSTAGE_STORE, else ./store
  bool json = false;                   // --json
  bool quiet = false;                  // --quiet
  int threads = 0;                     // --threads; 0: as many as this process may use

  // A stranger's store may be given to any command, so what it says is looked over first.
  db::Store open_store() const {
    db::Store store = db::Store::open(store_folder);
    store.require_sound_catalogue();
    return store;
  }

  // A command's result: `text` for people, or `object` on one line with --json. Progress and warnings go to stderr.
  void result(const std::string& text, const nlohmann::ordered_json& object) const;

  std::ostream& out() const { return out_; }

 private:
  std::ostream& out_;
};

}  // namespace lightstage::cli
