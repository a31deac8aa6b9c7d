#include "core/error.h"

namespace lightstage::core {

int exit_code(ErrorKind kind) {
  switch (kind) {
    case ErrorKind::kInternal:
      return 1;
    case ErrorKind::kUsage:
      return 2;
    case ErrorKind::kBadInput:
      return 3;
    case ErrorKind::kDevice:
      return 4;
    case ErrorKind::kStore:
      return 5;
    case ErrorKind::kInterrupted:
      return 130;
  }
  return 1;
}

}  // namespace lightstage::core
