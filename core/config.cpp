#include "core/config.h"

#include <toml++/toml.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <map>
#include <set>

#include "core/error.h"
#include "core/file.h"
#include "core/nesting.h"
#include "core/text.h"

namespace lightstage::core {

struct TomlTable::Node {
  std::shared_ptr<const toml::table> document;  // keeps `table` alive
  const toml::table* table = nullptr;
  std::string source_name;
  std::string prefix;  // "" or the path of this table with a dot at the end
  std::set<std::string, std::less<>> asked;
  std::map<std::string, std::shared_ptr<Node>, std::less<>> children;

  const toml::node* find(std::string_view key) {
    asked.emplace(key);
    return table->get(key);
  }

  std::string place(const toml::node* node) const {
    const auto line = (node != nullptr ? node : table)->source().begin.line;
    return source_name + ":" + std::to_string(std::max<unsigned long>(1, line)) + ": ";
  }

  BadInput failure(std::string_view key, const toml::node* node, const std::string& problem) const {
    return BadInput(place(node) + "key '" + prefix + std::string(key) + "' " + problem);
  }

  const toml::node& require(std::string_view key) {
    const toml::node* node = find(key);
    if (node == nullptr) throw failure(key, nullptr, "is missing");
    return *node;
  }

  // The same child for the same table, so that what was asked of it anywhere counts.
  std::shared_ptr<Node> child(const std::string& name, const toml::table& child_table) {
    std::shared_ptr<Node>& node = children[name];
    if (node == nullptr) {
      node = std::make_shared<Node>();
      node->document = document;
      node->table = &child_table;
      node->source_name = source_name;
      node->prefix = prefix + name + ".";
    }
    return node;
  }

  double number(std::string_view key, const toml::node& node) const {
    const std::optional<double> value = node.is_number() ? node.value<double>() : std::nullopt;
    if (!value) throw failure(key, &node, "must be a number");
    if (!std::isfinite(*value)) throw failure(key, &node, "must be finite");
    return *value;
  }

  std::string string(std::string_view key, const toml::node& node) const {
    if (!node.is_string()) throw failure(key, &node, "must be a string in quotes");
    return node.as_string()->get();
  }

  const toml::array& array(std::string_view key, const toml::node& node) const {
    if (!node.is_array()) throw failure(key, &node, "must be an array");
    return *node.as_array();
  }

  struct Unknown {
    const toml::key* key;
    const Node* owner;
  };
  // The key that stands first in the file, of those that nobody asked for.
  void find_unknown(std::optional<Unknown>& first) const {
    for (const auto& [key, value] : *table) {
      if (asked.contains(key.str())) continue;
      const auto at = key.source().begin;
      if (!first || at.line < first->key->source().begin.line ||
          (at.line == first->key->source().begin.line && at.column < first->key->source().begin.column))
        first = Unknown{&key, this};
    }
    for (const auto& [name, node] : children) node->find_unknown(first);
  }
};

TomlTable::TomlTable(std::shared_ptr<Node> node) : node_(std::move(node)) {}

TomlTable TomlTable::read_file(const std::filesystem::path& path) {
  return parse(read_text_file(path), path.string());
}

TomlTable TomlTable::parse(std::string_view text, const std::string& source_name) {
  if (const int line = line_of_longer_key(text, kMostKeyParts)) {
    throw BadInput(source_name + ":" + std::to_string(line) + ": a key has more than " + std::to_string(kMostKeyParts) +
                   " parts");
  }
  auto node = std::make_shared<Node>();
  try {
    node->document = std::make_shared<const toml::table>(toml::parse(text, source_name));
  } catch (const toml::parse_error& error) {
    throw BadInput(source_name + ":" + std::to_string(error.source().begin.line) + ": " +
                   std::string(error.description()));
  }
  node->table = node->document.get();
  node->source_name = source_name;
  return TomlTable(std::move(node));
}

bool TomlTable::has(std::string_view key) const {
  return node_->find(key) != nullptr;
}

double TomlTable::number(std::string_view key) const {
  return node_->number(key, node_->require(key));
}

double TomlTable::number(std::string_view key, double default_value) const {
  return has(key) ? number(key) : default_value;
}

std::int64_t TomlTable::integer(std::string_view key) const {
  const toml::node& node = node_->require(key);
  if (!node.is_integer()) throw node_->failure(key, &node, "must be an integer");
  return node.as_integer()->get();
}

std::int64_t TomlTable::integer(std::string_view key, std::int64_t default_value) const {
  return has(key) ? integer(key) : default_value;
}

bool TomlTable::boolean(std::string_view key, bool default_value) const {
  const toml::node* node = node_->find(key);
  if (node == nullptr) return default_value;
  if (!node->is_boolean()) throw node_->failure(key, node, "must be true or false");
  return node->as_boolean()->get();
}

std::string TomlTable::string(std::string_view key) const {
  return node_->string(key, node_->require(key));
}

std::string TomlTable::string(std::string_view key, std::string_view default_value) const {
  return has(key) ? string(key) : std::string(default_value);
}

std::vector<double> TomlTable::numbers(std::string_view key) const {
  std::vector<double> values;
  for (const toml::node& element : node_->array(key, node_->require(key)))
    values.push_back(node_->number(key, element));
  return values;
}

std::vector<double> TomlTable::numbers(std::string_view key, std::size_t count) const {
  std::vector<double> values = numbers(key);
  if (values.size() != count)
    fail(key, "must have " + std::to_string(count) + " numbers, not " + std::to_string(values.size()));
  return values;
}

std::vector<std::string> TomlTable::strings(std::string_view key) const {
  std::vector<std::string> values;
  for (const toml::node& element : node_->array(key, node_->require(key)))
    values.push_back(node_->string(key, element));
  return values;
}

std::vector<std::string> TomlTable::strings(std::string_view key, std::vector<std::string> default_value) const {
  return has(key) ? strings(key) : std::move(default_value);
}

TomlTable TomlTable::table(std::string_view key) const {
  const toml::node& node = node_->require(key);
  if (!node.is_table()) throw node_->failure(key, &node, "must be a table");
  return TomlTable(node_->child(std::string(key), *node.as_table()));
}

std::optional<TomlTable> TomlTable::optional_table(std::string_view key) const {
  return has(key) ? std::optional(table(key)) : std::nullopt;
}

std::vector<TomlTable> TomlTable::tables(std::string_view key) const {
  std::vector<TomlTable> result;
  const toml::node* node = node_->find(key);
  if (node == nullptr) return result;
  for (const toml::node& element : node_->array(key, *node)) {
    if (!element.is_table()) throw node_->failure(key, &element, "must hold tables only");
    const std::string name = std::string(key) + "[" + std::to_string(result.size()) + "]";
    result.push_back(TomlTable(node_->child(name, *element.as_table())));
  }
  return result;
}

void TomlTable::finish() const {
  std::optional<Node::Unknown> unknown;
  node_->find_unknown(unknown);
  if (!unknown) return;
  const Node& owner = *unknown->owner;
  const std::string key(unknown->key->str());
  const std::vector<std::string> known(owner.asked.begin(), owner.asked.end());
  throw BadInput(owner.source_name + ":" + std::to_string(unknown->key->source().begin.line) + ": key '" +
                 owner.prefix + key + "' is not known" + did_you_mean(key, known));
}

void TomlTable::fail(std::string_view key, const std::string& problem) const {
  throw node_->failure(key, node_->table->get(key), problem);
}

}  // namespace lightstage::core
