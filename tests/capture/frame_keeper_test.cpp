#include "capture/session/frame_keeper.h"

#include <atomic>
#include <catch2/catch.hpp>
#include <chrono>
#include <random>
#include <set>

#include "core/error.h"
#include "core/failure.h"
#include "core/parallel.h"
#include "db/store.h"
#include "support/support.h"

using namespace lightstage;
using capture::FrameKeeper;
using capture::KeptFrame;
namespace fs = std::filesystem;

namespace {

constexpr int kFrames = 200;

KeptFrame numbered(int number, int side = 4) {
  KeptFrame kept;
  kept.camera = "main";
  kept.frame.image = core::Image(side, side, 1);
  kept.frame.sequence_number = number;
  return kept;
}

void sleep_some(std::mt19937& generator) {
  std::this_thread::sleep_for(std::chrono::microseconds(generator() % 400));
}

// More writers than this machine may have processors.
struct Threads {
  Threads() { core::set_thread_count(6); }
  ~Threads() { core::set_thread_count(0); }
};

}  // namespace

TEST_CASE("frames are stored in the order in which they came, however long each takes to write, each once") {
  const Threads threads;
  std::atomic<int> writing = 0, most_writing = 0;
  std::vector<std::int64_t> written(kFrames), stored;
  std::size_t groups = 0;
  FrameKeeper::Target target;
  target.write = [&](KeptFrame& kept) {
    const int now = ++writing;
    for (int most = most_writing; now > most && !most_writing.compare_exchange_weak(most, now);) {
    }
    std::mt19937 generator(unsigned(kept.frame.sequence_number));
    sleep_some(generator);
    ++written[std::size_t(kept.frame.sequence_number)];
    --writing;
  };
  target.store = [&](std::vector<KeptFrame>& frames) {
    ++groups;
    for (const KeptFrame& kept : frames) {
      CHECK(written[std::size_t(kept.frame.sequence_number)] == 1);
      stored.push_back(kept.frame.sequence_number);
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(2));
  };
  {
    FrameKeeper keeper(target);
    for (int i = 0; i < kFrames; ++i) keeper.keep(numbered(i));
    keeper.finish();
    REQUIRE(stored.size() == kFrames);
  }
  for (int i = 0; i < kFrames; ++i) CHECK(stored[std::size_t(i)] == i);
  CHECK(most_writing > 1);
  CHECK(groups < kFrames);  // while some are stored, others are written, and go together
}

TEST_CASE("a frame that cannot be written or stored ends the pass: those before it are stored, none after") {
  const Threads threads;
  for (const bool in_writing : {true, false})
    for (const int bad : {0, 37, kFrames - 1}) {
      INFO(in_writing << " " << bad);
      std::vector<std::int64_t> stored;
      FrameKeeper::Target target;
      target.write = [&](KeptFrame& kept) {
        std::mt19937 generator(unsigned(kept.frame.sequence_number));
        sleep_some(generator);
        if (in_writing && kept.frame.sequence_number == bad) throw core::BadInput("not this one");
      };
      target.store = [&](std::vector<KeptFrame>& frames) {
        for (const KeptFrame& kept : frames) {
          if (!in_writing && kept.frame.sequence_number >= bad) throw core::StoreError("not this one");
        }
        for (const KeptFrame& kept : frames) stored.push_back(kept.frame.sequence_number);
      };
      std::string failure;
      {
        FrameKeeper keeper(target);
        failure = test::failure_of<core::Error>([&] {
          for (int i = 0; i < kFrames; ++i) keeper.keep(numbered(i));
          keeper.finish();
        });
        CHECK_THROWS_AS(keeper.finish(), core::Error);  // and goes on saying so
      }
      CHECK(failure == "not this one");
      REQUIRE(stored.size() <= std::size_t(bad));
      if (in_writing) CHECK(stored.size() == std::size_t(bad));
      for (std::size_t i = 0; i < stored.size(); ++i) CHECK(stored[i] == std::int64_t(i));
    }
}

TEST_CASE("the queue is bounded: whoever brings frames waits for the disk, and loses none") {
  const Threads threads;
  constexpr int kSide = 2048;  // 16 MiB
  constexpr std::size_t kBytes = std::size_t(kSide) * kSide * sizeof(float);
  std::atomic<std::size_t> brought = 0, done = 0, most = 0;
  FrameKeeper::Target target;
  target.write = [](KeptFrame&) {};
  target.store = [&](std::vector<KeptFrame>& frames) {
    std::this_thread::sleep_for(std::chrono::milliseconds(3));
    done += frames.size();
  };
  FrameKeeper keeper(target);
  CHECK(keeper.has_room(std::size_t(1) << 40));  // one is always taken, or it would never be
  for (int i = 0; i < 100; ++i) {
    keeper.keep(numbered(i, kSide));
    ++brought;
    most = std::max(most.load(), brought - done);
  }
  keeper.finish();
  CHECK(done == 100);
  CHECK(most * kBytes <=
        (std::size_t(512) << 20) + 32 * kBytes);  // `done` counts those that the keeper is just giving up
}

TEST_CASE("begun frames are invisible until they are finished, all together, and leave nothing when they are not") {
  const test::TemporaryFolder folder;
  db::Store store = db::Store::create(folder / "store");
  db::NewScan scan;
  scan.name = "head";
  scan.cameras = {"main", "side"};
  for (int i = 0; i < 20; ++i) scan.steps.push_back({.step_index = i, .light_index = i});
  const db::Id id = store.add_scan(scan);
  const auto frame = [&](const char* camera, int step) {
    db::NewFrame wanted;
    wanted.scan_id = id;
    wanted.camera = camera;
    wanted.step_index = step;
    return wanted;
  };
  const auto picture = [](int number) {
    core::Image image(6, 8, 3);
    for (std::size_t i = 0; i < image.values().size(); ++i) image.values()[i] = float(number) + float(i % 16) / 16;
    return image;
  };
  const auto files = [&] {
    std::size_t count = 0;
    for (const auto& entry : fs::recursive_directory_iterator(folder / "store" / "objects")) {
      count += entry.is_regular_file();
    }
    return count;
  };
  std::vector<db::UnsyncedFrame> begun;
  for (int i = 0; i < 20; ++i)
    for (const char* camera : {"main", "side"})
      begun.push_back(store.begin_frame(frame(camera, i), picture(*camera == 's' ? i : -i)));
  CHECK(store.frames(id).empty());
  CHECK(files() == 40);
  CHECK(store.verify().objects == 0);
  const std::vector<db::Id> ids = store.finish_frames(std::move(begun));
  CHECK(std::set<db::Id>(ids.begin(), ids.end()).size() == 40);
  const std::vector<db::Frame> frames = store.frames(id);
  REQUIRE(frames.size() == 40);
  for (const db::Frame& f : frames) {
    CHECK(store.object(f.object) == picture(f.camera == "side" ? f.step_index : -f.step_index));
  }
  CHECK(files() == 39);  // of step 0 both are the same
  CHECK(store.verify().errors.empty());

  SECTION("given up") {
    { const db::UnsyncedFrame lost = store.begin_frame(frame("main", 3), picture(77)); }
    CHECK(files() == 39);
  }
  SECTION("one that does not fit in takes the others with it") {
    std::vector<db::UnsyncedFrame> group;
    group.push_back(store.begin_frame(frame("main", 3), picture(78)));
    group.push_back(store.begin_frame(frame("main", 99), picture(79)));
    CHECK_THROWS_AS(store.finish_frames(std::move(group)), core::BadInput);
    std::vector<db::UnsyncedFrame> sizes;
    sizes.push_back(store.begin_frame(frame("main", 3), core::Image(3, 3, 3)));
    CHECK_THROWS_AS(store.finish_frames(std::move(sizes)), core::BadInput);
    CHECK(store.frames(id)[6].object == frames[6].object);
    CHECK(files() == 39);
  }
  SECTION("a retake replaces") {
    std::vector<db::UnsyncedFrame> again;
    again.push_back(store.begin_frame(frame("side", 3), picture(80)));
    store.finish_frames(std::move(again));
    CHECK(store.object(store.frames(id, "side")[3].object) == picture(80));
    CHECK(store.frames(id).size() == 40);
  }
  SECTION("a picture that is not finite") {
    core::Image bad = picture(1);
    bad(2, 3, 1) = std::nanf("");
    CHECK(test::says(test::failure_of<core::BadInput>([&] { store.begin_frame(frame("main", 1), bad); }),
                     "image to store", "pixel x 3, y 2"));
  }
}
