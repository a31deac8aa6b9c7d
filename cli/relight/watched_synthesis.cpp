#include "cli/relight/watched_synthesis.h"

#include <utility>

namespace lightstage::cli {

WatchedSynthesis::WatchedSynthesis(const model::LightInterpolator& method, std::function<void()> synthesised)
    : method_(method), synthesised_(std::move(synthesised)) {}

std::string_view WatchedSynthesis::name() const {
  return method_.name();
}

const core::OlatScan& WatchedSynthesis::scan() const {
  return method_.scan();
}

core::Image WatchedSynthesis::render(const core::Direction& query) const {
  core::Image picture = method_.render(query);
  synthesised_();
  return picture;
}

std::vector<double> WatchedSynthesis::linear_weights(const core::Direction& query) const {
  return method_.linear_weights(query);
}

std::vector<core::Vec3> WatchedSynthesis::captured_colours(std::span<const model::DistantLight> lights) const {
  return method_.captured_colours(lights);
}

core::Image WatchedSynthesis::lit_by(std::span<const core::Vec3> colours) const {
  return method_.lit_by(colours);
}

}  // namespace lightstage::cli
