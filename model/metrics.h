// How far a picture is from the truth. All take display-encoded pictures of equal size in [0, 1] and a mask of one channel (inside where
// > 0.5; empty: everywhere), all are 0 for equal pictures and symmetric. Throw BadInput when sizes differ or the mask is empty of pixels.
// Results do not depend on the thread count.
#pragma once

#include "core/image.h"

namespace lightstage::model {

// Mean over masked pixels and channels of (a - b)^2; reports take the root of its mean over images.
double mean_squared_error(core::ImageView a, core::ImageView b, core::ImageView mask);

// Squared Sobolev H1 norm of e = a - b: mean over the mask of e^2 + |grad e|^2, gradient by forward differences per pixel; a difference
// counts where both of its pixels are inside. Reports take the root of its mean over images.
double squared_h1(core::ImageView a, core::ImageView b, core::ImageView mask);

// (1 - SSIM)/2, SSIM as Wang et al. 2004 (11x11 Gaussian, sigma 1.5, K1 0.01, K2 0.03), mean over mask and channels. Statistics are
// taken in windows centred on the masked pixels, which see their surroundings outside the mask too; beyond the border the picture is
// mirrored about its outermost pixels, so that pictures smaller than the window have a value.
double dssim(core::ImageView a, core::ImageView b, core::ImageView mask);

// The mean of flip_map (model/flip.h) over the mask. Pictures of one channel or three; always display-encoded, since it models a screen.
double flip(core::ImageView a, core::ImageView b, core::ImageView mask);

}  // namespace lightstage::model
