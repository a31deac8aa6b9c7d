// A trained network as a LightInterpolator (docs/model.md draws the networks).
#pragma once

#include <cstddef>
#include <filesystem>
#include <memory>
#include <optional>

#include "core/olat_scan.h"
#include "model/interpolator.h"

namespace lightstage::model {

// How networks compute; all but the first is of `superres`.
struct NetworkOptions {
  // Nearest lights that a query takes; the checkpoint's number, with which the network was trained, where it is left open. 1 to 64.
  std::optional<int> neighbours = {};
  // Products of bfloat16 numbers, sums of float32: 1.7 times as fast, values within about 0.01. UsageError where the processor cannot.
  bool bfloat16 = false;
  // Encodings kept as float16, so that twice as many fit; values within about 0.001 (and always with `bfloat16`, where it is lost in the noise).
  bool half_storage = false;
  // For captured images and their encodings, each made once: memory; and a temporary file for encodings that do not fit there.
  std::size_t cache_bytes = std::size_t(2) << 30;
  std::size_t spill_bytes = 0;
};

// Reads the checkpoint (model/checkpoint.h) once; the method is named as its architecture. A query takes the nearest lights, fewer than
// asked for where the scan has fewer; in xu always the lights that it chose, in meka all of them. Outside the mask's bounding box
// the picture is that of thin-plate interpolation for blend, of linear blending for all others. Throws BadInput for a checkpoint
// that is missing, damaged or of another version.
std::unique_ptr<LightInterpolator> make_network_interpolator(const core::OlatScan& scan,
                                                             const std::filesystem::path& checkpoint,
                                                             const NetworkOptions& options = {});

}  // namespace lightstage::model
