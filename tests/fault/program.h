// Running the built program, with the shim in front of it where a fault is wanted.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace lightstage::fault {

// What the shim is to do (shim.cpp); nothing by default.
struct Disturbance {
  std::filesystem::path folder;  // where its calls count
  std::string fault;             // "count", "kill 17", "fail 17 5", "full 17", "memory 1700"
  std::filesystem::path count_file, record_file;
};

struct Outcome {
  int status = 0;  // exit status; 128 + n when ended by signal n
  std::string out, err;
};

// Where the program and the shim are.
void set_paths(const std::filesystem::path& program, const std::filesystem::path& shim);

// Ends it by SIGKILL after two minutes, which counts as status 124.
Outcome run_program(const std::vector<std::string>& arguments, const Disturbance& disturbance);

}  // namespace lightstage::fault
