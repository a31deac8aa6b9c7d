// The entry of libFuzzer. LIGHTSTAGE_FUZZ_TARGET names the target.
#include <cstdio>
#include <cstdlib>

#include "fuzz/target.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace lightstage;
  static const fuzz::Target& target = []() -> const fuzz::Target& {
    const char* name = std::getenv("LIGHTSTAGE_FUZZ_TARGET");
    for (const fuzz::Target& known : fuzz::targets()) {
      if (name != nullptr && known.name == name) return known;
    }
    std::fprintf(stderr, "LIGHTSTAGE_FUZZ_TARGET must be one of");
    for (const fuzz::Target& known : fuzz::targets()) std::fprintf(stderr, " %s", known.name.c_str());
    std::fprintf(stderr, "\n");
    std::exit(2);
  }();
  fuzz::run(target, {data, size});
  return 0;
}
