// CIE L*a*b* and colour differences.
#pragma once

#include <array>

namespace lightstage::calib {

using Triple = std::array<double, 3>;

// L*a*b* relative to D50 of linear Rec. 709 light (white D65 at 1): to XYZ by Rec. 709's primaries, to D50 by Bradford's cone responses (ICC.1:2010,
// annex E), then CIE 15:2004, section 8.2.1. Negative light has the linear part of the curve.
Triple lab_from_rec709(const Triple& rgb);
// Its inverse.
Triple rec709_from_lab(const Triple& lab);

// CIEDE2000 with unit factors, as Sharma, Wu and Dalal 2005 ("The CIEDE2000 color-difference formula: implementation notes, supplementary test data,
// and mathematical observations"): about 1 where two patches side by side can just be told apart.
double delta_e_2000(const Triple& lab1, const Triple& lab2);

}  // namespace lightstage::calib
