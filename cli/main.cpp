#include <unistd.h>

#include <atomic>
#include <cstdlib>
#include <exception>
#include <iostream>
#include <new>

#include "cli/program.h"
#include "core/error.h"
#include "core/interrupt.h"

namespace {

std::atomic<bool> memory_lacked = false;

// What operator new calls when there is no memory.
[[noreturn]] void note_lack() {
  memory_lacked = true;
  throw std::bad_alloc();
}

// Whether the exception that ends the program is a lack of memory. One that left a function that promises not to throw is not caught by anybody, and cannot be looked at.
bool is_lack_of_memory() {
  const std::exception_ptr error = std::current_exception();
  if (!error) return memory_lacked && std::uncaught_exceptions() > 0;
  try {
    std::rethrow_exception(error);
  } catch (const std::bad_alloc&) {
    return true;
  } catch (...) {  // a defect of the program: let it be seen
    return false;
  }
}

// Libraries allocate in functions that promise not to throw (nlohmann's constructors, OpenImageIO's files, std::filesystem with an error_code). The store is then as after
// any other end; the user is told as after any other lack of memory.
[[noreturn]] void end_early() {
  if (is_lack_of_memory()) {
    const auto& line = lightstage::cli::kOutOfMemory;
    if (write(STDERR_FILENO, line.data(), line.size()) >= 0) {
      _exit(lightstage::core::exit_code(lightstage::core::ErrorKind::kInternal));
    }
  }
  std::abort();
}

}  // namespace

int main(int argc, char** argv) {
  std::set_new_handler(note_lack);
  std::set_terminate(end_early);
  const lightstage::core::InterruptGuard guard;
  return lightstage::cli::run(std::vector<std::string>(argv + 1, argv + argc), std::cout);
}
