// The program as a function.
#pragma once

#include <iosfwd>
#include <string>
#include <string_view>
#include <vector>

namespace lightstage::cli {

inline constexpr std::string_view kOutOfMemory =
    "lightstage: out of memory; what this command had not finished is left as it was or can be gone on with\n";

// Runs one command line (without the program's name). Results go to `out`, everything else to stderr. Returns the exit
// status; errors are printed, not thrown.
int run(const std::vector<std::string>& arguments, std::ostream& out);

// As run, but throws core::Error instead of printing it; for a command made of others.
void run_or_throw(const std::vector<std::string>& arguments, std::ostream& out);

}  // namespace lightstage::cli
