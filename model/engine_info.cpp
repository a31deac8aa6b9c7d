#include "model/engine_info.h"

#include <dlfcn.h>
#include <torch/version.h>

#include <filesystem>

namespace lightstage::model {

namespace {

// Debian lets the administrator choose among BLAS libraries behind one name: ask the loader which file it took.
std::string loaded_blas() {
  void* const symbol = dlsym(RTLD_DEFAULT, "sgemm_");
  Dl_info info{};
  if (symbol == nullptr || dladdr(symbol, &info) == 0 || info.dli_fname == nullptr) return "none loaded";
  std::error_code ignored;
  const std::filesystem::path file = std::filesystem::canonical(info.dli_fname, ignored);
  return file.empty() ? info.dli_fname : file.string();
}

}  // namespace

EngineInfo engine_info() {
  EngineInfo info;
  info.torch_version = TORCH_VERSION;
  info.blas = loaded_blas();
  info.fast_blas = info.blas.find("openblas") != std::string::npos || info.blas.find("mkl") != std::string::npos;
  return info;
}

}  // namespace lightstage::model
