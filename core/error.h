// Errors that a user can act on. Everything this project throws on purpose derives from core::Error; `main`
// prints what() as one line and exits with exit_code(). A message says what is wrong, where (file, line,
// pixel, light), and what to do.
#pragma once

#include <stdexcept>
#include <string>

namespace lightstage::core {

enum class ErrorKind { kInternal, kUsage, kBadInput, kDevice, kStore, kInterrupted };

class Error : public std::runtime_error {
 public:
  Error(ErrorKind kind, const std::string& message) : std::runtime_error(message), kind_(kind) {}
  ErrorKind kind() const { return kind_; }

 private:
  ErrorKind kind_;
};

// A command line that cannot be carried out as written.
struct UsageError : Error {
  explicit UsageError(const std::string& message) : Error(ErrorKind::kUsage, message) {}
};
// A file or value from outside that is not what it must be.
struct BadInput : Error {
  explicit BadInput(const std::string& message) : Error(ErrorKind::kBadInput, message) {}
};
// A camera, LED controller or trigger that fails, is missing or is not permitted.
struct DeviceError : Error {
  explicit DeviceError(const std::string& message) : Error(ErrorKind::kDevice, message) {}
};
// The store is missing, damaged, busy, full or from a newer program.
struct StoreError : Error {
  explicit StoreError(const std::string& message) : Error(ErrorKind::kStore, message) {}
};
// The user pressed Ctrl-C or the process was told to end; all is left as it was or resumable.
struct Interrupted : Error {
  explicit Interrupted(const std::string& message) : Error(ErrorKind::kInterrupted, message) {}
};

// Process exit status for a kind: 1 internal, 2 usage, 3 bad input, 4 device, 5 store, 130 interrupted.
int exit_code(ErrorKind kind);

}  // namespace lightstage::core
