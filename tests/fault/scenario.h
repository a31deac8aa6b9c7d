// The commands that are broken on purpose: what they work on, and how they are done again.
#pragma once

#include <filesystem>
#include <functional>
#include <string>
#include <vector>

namespace lightstage::fault {

using Arguments = std::vector<std::string>;

// The folder that a command works in holds its store as `store`, and whatever else it needs.
struct Scenario {
  std::string name;
  // Makes the folder ready, by commands that are not disturbed.
  std::function<void(const std::filesystem::path& folder)> prepare;
  std::function<Arguments(const std::filesystem::path& folder)> command;
  // What a user would type after the command was disturbed; nothing where all is done.
  std::function<Arguments(const std::filesystem::path& folder)> again;
};

const std::vector<Scenario>& scenarios();

// What the store holds: a line for each frame and for each picture of the newest product of a kind and scan, with its hash. Equal lines
// mean equal contents. Empty where there is no store.
std::vector<std::string> contents(const std::filesystem::path& store);

}  // namespace lightstage::fault
