// Seeds of random numbers, as options take them.
#pragma once

#include <CLI/CLI.hpp>
#include <cctype>
#include <cerrno>
#include <cstdlib>
#include <string>

namespace lightstage::cli {

// A whole number from 0 to 2^64 - 1. CLI11 alone takes -1 and whatever is larger for the largest of them.
inline CLI::Validator seed_number() {
  CLI::Validator validator;
  validator.description("0 to 2^64 - 1").operation([](std::string& text) {
    char* end = nullptr;
    errno = 0;
    std::strtoull(text.c_str(), &end, 0);
    const bool whole = !text.empty() && std::isdigit(static_cast<unsigned char>(text[0])) != 0 && *end == '\0';
    return whole && errno == 0 ? std::string() : "'" + text + "' is not a whole number from 0 to 2^64 - 1";
  });
  return validator;
}

}  // namespace lightstage::cli
