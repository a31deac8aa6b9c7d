// An OLAT scan as the model and relight rooms see it: lights, images loaded when asked for, and the subject's
// mask.
#pragma once

#include <cstddef>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "core/image.h"
#include "core/light_list.h"

namespace lightstage::core {

// Images are linear radiance per unit light (each light's gain divided out), all of one size, in one pose.
// A copy is cheap and shares the image cache. All functions may be called from several threads.
class OlatScan {
 public:
  // Reads the image of one light; called at most once for an image that stays cached. Different images may
  // be asked for from several threads at a time. May throw.
  using Loader = std::function<Image(std::size_t light_index)>;

  // `mask` has one channel, the size of the images, 1 inside the subject and 0 outside; an empty one means
  // all inside. At most `cache_bytes` of images stay in memory (least recently used go first). Throws
  // BadInput for no lights, a mask of another size, or one with nothing (above 0.5) inside.
  OlatScan(std::string name, std::vector<Light> lights, ImageSize image_size, Image mask, Loader loader,
           std::size_t cache_bytes = std::size_t(4) << 30);

  const std::string& name() const;
  std::size_t light_count() const;
  const Light& light(std::size_t light_index) const;
  const std::vector<Direction>& directions() const;
  ImageSize image_size() const;

  // The image under one light. Throws what the loader throws, and BadInput when the size is not image_size().
  std::shared_ptr<const Image> image(std::size_t light_index) const;

  // One channel, image_size() high and wide.
  const Image& mask() const;
  std::size_t masked_pixel_count() const;

  // The 99.5th percentile of all masked values of all images: the value shown as 1 when errors are judged.
  // Exact, and always positive: where the percentile is not, it is the largest value, and 1 for an all-black
  // scan. Computed once, on first use: reads every image, no more at a time than the cache may hold (but one), and takes memory for about 1%
  // of the masked values.
  double exposure() const;

  // This scan with only the given lights, in that order, sharing images, mask and exposure (leave-one-out,
  // subsampling).
  OlatScan with_lights(std::span<const std::size_t> light_indices) const;

  // This scan with display-encoded images, display_encode(v / exposure()) (core/display.h), so that negative light counts as none; its exposure() is
  // 1. All copies of a scan, with whatever lights, share these images for as long as one scan of them lives; they take as much memory as the
  // cache of the scan they were first asked from, which in turn gives up what is encoded.
  OlatScan display_encoded() const;

  // How many images stay in memory at a time.
  std::size_t images_kept() const;

  // This scan with an image cache of its own, of at most so many bytes (0: every image is read each time), empty at first; mask and exposure
  // are shared.
  OlatScan with_cache(std::size_t bytes) const;

 private:
  struct Source;
  class ImageCache;
  std::size_t source_index(std::size_t light_index) const;
  std::shared_ptr<Source> source_;
  std::shared_ptr<ImageCache> images_;
  std::vector<std::size_t> source_index_;  // light here -> light in source_
  std::vector<Direction> directions_;
};

}  // namespace lightstage::core
