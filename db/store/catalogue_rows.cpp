#include "db/store/catalogue_rows.h"

#include <algorithm>
#include <map>
#include <optional>
#include <set>

#include <SQLiteCpp/Exception.h>
#include <SQLiteCpp/Statement.h>
#include <sqlite3.h>

#include "core/error.h"
#include "core/interrupt.h"
#include "core/text.h"
#include "db/store.h"

namespace lightstage::db {

namespace {

using Columns = std::vector<std::string>;

struct Table {
  const char* name;
  const char* index;  // one that knows of every row
  const char* keys;   // that are in it
};

// In an order in which nothing refers to a later one.
constexpr Table kTables[] = {
    {"identity", nullptr, nullptr},
    {"objects", "sqlite_autoindex_objects_1", "hash"},
    {"scans", "sqlite_autoindex_scans_1", "name"},
    {"cameras", "sqlite_autoindex_cameras_1", "scan_id, name"},
    {"steps", "sqlite_autoindex_steps_1", "scan_id, step_index"},
    {"frames", "sqlite_autoindex_frames_1", "scan_id, step_index, camera"},
    {"products", "products_by_scan", "id"},
    {"product_input_scans", "sqlite_autoindex_product_input_scans_1", "product_id, position"},
    {"product_input_products", "sqlite_autoindex_product_input_products_1", "product_id, position"},
    {"product_images", "sqlite_autoindex_product_images_1", "product_id, role, image_index"},
    {"calibrated_lights", "sqlite_autoindex_calibrated_lights_1", "product_id, light_index"}};

Columns columns_of(SQLite::Database& database, const std::string& table) {
  Columns names;
  SQLite::Statement row(database, "SELECT name FROM pragma_table_info(?)");
  row.bind(1, table);
  while (row.executeStep()) names.push_back(row.getColumn(0).getString());
  return names;
}

// No table of ours holds blobs.
void bind_column(SQLite::Statement& statement, int at, const SQLite::Column& value) {
  if (value.isInteger()) {
    statement.bind(at, value.getInt64());
  } else if (value.isFloat()) {
    statement.bind(at, value.getDouble());
  } else if (value.isText()) {
    statement.bind(at, value.getString());
  } else {
    statement.bind(at);
  }
}

// Not the fault of what is read: to go on would lose sound rows.
bool is_of_the_machine(const SQLite::Exception& error) {
  switch (error.getErrorCode() & 0xff) {
    case SQLITE_NOMEM:
    case SQLITE_FULL:
    case SQLITE_BUSY:
    case SQLITE_LOCKED:
    case SQLITE_INTERRUPT:
      return true;
    default:
      return error.getExtendedErrorCode() == SQLITE_IOERR_NOMEM;
  }
}

// False where a page could not be read.
template <class Work>
bool reading(const Work& work) {
  try {
    work();
    return true;
  } catch (const SQLite::Exception& error) {
    if (is_of_the_machine(error)) throw;
    return false;
  }
}

// --- copying

// Scans and products of one catalogue that may go into another.
struct Wanted {
  std::set<Id> scans, products;
  std::vector<std::string> clashes;
};

Wanted that_do_not_clash(SQLite::Database& from, SQLite::Database& to) {
  Wanted wanted;
  reading([&] {
    SQLite::Statement scan(from, "SELECT id, name, created_utc FROM scans ORDER BY id");
    SQLite::Statement other(to,
                            "SELECT 1 FROM scans WHERE (id = ?1 OR name = ?2) AND NOT (id = ?1 AND name = ?2 AND "
                            "created_utc = ?3)");
    while (scan.executeStep()) {
      other.reset();
      for (int i = 0; i < 3; ++i) bind_column(other, i + 1, scan.getColumn(i));
      if (!other.executeStep()) {
        wanted.scans.insert(scan.getColumn(0).getInt64());
      } else {
        wanted.clashes.push_back("scan '" + scan.getColumn(1).getString() + "', made " + scan.getColumn(2).getString());
      }
    }
  });
  reading([&] {
    SQLite::Statement product(from, "SELECT id, kind, name, created_utc, scan_id FROM products ORDER BY id");
    SQLite::Statement other(to,
                            "SELECT 1 FROM products WHERE (id = ?1 OR (kind = ?2 AND name = ?3 AND name <> '')) AND "
                            "NOT (id = ?1 AND kind = ?2 AND name = ?3 AND created_utc = ?4)");
    SQLite::Statement scans(from, "SELECT scan_id FROM product_input_scans WHERE product_id = ?");
    SQLite::Statement products(from, "SELECT input_id FROM product_input_products WHERE product_id = ?");
    const auto all_wanted = [&](SQLite::Statement& inputs, const std::set<Id>& known) {
      inputs.reset();
      inputs.bind(1, product.getColumn(0).getInt64());
      while (inputs.executeStep()) {
        if (!known.contains(inputs.getColumn(0).getInt64())) return false;
      }
      return true;
    };
    while (product.executeStep()) {
      const bool hangs_on_unwanted =
          (!product.getColumn(4).isNull() && !wanted.scans.contains(product.getColumn(4).getInt64())) ||
          !all_wanted(scans, wanted.scans) || !all_wanted(products, wanted.products);
      if (hangs_on_unwanted) continue;
      other.reset();
      for (int i = 0; i < 4; ++i) bind_column(other, i + 1, product.getColumn(i));
      if (!other.executeStep()) {
        wanted.products.insert(product.getColumn(0).getInt64());
      } else {
        wanted.clashes.push_back(product.getColumn(1).getString() + " '" + product.getColumn(2).getString() +
                                 "' (product " + product.getColumn(0).getString() + ")");
      }
    }
  });
  return wanted;
}

// One table's rows; what is there already stays.
class RowCopy {
 public:
  // With `wanted` only rows that refer to none but these scans and products; frames, to which nothing refers by their numbers, get new ones then.
  RowCopy(SQLite::Database& from, SQLite::Database& to, const std::string& table, const Wanted* wanted)
      : columns_(columns_of(to, table)),
        read_(from,
              "SELECT rowid, " + core::joined(columns_, ", ") + " FROM " + table + " WHERE rowid >= ? ORDER BY rowid"),
        write_(to, "INSERT OR IGNORE INTO " + table + " (" + core::joined(columns_, ", ") + ") VALUES (" +
                       core::joined(Columns(columns_.size(), "?"), ", ") + ")"),
        renumber_(wanted != nullptr && table == "frames") {
    if (wanted == nullptr) return;
    for (std::size_t i = 0; i < columns_.size(); ++i) {
      const std::string& name = columns_[i];
      const bool scan = name == "scan_id" || (table == "scans" && name == "id");
      const bool product = name == "product_id" || name == "input_id" || (table == "products" && name == "id");
      if (scan || product) references_.emplace_back(int(i) + 1, scan ? &wanted->scans : &wanted->products);
    }
  }

  // Rows on pages that cannot be read are stepped over.
  std::size_t run() {
    Id next = 0;
    while (const std::optional<Id> stuck = run_from(next)) {
      const std::optional<Id> beyond = first_readable_after(*stuck);
      if (!beyond) break;
      next = *beyond;
    }
    return copied_;
  }

 private:
  // The key at which a page could not be read; nothing when all is done.
  std::optional<Id> run_from(Id first) {
    Id next = first;
    const bool done = reading([&] {
      read_.reset();
      read_.bind(1, std::int64_t(first));
      while (read_.executeStep()) {
        core::throw_if_interrupted();
        next = read_.getColumn(0).getInt64() + 1;
        if (wanted()) write_row();
      }
    });
    return done ? std::nullopt : std::optional(next);
  }

  bool wanted() {
    return std::all_of(references_.begin(), references_.end(), [&](const auto& reference) {
      const SQLite::Column value = read_.getColumn(reference.first);
      return value.isNull() || reference.second->contains(value.getInt64());
    });
  }

  void write_row() {
    write_.reset();
    for (int i = 1; i < read_.getColumnCount(); ++i) {
      if (renumber_ && columns_[std::size_t(i) - 1] == "id") {
        write_.bind(i);
      } else {
        bind_column(write_, i, read_.getColumn(i));
      }
    }
    const int result = write_.tryExecuteStep();
    if (result == SQLITE_DONE && write_.getChanges() > 0) ++copied_;
    // A row that breaks the table's rules, or refers to nothing, stays behind.
    if (result != SQLITE_DONE && (result & 0xff) != SQLITE_CONSTRAINT) {
      throw core::StoreError(std::string("rows cannot be written: ") + write_.getErrorMsg());
    }
  }

  bool readable(Id first) {
    return reading([&] {
      read_.reset();
      read_.bind(1, std::int64_t(first));
      read_.executeStep();
    });
  }

  // By steps that double, then halve: a page holds up to some hundred rows.
  std::optional<Id> first_readable_after(Id stuck) {
    constexpr Id kFarthest = Id(1) << 40;
    Id step = 1;
    while (!readable(stuck + step)) {
      step *= 2;
      if (step > kFarthest) return std::nullopt;
    }
    Id unreadable = step / 2;
    while (step - unreadable > 1) {
      const Id middle = unreadable + (step - unreadable) / 2;
      (readable(stuck + middle) ? step : unreadable) = middle;
    }
    return stuck + step;
  }

  Columns columns_;
  SQLite::Statement read_, write_;
  bool renumber_;
  std::vector<std::pair<int, const std::set<Id>*>> references_;
  std::size_t copied_ = 0;
};

std::size_t copy(SQLite::Database& from, SQLite::Database& to, const Wanted* wanted) {
  std::size_t copied = 0;
  for (const Table& table : kTables) {
    // A table that is not there, or where its rows are cannot be read, has none. Objects are counted by what refers to them.
    reading([&] {
      const std::size_t rows = RowCopy(from, to, table.name, wanted).run();
      if (std::string_view(table.name) != "objects") copied += rows;
    });
  }
  return copied;
}

// --- comparing

class Comparison {
 public:
  Comparison(SQLite::Database& from, SQLite::Database& to) : from_(from), to_(to) {}

  void compare_rows() {
    for (const Table& table : kTables) {
      if (!compared(table)) continue;
      Columns columns = columns_of(to_, table.name);
      std::erase_if(columns, [&](const std::string& column) {
        return (std::string_view(table.name) == "frames" && column == "id") || column == "provenance";
      });
      look(table, columns, "");
    }
  }

  void compare_keys() {
    for (const Table& table : kTables) {
      if (!compared(table)) continue;
      Columns keys;
      for (const std::string_view key : core::split(table.keys, ',')) keys.emplace_back(core::trim(key));
      const bool index_read = reading([&] { look(table, keys, std::string(" INDEXED BY ") + table.index); });
      if (!index_read && !all_readable(table)) unreadable_.push_back(table.name);
    }
  }

  std::vector<std::string> lines() {
    std::vector<std::string> lines;
    for (const auto& [id, scan] : scans_) {
      std::string text = name_of(id);
      if (!scan.gone && scan.frames + scan.cameras + scan.steps == 0) continue;
      Columns parts;
      if (scan.frames > 0) {
        parts.push_back(core::counted(scan.frames, "frame") +
                        (scan.gone ? "" : " from step " + std::to_string(scan.first_step) + " on"));
      }
      if (!scan.gone && scan.cameras > 0) parts.push_back(core::counted(scan.cameras, "camera"));
      if (!scan.gone && scan.steps > 0) parts.push_back(core::counted(scan.steps, "step"));
      if (scan.gone) text += " as a whole";
      lines.push_back(text + (parts.empty() ? "" : ": " + core::joined(parts, ", ")));
    }
    for (const auto& [what, count] : others_) lines.push_back(what + ": " + core::counted(count, "row"));
    for (const std::string& table : unreadable_) {
      lines.push_back("table " + table + ": rows that cannot be read, nor how many they are");
    }
    return lines;
  }

 private:
  struct Gone {
    bool gone = false;
    std::size_t frames = 0, cameras = 0, steps = 0;
    std::int64_t first_step = 0;
  };

  static bool compared(const Table& table) {
    return table.index != nullptr && std::string_view(table.name) != "objects";
  }

  void look(const Table& table, const Columns& columns, const std::string& by) {
    SQLite::Statement row(from_, "SELECT rowid, " + core::joined(columns, ", ") + " FROM " + table.name + by);
    std::string same;
    for (std::size_t i = 0; i < columns.size(); ++i) {
      same += (i == 0 ? "" : " AND ") + columns[i] + " IS ?" + std::to_string(i + 1);
    }
    SQLite::Statement there(to_, std::string("SELECT 1 FROM ") + table.name + " WHERE " + same);
    while (row.executeStep()) {
      core::throw_if_interrupted();
      there.reset();
      for (int i = 1; i < row.getColumnCount(); ++i) bind_column(there, i, row.getColumn(i));
      if (!there.executeStep()) note(table.name, row, columns);
    }
  }

  void note(const std::string& table, SQLite::Statement& row, const Columns& columns) {
    const auto value = [&](std::string_view column) {
      const auto at = std::find(columns.begin(), columns.end(), column);
      return row.getColumn(int(at - columns.begin()) + 1).getInt64();
    };
    if (table == "scans") {
      scans_[row.getColumn(0).getInt64()].gone = true;
    } else if (table == "cameras") {
      ++scans_[value("scan_id")].cameras;
    } else if (table == "steps") {
      ++scans_[value("scan_id")].steps;
    } else if (table == "frames") {
      Gone& scan = scans_[value("scan_id")];
      const std::int64_t step = value("step_index");
      scan.first_step = scan.frames++ == 0 ? step : std::min(scan.first_step, step);
    } else if (table == "products") {
      products_.insert(row.getColumn(0).getInt64());
      ++others_["products"];
    } else if (!products_.contains(value("product_id"))) {
      ++others_[table];
    }
  }

  bool all_readable(const Table& table) {
    return reading([&] {
      SQLite::Statement row(from_, std::string("SELECT * FROM ") + table.name);
      while (row.executeStep()) continue;
    });
  }

  std::string name_of(Id scan) {
    std::string name = "scan number " + std::to_string(scan);
    const auto ask = [&](SQLite::Database& database, const std::string& by) {
      return reading([&] {
        SQLite::Statement row(database, "SELECT rowid, name FROM scans" + by);
        bool found = false;
        while (!found && row.executeStep()) {
          found = row.getColumn(0).getInt64() == scan;
          if (found) name = "scan '" + row.getColumn(1).getString() + "'";
        }
        if (!found) throw SQLite::Exception("no such scan");
      });
    };
    if (!ask(from_, " INDEXED BY sqlite_autoindex_scans_1")) ask(to_, "");
    return name;
  }

  SQLite::Database& from_;
  SQLite::Database& to_;
  std::map<Id, Gone> scans_;
  std::set<Id> products_;
  std::map<std::string, std::size_t> others_;
  std::vector<std::string> unreadable_;
};

}  // namespace

std::string store_id(SQLite::Database& database) {
  std::string id;
  reading([&] { id = database.execAndGet("SELECT store_id FROM identity").getString(); });
  return id;
}

std::size_t copy_readable_rows(SQLite::Database& from, SQLite::Database& to) {
  if (!store_id(from).empty()) to.exec("DELETE FROM identity");
  return copy(from, to, nullptr);
}

AddedRows add_missing_rows(SQLite::Database& from, SQLite::Database& to) {
  Wanted wanted = that_do_not_clash(from, to);
  AddedRows added;
  added.count = copy(from, to, &wanted);
  added.clashes = std::move(wanted.clashes);
  return added;
}

std::vector<std::string> missing_rows(SQLite::Database& from, SQLite::Database& to) {
  Comparison comparison(from, to);
  comparison.compare_rows();
  return comparison.lines();
}

std::vector<std::string> missing_keys(SQLite::Database& damaged, SQLite::Database& to) {
  Comparison comparison(damaged, to);
  comparison.compare_keys();
  return comparison.lines();
}

}  // namespace lightstage::db
