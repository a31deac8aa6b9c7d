// TOML files with messages that name file and line.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace lightstage::core {

// One table of a TOML document. Getters throw BadInput "FILE:LINE: key 'k' ..." for a missing key, a wrong
// type, a value that is not finite or out of range. Every key asked for counts as known; finish() throws for
// the first key that nobody asked for, so that a misspelt option is never ignored.
class TomlTable {
 public:
  static TomlTable read_file(const std::filesystem::path& path);
  // `source_name` stands for the file name in messages.
  static TomlTable parse(std::string_view text, const std::string& source_name);

  bool has(std::string_view key) const;
  double number(std::string_view key) const;  // integers are taken as numbers
  double number(std::string_view key, double default_value) const;
  std::int64_t integer(std::string_view key) const;
  std::int64_t integer(std::string_view key, std::int64_t default_value) const;
  bool boolean(std::string_view key, bool default_value) const;
  std::string string(std::string_view key) const;
  std::string string(std::string_view key, std::string_view default_value) const;
  std::vector<double> numbers(std::string_view key) const;
  // Exactly `count` numbers.
  std::vector<double> numbers(std::string_view key, std::size_t count) const;
  std::vector<std::string> strings(std::string_view key) const;
  std::vector<std::string> strings(std::string_view key, std::vector<std::string> default_value) const;
  TomlTable table(std::string_view key) const;
  std::optional<TomlTable> optional_table(std::string_view key) const;
  // An array of tables ([[key]]); empty when the key is absent.
  std::vector<TomlTable> tables(std::string_view key) const;

  // Checks this table and every table taken from it.
  void finish() const;

  // Throws BadInput with this key's file and line: for values that parse but make no sense.
  [[noreturn]] void fail(std::string_view key, const std::string& problem) const;

 private:
  struct Node;
  explicit TomlTable(std::shared_ptr<Node> node);
  std::shared_ptr<Node> node_;
};

}  // namespace lightstage::core
