#include "align/flow.h"
#include "core/cubic_sampling.h"
#include "core/error.h"
#include "core/image_file.h"
#include "core/parallel.h"

namespace lightstage::align {

core::Image warp(core::ImageView picture, const FlowField& flow) {
  if (flow.channels() != 2 || flow.width() != picture.width() || flow.height() != picture.height()) {
    throw core::BadInput("warp: a flow of " + std::to_string(flow.width()) + " x " + std::to_string(flow.height()) +
                         " x " + std::to_string(flow.channels()) + " does not fit a picture of " +
                         std::to_string(picture.width()) + " x " + std::to_string(picture.height()) + " pixels");
  }
  core::require_finite(flow, "warp: the flow");
  core::require_finite(picture, "warp: the picture");
  constexpr std::size_t kRowsAtATime = 8;
  core::Image result(picture.size());
  core::parallel_for(std::size_t(picture.height()), kRowsAtATime, [&](std::size_t first, std::size_t last) {
    for (int y = int(first); y < int(last); ++y) {
      for (int x = 0; x < picture.width(); ++x) {
        const double from_x = x + double(flow(y, x, 0));
        const double from_y = y + double(flow(y, x, 1));
        if (core::inside_picture(picture, from_x, from_y)) {
          core::sample_cubic(picture, from_x, from_y, result.pixel(y, x));
        }
      }
    }
  });
  return result;
}

void clear_outside(core::Image& confidence, const FlowField& flow) {
  if (flow.channels() != 2 || confidence.size() != core::ImageSize{flow.height(), flow.width(), 1}) {
    throw core::BadInput("a warp's holes: the confidence is not of the flow's size");
  }
  for (int y = 0; y < flow.height(); ++y) {
    for (int x = 0; x < flow.width(); ++x) {
      if (!core::inside_picture(flow, x + double(flow(y, x, 0)), y + double(flow(y, x, 1)))) confidence(y, x) = 0;
    }
  }
}

}  // namespace lightstage::align
