// The program as a function.
#pragma once

#include <iosfwd>
#include <string>
#include <vector>

namespace lightstage::cli {

// Runs one command line (without the program's name). Results go to `out`, everything else to stderr. Returns the exit
// status; errors are printed, not thrown.
int run(const std::vector<std::string>& arguments, std::ostream& out);

// As run, but throws core::Error instead of printing it; for a command made of others.
void run_or_throw(const std::vector<std::string>& arguments, std::ostream& out);

}  // namespace lightstage::cli
