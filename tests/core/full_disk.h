// A disk that takes no more than so many bytes a file: what a full disk does to a program, without filling
// one.
#pragma once

#include <sys/resource.h>

#include <csignal>

namespace lightstage::test {

class FullDisk {
 public:
  explicit FullDisk(rlim_t bytes_per_file) : signal_before_(std::signal(SIGXFSZ, SIG_IGN)) {
    getrlimit(RLIMIT_FSIZE, &before_);
    const rlimit limit{bytes_per_file, before_.rlim_max};
    setrlimit(RLIMIT_FSIZE, &limit);
  }
  ~FullDisk() {
    setrlimit(RLIMIT_FSIZE, &before_);
    std::signal(SIGXFSZ, signal_before_);
  }
  FullDisk(const FullDisk&) = delete;
  FullDisk& operator=(const FullDisk&) = delete;

 private:
  void (*signal_before_)(int);
  rlimit before_{};
};

}  // namespace lightstage::test
