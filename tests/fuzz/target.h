// What the fuzzer and the replay of its findings call: one parser a target, given any bytes.
//
// A target may throw core::Error, as the program does for bad input. Everything else is a crash: another exception (lack of memory among
// them), an error of this program's own (ErrorKind::kInternal), a signal, a sanitizer's report, and a property that does not hold (require).
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace lightstage::fuzz {

using Bytes = std::span<const std::uint8_t>;

struct Target {
  std::string name;
  std::function<void(Bytes)> run;
  std::size_t longest = 1 << 16;  // bytes that inputs grow to
  std::size_t slowness = 1;       // in a search by number of runs it gets so many times fewer
};

// In order of name.
const std::vector<Target>& targets();

// Adds a target where a file of targets is loaded.
struct Registration {
  explicit Registration(Target target);
};

// Runs a target on bytes: returns for good and for bad input, throws or ends the process for a crash.
void run(const Target& target, Bytes bytes);

// Ends the process by a signal when a property does not hold.
void require(bool holds, std::string_view property);

// Carries on where a step of a target throws core::Error.
template <class Step>
void tolerate(Step&& step);

// A folder of this process, made at the first call. The variable LIGHTSTAGE_FUZZ_SCRATCH names one that is there.
const std::filesystem::path& scratch();

// Writes a file, without any care for its durability; returns its path.
std::filesystem::path write(const std::filesystem::path& path, Bytes bytes);
std::filesystem::path write(const std::filesystem::path& path, std::string_view text);

inline std::string_view text_of(Bytes bytes) {
  return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
}

// Takes values off the front of an input; zeros and empty spans when it is used up.
class Input {
 public:
  explicit Input(Bytes bytes) : bytes_(bytes) {}
  bool empty() const { return bytes_.empty(); }
  std::uint8_t byte() { return std::uint8_t(number(1)); }
  std::uint64_t number(std::size_t bytes);
  Bytes take(std::size_t count);
  Bytes rest() { return take(bytes_.size()); }

 private:
  Bytes bytes_;
};

namespace detail {
void check_error(const std::exception& error);
}

}  // namespace lightstage::fuzz

#include "core/error.h"

namespace lightstage::fuzz {

template <class Step>
void tolerate(Step&& step) {
  try {
    step();
  } catch (const core::Error& error) {
    detail::check_error(error);
  }
}

}  // namespace lightstage::fuzz
