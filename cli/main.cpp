#include <iostream>

#include "cli/program.h"
#include "core/interrupt.h"

int main(int argc, char** argv) {
  const lightstage::core::InterruptGuard guard;
  return lightstage::cli::run(std::vector<std::string>(argv + 1, argv + argc), std::cout);
}
