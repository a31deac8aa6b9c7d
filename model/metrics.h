// How far a picture is from the truth. All take display-encoded pictures of equal size in [0, 1] and a mask of one channel (inside where
// > 0.5; empty: everywhere), and are symmetric and 0 for equal pictures, unless they say otherwise. Throw BadInput when sizes differ or the mask
// is empty of pixels. Results do not depend on the thread count.
#pragma once

#include <vector>

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

// MS-SSIM, 1 for equal pictures and 0 at worst: SSIM's contrast and structure at five scales, each half as fine as the one before, and its
// luminance at the coarsest, to the published powers (Wang et al. 2003, "Multi-scale structural similarity for image quality assessment").
// Windows and borders as for dssim; a pixel of a coarser scale weighs as many masked pixels as it stands for. Means that are negative count as 0; channels
// are averaged at the end. Pictures have as many scales, five at most and one at least, as leave 11 pixels along the shorter side, with the powers
// of those scaled to unit sum: all five from 161 pixels on, and below 21 pixels SSIM itself.
double ms_ssim(core::ImageView a, core::ImageView b, core::ImageView mask);

// GMSD, 0 to about 0.5: the standard deviation over the mask of the similarity of gradients of luma at half the size (Xue et al. 2014, "Gradient
// magnitude similarity deviation"). It is 0 as well for errors that are alike everywhere, a constant one among them. Boxes of 2 x 2 pixels weigh
// as many pixels as they have inside the mask; beyond the border pixels are repeated.
double gmsd(core::ImageView a, core::ImageView b, core::ImageView mask);

// The mean of flip_map (model/flip.h) over the mask. Pictures of one channel or three; always display-encoded, since it models a screen.
double flip(core::ImageView a, core::ImageView b, core::ImageView mask);

// HDR-FLIP (Andersson et al. 2021, "Visualizing errors in rendered high dynamic range images"): the mean over the mask of the largest FLIP over
// exposures. Takes linear radiance in any unit, of one channel or three, negative light counting as none; not symmetric, since exposures follow the truth.
// Costs a FLIP an exposure, mostly 4 to 12.
double hdr_flip(core::ImageView truth, core::ImageView picture, core::ImageView mask);

// Its exposures in stops: evenly from where the largest luminance of the truth over the mask is shown as 0.85 to where the median is, about one a stop
// and at least two; over no more than 12 stops, since a median in the shadow of a single light may be 0. Where the truth is black they follow the picture,
// where that is black too there is one.
std::vector<double> hdr_flip_stops(core::ImageView truth, core::ImageView picture, core::ImageView mask);

}  // namespace lightstage::model
