// `xu`, `xu_adaptive` and `meka` as LightInterpolators.
#pragma once

#include <memory>

#include "model/interpolator.h"
#include "model/net/network.h"

namespace lightstage::model {

// Outside the mask's bounding box the picture is that of linear blending. meka sums its gradients here, of all captured images. A query costs one
// pass of the network over the box.
std::unique_ptr<LightInterpolator> make_u_net_interpolator(const core::OlatScan& scan,
                                                           std::unique_ptr<const Network> network);

}  // namespace lightstage::model
