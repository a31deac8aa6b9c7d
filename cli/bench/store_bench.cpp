#include "cli/bench/store_bench.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <fstream>

#include "core/error.h"
#include "core/file.h"
#include "core/image_file.h"
#include "core/progress.h"
#include "core/stopwatch.h"
#include "core/unfinished_folder.h"
#include "db/store.h"
#include "model/peak_memory.h"

namespace lightstage::cli {

namespace fs = std::filesystem;

namespace {

constexpr int kLookEvery = 37;  // frames of a round that are compared with what was shown
constexpr std::size_t kFramesSyncedEach = 64;
constexpr core::Nanoseconds kExposure = 2 * core::kMillisecond;

class File {
 public:
  File(const fs::path& path, int flags) : path_(path), descriptor_(::open(path.c_str(), flags | O_CLOEXEC, 0666)) {
    if (descriptor_ < 0) fail();
  }
  ~File() { ::close(descriptor_); }
  File(const File&) = delete;
  File& operator=(const File&) = delete;

  void write(std::span<const unsigned char> bytes) {
    while (!bytes.empty()) {
      const ssize_t n = ::write(descriptor_, bytes.data(), bytes.size());
      if (n < 0 && errno != EINTR) fail();
      if (n > 0) bytes = bytes.subspan(std::size_t(n));
    }
  }
  void sync() {
    if (::fsync(descriptor_) != 0) fail();
  }
  std::size_t read(std::span<char> block) {
    const ssize_t n = ::read(descriptor_, block.data(), block.size());
    if (n < 0) fail();
    return std::size_t(n);
  }
  // What the system holds of the file in memory; clean pages go at once.
  void forget() { ::posix_fadvise(descriptor_, 0, 0, POSIX_FADV_DONTNEED); }
  // Everything that waits to be written on the file's disk.
  void sync_disk() { ::syncfs(descriptor_); }

 private:
  [[noreturn]] void fail() const { throw core::StoreError(path_.string() + ": " + std::strerror(errno)); }
  fs::path path_;
  int descriptor_;
};

std::size_t resident_bytes() {
  std::size_t total = 0, resident = 0;
  std::ifstream("/proc/self/statm") >> total >> resident;
  return resident * std::size_t(::sysconf(_SC_PAGESIZE));
}

// Frames of a round and the same bytes written plainly are not there at the same time, but the disk may free late.
void require_room(const fs::path& folder, const StoreStageOptions& stage) {
  const std::size_t bytes =
      2 * stage.lights * std::size_t(stage.cameras) * 2 * std::size_t(stage.width) * std::size_t(stage.height);
  const std::uintmax_t room = fs::space(folder).available;
  if (room >= bytes) return;
  throw core::StoreError(folder.string() + ": the bench needs " + std::to_string(bytes >> 20) + " MiB at a time, " +
                         std::to_string(room >> 20) +
                         " MiB are free; free some, or take another --folder or fewer --lights");
}

capture::Sequence sequence_of(std::size_t lights) {
  capture::Sequence sequence;
  for (std::size_t i = 0; i < lights; ++i) {
    sequence.steps.push_back({.step_index = int(i), .light_index = int(i), .exposure_ns = kExposure});
  }
  sequence.settle = core::kMillisecond;
  return sequence;
}

class StoreLoad {
 public:
  explicit StoreLoad(const StoreBenchOptions& options)
      : scratch_(options.folder / "lightstage-bench"),
        stage_(options.stage, clock_),
        store_(db::Store::create(scratch_.path() / "store")),
        sequence_(sequence_of(options.stage.lights)),
        per_round_(options.stage.lights * std::size_t(options.stage.cameras)),
        rounds_((options.frames + per_round_ - 1) / per_round_) {
    for (std::size_t c = 0; c < std::size_t(options.stage.cameras); ++c) {
      pictures_.push_back(core::encode_image("frame.exr", stage_.picture(c, 0), {.compressed = false}));
    }
    result_.bytes_per_frame = pictures_.front().size();
  }

  StoreBench run() {
    const model::PeakMemory peak;
    double ingest_s = 0, plain_s = 0;
    for (std::size_t round = 0; round < rounds_; ++round) {
      const double ingest = ingest_round(int(round));
      ingest_s += ingest;
      if (round == std::min<std::size_t>(1, rounds_ - 1)) result_.early_rss_bytes = resident_bytes();
      if (round + 1 == rounds_) {
        result_.late_rss_bytes = resident_bytes();
        result_.peak_rss_bytes = peak.bytes();
        check_round();
      }
      remove_round();
      const double plain = write_plainly();
      plain_s += plain;
      result_.rounds.push_back({double(round_bytes()) / ingest, double(round_bytes()) / plain});
    }
    const double bytes = double(rounds_) * double(round_bytes());
    result_.ingest_bytes_per_s = bytes / ingest_s;
    result_.plain_write_bytes_per_s = bytes / plain_s;
    result_.frames_per_s = double(result_.frames) / ingest_s;
    result_.steps_per_s = double(rounds_ * sequence_.steps.size()) / ingest_s;
    result_.fsync_each_bytes_per_s = write_each();
    return result_;
  }

 private:
  std::size_t round_bytes() const { return per_round_ * result_.bytes_per_frame; }
  std::string name() const { return "bench"; }

  // Nothing of what came before is still on its way to the disk.
  void settle_disk() const { File(scratch_.path(), O_RDONLY | O_DIRECTORY).sync_disk(); }

  double ingest_round(int round) {
    stage_.begin_round(round);
    db::NewScan scan;
    scan.name = name();
    scan.cameras = stage_.camera_names();
    scan.steps = sequence_.steps;
    const db::Id id = store_.add_scan(scan);
    settle_disk();
    const core::Stopwatch watch;
    const capture::SessionReport report = capture::run_session(store_, store_.scan(id), sequence_, stage_.rig());
    const double seconds = watch.seconds();
    result_.frames += report.stored;
    result_.dropped += report.dropped;
    result_.retaken += report.retaken;
    look_at_frames(id);
    return seconds;
  }

  void look_at_frames(db::Id id) {
    const std::vector<std::string> cameras = stage_.camera_names();
    const std::vector<db::Frame> frames = store_.frames(id);
    for (std::size_t i = 0; i < frames.size(); i += kLookEvery) {
      const auto camera = std::find(cameras.begin(), cameras.end(), frames[i].camera) - cameras.begin();
      const std::vector<unsigned char> shown = core::encode_image(
          "frame.exr", stage_.picture(std::size_t(camera), frames[i].step_index), {.compressed = false});
      ++result_.looked_at;
      result_.wrong += db::hash_bytes(shown) != frames[i].object;
    }
  }

  void check_round() {
    std::vector<fs::path> files;
    for (const db::Frame& frame : store_.frames(store_.scan(name()).id)) {
      files.push_back(store_.object_path(frame.object));
    }
    const auto forget = [&] {
      settle_disk();
      for (const fs::path& file : files) File(file, O_RDONLY).forget();
    };
    forget();
    {
      const core::Stopwatch watch;
      const db::VerifyReport report = store_.verify({.scans = {name()}});
      result_.verify_bytes_per_s = double(round_bytes()) / watch.seconds();
      if (!report.errors.empty()) throw core::StoreError("the bench's own store is damaged: " + report.errors.front());
    }
    forget();
    std::vector<char> block(std::size_t(1) << 20);
    const core::Stopwatch watch;
    for (const fs::path& path : files) {
      File file(path, O_RDONLY);
      while (file.read(block) > 0) {
      }
    }
    result_.plain_read_bytes_per_s = double(round_bytes()) / watch.seconds();
  }

  void remove_round() {
    store_.remove_scan(store_.scan(name()).id);
    store_.collect_garbage(std::chrono::seconds(0));
  }

  double write_plainly() {
    const fs::path path = scratch_.path() / "plain";
    settle_disk();
    const core::Stopwatch watch;
    {
      File file(path, O_WRONLY | O_CREAT | O_TRUNC);
      for (std::size_t i = 0; i < per_round_; ++i) file.write(pictures_[i % pictures_.size()]);
      file.sync();
    }
    const double seconds = watch.seconds();
    fs::remove(path);
    return seconds;
  }

  double write_each() {
    const std::size_t count = std::min(per_round_, kFramesSyncedEach);
    settle_disk();
    const core::Stopwatch watch;
    for (std::size_t i = 0; i < count; ++i) {
      File file(scratch_.path() / ("frame" + std::to_string(i)), O_WRONLY | O_CREAT | O_TRUNC);
      file.write(pictures_[i % pictures_.size()]);
      file.sync();
    }
    return double(count * result_.bytes_per_frame) / watch.seconds();
  }

  core::SystemClock clock_;
  core::UnfinishedFolder scratch_;
  StoreStage stage_;
  db::Store store_;
  capture::Sequence sequence_;
  std::size_t per_round_, rounds_;
  std::vector<std::vector<unsigned char>> pictures_;  // of each camera, as they are stored
  StoreBench result_;
};

}  // namespace

StoreBench bench_store(const StoreBenchOptions& options) {
  require_room(options.folder, options.stage);
  return StoreLoad(options).run();
}

}  // namespace lightstage::cli
