// hil_rig CAMERAS LOG: an emulated light stage for the kernel of the machine that it runs on. Needs root and the modules vhci-hcd
// and uhid: for the virtual machine of tests/hil. rig.h says what can be typed.
#include <sched.h>

#include <cstdlib>
#include <exception>
#include <iostream>

#include "hil/rig/rig.h"

int main(int argc, char** argv) {
  if (argc != 3) {
    std::cerr << "hil_rig CAMERAS LOG\n";
    return 2;
  }
  // Devices do not wait for a busy host.
  const sched_param first_of_all{.sched_priority = 10};
  sched_setscheduler(0, SCHED_FIFO, &first_of_all);
  try {
    lightstage::hil::Rig rig(std::atoi(argv[1]), argv[2]);
    std::cout << "ready" << std::endl;
    rig.run();
    return 0;
  } catch (const std::exception& error) {
    std::cerr << "hil_rig: " << error.what() << '\n';
    return 1;
  }
}
