// How much the store takes in and checks, against what the disk can do.
#pragma once

#include <cstddef>
#include <filesystem>
#include <optional>
#include <vector>

#include "cli/bench/store_stage.h"

namespace lightstage::cli {

struct StoreBenchOptions {
  std::filesystem::path folder;  // on the disk to measure; everything goes into a folder in it, which is removed
  std::size_t frames = 20'000;   // rounded up to whole rounds
  StoreStageOptions stage;       // `lights` of a round
};

// Bytes are those of the stored files, per second of wall-clock time.
struct StoreBench {
  std::size_t frames = 0, dropped = 0, retaken = 0;
  std::size_t wrong = 0;  // of those looked at (`looked_at`): frames that do not show their step's light, bit for bit
  std::size_t looked_at = 0;
  double frames_per_s = 0, steps_per_s = 0;
  double ingest_bytes_per_s = 0;
  double plain_write_bytes_per_s = 0;  // the same bytes into one file, one fsync at its end
  double fsync_each_bytes_per_s = 0;   // into a file for each frame, each synced before the next
  double verify_bytes_per_s = 0;       // from the disk: what was cached has been dropped
  double plain_read_bytes_per_s = 0;   // the same files read one after the other, nothing done with them
  std::size_t bytes_per_frame = 0;
  std::size_t early_rss_bytes = 0, late_rss_bytes = 0;  // resident after the second and after the last round
  std::optional<std::size_t> peak_rss_bytes;
  struct Round {
    double ingest_bytes_per_s = 0, plain_write_bytes_per_s = 0;
  };
  std::vector<Round> rounds;

  double ratio() const { return ingest_bytes_per_s / plain_write_bytes_per_s; }
};

// Runs passes as `capture` does (capture::run_session, lockstep) on a StoreStage, into a store, round by round: a round's frames are checked, then removed, so that
// a disk of a few gigabytes suffices; the same bytes are written plainly in between, so that both meet the same disk and neighbours. Throws StoreError when the disk
// has no room for a round.
StoreBench bench_store(const StoreBenchOptions& options);

}  // namespace lightstage::cli
