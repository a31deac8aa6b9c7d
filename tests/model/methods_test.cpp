// The table of methods and their knobs.
#include <catch2/catch.hpp>
#include <map>

#include "core/error.h"
#include "model/methods.h"

namespace lightstage {

TEST_CASE("an option of several methods means the same in each, and every knob takes its own default") {
  std::map<std::string, model::Knob> knobs;
  for (const model::MethodInfo& method : model::methods()) {
    for (const model::Knob& knob : method.knobs) {
      CAPTURE(method.name, knob.option);
      const auto [same, fresh] = knobs.emplace(knob.option, knob);
      CHECK(same->second.what == knob.what);
      CHECK(same->second.values == knob.values);
      CHECK(knob.option.starts_with("--"));
      if (!knob.set) {
        CHECK(knob.option == "--model");
        continue;
      }
      model::MethodOptions options;
      if (!knob.default_value.starts_with("from ")) CHECK_NOTHROW(knob.set(options, knob.default_value));
      for (const char* bad : {"", "nan", "-1", "1e400", "sideways", "1 2"})
        CHECK_THROWS_AS(knob.set(options, bad), core::UsageError);
    }
  }
}

TEST_CASE("knobs put what a text says into the options") {
  model::MethodOptions options;
  const auto set = [&](const std::string& method, const std::string& option, const std::string& text) {
    for (const model::Knob& knob : model::method_info(method).knobs)
      if (knob.option == option) return knob.set(options, text);
    FAIL(method + " has no " + option);
  };
  set("linear", "--neighbours", "5");
  set("linear", "--sharpness", "12.5");
  set("rbf", "--domain", "linear");
  set("superres", "--bf16", "on");
  set("superres", "--cache-mb", "3");
  CHECK(options.neighbours == 5);
  CHECK(options.sharpness == 12.5);
  CHECK(options.domain == model::Domain::kLinear);
  CHECK(options.network.bfloat16);
  CHECK_FALSE(options.network.half_storage);
  CHECK(options.network.cache_bytes == std::size_t(3) << 20);
}

}  // namespace lightstage
