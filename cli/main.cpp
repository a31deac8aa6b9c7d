#include <unistd.h>

#include <cstdlib>
#include <exception>
#include <iostream>
#include <new>

#include "cli/program.h"
#include "core/error.h"
#include "core/interrupt.h"

namespace {

// Libraries allocate in functions that promise not to throw (nlohmann's constructors, std::filesystem with an error_code). The store is then as after any
// other end; the user is told as after any other lack of memory.
[[noreturn]] void end_early() {
  if (const std::exception_ptr error = std::current_exception()) {
    try {
      std::rethrow_exception(error);
    } catch (const std::bad_alloc&) {
      const auto& line = lightstage::cli::kOutOfMemory;
      if (write(STDERR_FILENO, line.data(), line.size()) >= 0) {
        _exit(lightstage::core::exit_code(lightstage::core::ErrorKind::kInternal));
      }
    } catch (...) {  // a defect of the program: let it be seen
    }
  }
  std::abort();
}

}  // namespace

int main(int argc, char** argv) {
  std::set_terminate(end_early);
  const lightstage::core::InterruptGuard guard;
  return lightstage::cli::run(std::vector<std::string>(argv + 1, argv + argc), std::cout);
}
