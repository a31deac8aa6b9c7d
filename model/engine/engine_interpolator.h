// The published network on one scan, by the engine.
#pragma once

#include <memory>

#include "core/olat_scan.h"
#include "model/engine/superres_engine.h"
#include "model/interpolator.h"
#include "model/net/superres_network.h"

namespace lightstage::model {

// Computes the bounding box of the mask alone; outside it is the weighted sum of the display-encoded captured images, decoded. Keeps captured
// images (in a cache of its own, see OlatScan::with_cache) and encodings, of as many lights as options.budget.memory_bytes holds of both, or none
// where that is not an active set. Takes beside it, while a query runs, the memory of one feature map a level and four pictures, even of
// 4096 x 4096 pixels. The network is not needed afterwards.
std::unique_ptr<LightInterpolator> make_engine_interpolator(const core::OlatScan& scan, const SuperresNetwork& network,
                                                            const EngineOptions& options);

}  // namespace lightstage::model
