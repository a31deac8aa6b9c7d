// What the functions of Store share: the connection, transactions, and short ways to ask and bind.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <utility>

#include <SQLiteCpp/Database.h>
#include <SQLiteCpp/Savepoint.h>
#include <SQLiteCpp/Statement.h>
#include <SQLiteCpp/Transaction.h>

#include "db/store.h"
#include "db/store/catalogue.h"
#include "db/store/object_files.h"
#include "db/store/store_folder.h"

namespace lightstage::db {

inline void bind_value(SQLite::Statement& statement, int at, std::int64_t value) {
  statement.bind(at, value);
}
inline void bind_value(SQLite::Statement& statement, int at, int value) {
  statement.bind(at, value);
}
inline void bind_value(SQLite::Statement& statement, int at, double value) {
  statement.bind(at, value);
}
inline void bind_value(SQLite::Statement& statement, int at, std::string_view value) {
  statement.bind(at, std::string(value));
}
inline void bind_value(SQLite::Statement& statement, int at, const ContentHash& value) {
  statement.bind(at, value.hex());
}
template <class T>
void bind_value(SQLite::Statement& statement, int at, const std::optional<T>& value) {
  if (value) {
    bind_value(statement, at, *value);
  } else {
    statement.bind(at);  // NULL
  }
}

// Binds the values to the statement's ?, in order.
template <class... Values>
void bind_all(SQLite::Statement& statement, const Values&... values) {
  int at = 0;
  (bind_value(statement, ++at, values), ...);
}

// What only a catalogue that this program did not write can hold is refused with StoreError: whole numbers beyond an int, text that goes deeper than may be
// walked through. `what` names it.
int int_at(const SQLite::Statement& row, int column, const std::string& what);
std::string shallow_json(std::string text, const std::string& what);

struct Store::Impl {
  std::filesystem::path folder;
  ObjectFiles objects;
  SQLite::Database database;
  StorePlace store_place;
  bool in_transaction = false;

  template <class... Values>
  SQLite::Statement query(const char* sql, const Values&... values) const {
    SQLite::Statement statement(database, sql);
    bind_all(statement, values...);
    return statement;
  }

  template <class... Values>
  void change(const char* sql, const Values&... values) {
    query(sql, values...).exec();
  }

  // From a row of the columns that the readers of scans and products select; asks for what hangs on it.
  Scan scan_from(SQLite::Statement& row) const;
  Product product_from(SQLite::Statement& row) const;
  template <class... Values>
  std::optional<Product> first_product(const std::string& condition, const Values&... values) const;
  // From the catalogue, or from the file's header for an object that nothing refers to yet.
  core::ImageSize size_of(const ContentHash& hash) const;
  // Enters the object into the catalogue, before the first row that refers to it. StoreError when its file is not there (any more).
  void know_object(const ContentHash& hash);
  void know_object(const ContentHash& hash, core::ImageSize size);
  // Within a transaction: the row of a frame whose object is durable. Throws as check_frame.
  Id enter_frame(const NewFrame& frame, const ContentHash& object, core::ImageSize size);
  // Throws BadInput unless the scan has this camera and step and the camera's other frames are of this size.
  void check_frame(const NewFrame& frame, core::ImageSize size) const;

  // All that `work` changes, or nothing. Inside another transaction it becomes part of that one. Immediate,
  // so that it waits for other writers at its start and never has to be given up in the middle.
  template <class Work>
  auto write(Work&& work) {
    return explaining(folder, [&] {
      if (in_transaction) {
        SQLite::Savepoint savepoint(database, "nested");
        return finish(
            savepoint, [&] { savepoint.release(); }, work);
      }
      SQLite::Transaction transaction(database, SQLite::TransactionBehavior::IMMEDIATE);
      const Flag flag(in_transaction);
      store_place.require_unmoved();
      return finish(
          transaction,
          [&] {
            store_place.require_unmoved();
            transaction.commit();
          },
          work);
    });
  }

 private:
  struct Flag {
    explicit Flag(bool& flag) : flag_(flag) { flag_ = true; }
    ~Flag() { flag_ = false; }
    Flag(const Flag&) = delete;
    Flag& operator=(const Flag&) = delete;
    bool& flag_;
  };

  template <class Scope, class Commit, class Work>
  static auto finish(Scope&, const Commit& commit, Work& work) {
    if constexpr (std::is_void_v<decltype(work())>) {
      work();
      commit();
    } else {
      auto result = work();
      commit();
      return result;
    }
  }
};

// Throws BadInput unless the text is JSON; `what` names it.
void require_json(const std::string& text, const std::string& what);
// Text as it is stored: nothing said is an empty object.
std::string json_or_empty(const std::string& text);

}  // namespace lightstage::db
