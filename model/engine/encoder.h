// The encoder half of the engine: from a captured image to its features at every level.
#pragma once

#include <functional>
#include <span>
#include <vector>

#include "core/direction.h"
#include "core/image.h"
#include "model/engine/convolution.h"
#include "model/engine/feature_map.h"
#include "model/engine/normalisation.h"
#include "model/engine/weights.h"

namespace lightstage::model {

// Level l at 1/2^(l+1) of the size, with a column of zeros on the left.
struct Encoding {
  std::vector<FeatureMap> levels;

  std::size_t bytes() const;
};

// Of the encoding of an image of this size, by a network of these channels, kept as `number`.
std::size_t encoding_bytes(std::span<const int> channels, core::ImageSize image, Number number);

class Encoder {
 public:
  // Computes in float32, so that what is kept for all queries is as good as it can be.
  explicit Encoder(const SuperresWeights& weights, const Kernels& kernels = float_kernels());

  std::size_t levels() const { return layers_.size(); }
  // A level of the encoding of an image of this size: its shape alone.
  FeatureMap level_shape(std::size_t level, core::ImageSize image, Number number) const;

  // `image` is display-encoded, 3 channels, height and width multiples of 2^levels; `light` is the direction it was lit from. The image
  // goes as soon as the first level stands. Calls receive(level, map), float32, as soon as a level is no longer needed, so that no more than two
  // are held here at a time. Does not depend on the thread count.
  void encode(core::Image image, const core::Direction& light,
              const std::function<void(std::size_t level, FeatureMap map)>& receive) const;
  // All levels, stored as `number`: float32 or float16.
  Encoding encode(core::Image image, const core::Direction& light, Number number) const;

 private:
  struct Layer {
    PackedConvolution convolution;
    NormPreluWeights norm;
  };
  FeatureMap first_level(core::ImageView image, const core::Direction& light) const;
  FeatureMap next_level(const Layer& layer, const FeatureMap& below) const;
  void normalise(const Layer& layer, std::span<const Moments> moments, std::size_t parts, const FeatureMap& map) const;

  const Kernels& kernels_;
  float brightest_input_;
  std::vector<Layer> layers_;
};

// A level of an encoding, float32, as float16.
FeatureMap shortened(const FeatureMap& map, const Kernels& kernels);

}  // namespace lightstage::model
