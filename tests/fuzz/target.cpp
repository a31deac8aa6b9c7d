#include "fuzz/target.h"

#include <stdlib.h>

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <fstream>

#include "core/progress.h"

namespace lightstage::fuzz {

namespace fs = std::filesystem;

namespace {

std::vector<Target>& registered() {
  static std::vector<Target> all;
  return all;
}

}  // namespace

Registration::Registration(Target target) {
  std::vector<Target>& all = registered();
  const auto place = std::find_if(all.begin(), all.end(), [&](const Target& t) { return t.name > target.name; });
  all.insert(place, std::move(target));
}

const std::vector<Target>& targets() {
  return registered();
}

void run(const Target& target, Bytes bytes) {
  static const bool quiet = (core::set_quiet(true), true);
  static_cast<void>(quiet);
  tolerate([&] { target.run(bytes); });
}

void require(bool holds, std::string_view property) {
  if (holds) return;
  std::fprintf(stderr, "does not hold: %.*s\n", int(property.size()), property.data());
  std::abort();
}

void detail::check_error(const std::exception& error) {
  const auto* known = dynamic_cast<const core::Error*>(&error);
  require(known != nullptr && known->kind() != core::ErrorKind::kInternal, error.what());
  require(*error.what() != '\0', "an error says what is wrong");
}

const fs::path& scratch() {
  static const fs::path folder = [] {
    if (const char* given = std::getenv("LIGHTSTAGE_FUZZ_SCRATCH")) return fs::path(given);
    std::string pattern = (fs::temp_directory_path() / "lightstage-fuzz-XXXXXX").string();
    require(::mkdtemp(pattern.data()) != nullptr, "there is a folder for temporary files");
    return fs::path(pattern);
  }();
  return folder;
}

fs::path write(const fs::path& path, Bytes bytes) {
  return write(path, text_of(bytes));
}

fs::path write(const fs::path& path, std::string_view text) {
  fs::create_directories(path.parent_path());
  std::ofstream file(path, std::ios::binary | std::ios::trunc);
  file.write(text.data(), std::streamsize(text.size()));
  require(bool(file.flush()), "the scratch folder takes files");
  return path;
}

std::uint64_t Input::number(std::size_t bytes) {
  std::uint64_t value = 0;
  const Bytes taken = take(bytes);
  for (std::size_t i = 0; i < taken.size(); ++i) value |= std::uint64_t(taken[i]) << (8 * i);
  return value;
}

Bytes Input::take(std::size_t count) {
  const Bytes taken = bytes_.first(std::min(count, bytes_.size()));
  bytes_ = bytes_.subspan(taken.size());
  return taken;
}

}  // namespace lightstage::fuzz
