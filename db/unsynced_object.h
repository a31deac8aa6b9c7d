// A picture that is written but not yet durable.
#pragma once

#include "core/image.h"
#include "core/unsynced_file.h"
#include "db/content_hash.h"

namespace lightstage::db {

// Nobody sees it before it is finished; given up, it leaves nothing.
struct UnsyncedObject {
  core::UnsyncedFile file;
  ContentHash hash;
  core::ImageSize size;
};

}  // namespace lightstage::db
