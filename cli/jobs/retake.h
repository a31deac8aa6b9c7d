// Taking again what alignment had to leave out.
#pragma once

#include <vector>

#include "db/store.h"

namespace lightstage::cli {

// Steps that, appended to the scan's, take every light again of which some camera has no frame that its newest alignment uses: in the pass's
// order, between tracking frames of their own, as many lights from one to the next as in the pass at most. So the motion is known at that
// time too, and nothing that was taken is replaced. Throws UsageError when there is nothing to take again, for a scan without tracking frames
// or one that is not aligned as it is now, and when frames of it are missing (`capture --resume` comes first).
std::vector<db::Step> retake_steps(const db::Store& store, const db::Scan& scan);

}  // namespace lightstage::cli
