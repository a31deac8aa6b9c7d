// Masks of captured scans.
#pragma once

#include "db/store.h"

namespace lightstage::cli {

// Finds the subject in the key frame of every camera (cli/jobs/provenance.h) and stores a "mask" product for each. Does nothing where
// the sequence has no frame under full light.
void store_subject_masks(db::Store& store, const db::Scan& scan);

}  // namespace lightstage::cli
