// What the network computes with on this machine.
#pragma once

#include <string>

namespace lightstage::model {

struct EngineInfo {
  std::string torch_version;
  std::string blas;        // the shared library that serves matrix products, as loaded
  bool fast_blas = false;  // OpenBLAS or MKL; the reference BLAS is some 20 times slower
};

EngineInfo engine_info();

}  // namespace lightstage::model
