// `align` through the program: what it refuses and marks, and that it keeps what it says.
#include <SQLiteCpp/SQLiteCpp.h>

#include <catch2/catch.hpp>
#include <chrono>
#include <csignal>
#include <fstream>
#include <limits>
#include <thread>

#include "cli/program.h"
#include "core/error.h"
#include "db/store.h"
#include "support/support.h"

using namespace lightstage;
using test::run_program;

namespace {

nlohmann::json succeed(const std::filesystem::path& store, std::vector<std::string> arguments) {
  arguments.push_back("--json");
  const test::Outcome outcome = run_program(store, arguments);
  INFO(arguments.front() << ": " << outcome.err);
  REQUIRE(outcome.status == 0);
  return outcome.json();
}

// An eye that closes.
void blink(core::Image& picture) {
  for (int y = 48; y < 62; ++y)
    for (int x = 52; x < 72; ++x)
      for (int c = 0; c < picture.channels(); ++c) picture(y, x, c) *= 0.3F;
}

// A pass of 24 lights with a tracking frame every 6th.
struct Pass {
  test::TemporaryFolder folder;
  std::filesystem::path store = folder / "store";

  Pass() {
    const std::string stage = (folder / "stage.toml").string();
    succeed(store, {"init"});
    succeed(store, {"stage", "--lights", "24", "--out", stage});
    succeed(store, {"capture", "--sim", "--procedural", "3", "--stage", stage, "--size", "128", "--tracking-every", "6",
                    "--i-know", "--name", "head"});
  }

  std::vector<db::Frame> tracking_frames(const db::Store& opened) const {
    const db::Scan scan = opened.scan("head");
    std::vector<db::Frame> result;
    for (const db::Frame& frame : opened.frames(scan.id))
      if (scan.steps[std::size_t(frame.step_index)].kind == db::StepKind::kTracking) result.push_back(frame);
    return result;
  }

  template <typename Edit>
  void replace(const db::Frame& frame, const Edit& edit) const {
    db::Store opened = db::Store::open(store);
    core::Image picture = opened.object(frame.object);
    edit(picture);
    opened.put_frame(frame, picture);
  }
};

core::Image shifted(const core::Image& picture, int dx) {
  core::Image result(picture.size());
  for (int y = 0; y < picture.height(); ++y)
    for (int x = std::max(0, dx); x < picture.width(); ++x)
      for (int c = 0; c < picture.channels(); ++c) result(y, x, c) = picture(y, x - dx, c);
  return result;
}

}  // namespace

TEST_CASE_METHOD(Pass, "every flow method and way between tracking frames aligns, on any number of threads alike") {
  for (const char* flow : {"fast", "medium", "dis-ultrafast", "farneback", "tvl1", "deepflow"}) {
    const auto report = succeed(store, {"align", "head", "--flow", flow, "--between", "linear", "--shrink", "2"});
    INFO(flow << ": " << report.dump());
    CHECK(report["aligned"] == 24);
    CHECK(report["excluded"].empty());
    CHECK(report["residual_after"].get<double>() < report["residual_before"].get<double>());
    CHECK(report["believed"].get<double>() > 0.9);
  }
  const auto one = succeed(store, {"align", "head", "--threads", "1"});
  CHECK(succeed(store, {"align", "head", "--threads", "5"}) == one);
  const db::Store opened = db::Store::open(store);
  const std::vector<db::Product> alignments = opened.products("alignment");
  const auto& first = alignments[alignments.size() - 2].images;
  const auto& second = alignments.back().images;
  REQUIRE(first.size() == second.size());
  int aligned = 0, confidence = 0;
  for (std::size_t i = 0; i < first.size(); ++i) {
    CHECK(first[i].object == second[i].object);
    aligned += first[i].role == "aligned";
    confidence += first[i].role == "confidence";
  }
  CHECK(aligned == 24);
  CHECK(confidence == 24);
  CHECK(run_program(store, {"align", "head", "--flow", "slow"}).status == 2);
  CHECK(run_program(store, {"align", "head", "--between", "cubic"}).status == 2);
}

TEST_CASE_METHOD(Pass, "frames beside a blink are marked and left out of what is made of the scan") {
  std::vector<db::Frame> tracking;
  {
    const db::Store opened = db::Store::open(store);
    tracking = tracking_frames(opened);
  }
  REQUIRE(tracking.size() == 5);
  replace(tracking.back(), blink);
  const auto report = succeed(store, {"align", "head"});
  INFO(report.dump());
  CHECK(report["aligned"] == 18);
  CHECK(report["excluded"].size() == 7);  // a tracking frame and the six lights before it
  int lights = 0;
  for (const auto& frame : report["excluded"]) {
    CHECK(frame["reason"].get<std::string>().find("changed in places") != std::string::npos);
    lights += !frame["light"].is_null();
  }
  CHECK(lights == 6);
  const test::Outcome evaluated =
      run_program(store, {"evaluate", "head", "--held-out", "--method", "linear", "--json"});
  INFO(evaluated.err);
  REQUIRE(evaluated.status == 0);
  CHECK(evaluated.err.find("6 frames could not be aligned and are left out") != std::string::npos);
}

TEST_CASE_METHOD(Pass, "lights beside a blink are taken again, and nothing that was taken is replaced") {
  std::vector<db::Frame> before;
  {
    const db::Store opened = db::Store::open(store);
    before = opened.frames(opened.scan("head").id);
  }
  CHECK(run_program(store, {"capture", "--retake", "--name", "head"}).status == 2);  // not aligned yet
  {
    const db::Store opened = db::Store::open(store);
    replace(tracking_frames(opened)[3], blink);
    before = opened.frames(opened.scan("head").id);
  }
  const auto first = succeed(store, {"align", "head"});
  CHECK(first["excluded"].size() == 13);
  CHECK(first["lost_lights"] == std::vector<int>{12, 13, 14, 15, 16, 17, 18, 19, 20, 21, 22, 23});
  CHECK(run_program(store, {"capture", "--retake", "--resume", "--name", "head"}).status == 2);
  CHECK(run_program(store, {"capture", "--retake", "--name", "head", "--tracking-every", "3"}).status == 2);
  const auto retaken = succeed(store, {"capture", "--retake", "--name", "head", "--i-know"});
  CHECK(retaken["taken_again"] == 12);
  CHECK(retaken["stored"] == 15);  // with a tracking frame before every sixth and one at the end
  {
    const db::Store opened = db::Store::open(store);
    const std::vector<db::Frame> after = opened.frames(opened.scan("head").id);
    REQUIRE(after.size() == before.size() + 15);
    for (std::size_t i = 0; i < before.size(); ++i) CHECK(after[i].object == before[i].object);
  }
  // The alignment is older than these frames.
  const test::Outcome stale = run_program(store, {"evaluate", "head", "--held-out", "--method", "nearest"});
  CHECK(stale.status == 5);
  CHECK(stale.err.find("run `lightstage align` again") != std::string::npos);
  CHECK(run_program(store, {"capture", "--retake", "--name", "head"}).status == 2);

  const auto second = succeed(store, {"align", "head"});
  INFO(second.dump());
  CHECK(second["aligned"] == 24);
  CHECK(second["excluded"].size() == 13);
  CHECK(second["lost_lights"].empty());
  const test::Outcome evaluated = run_program(store, {"evaluate", "head", "--accuracy", "--json"});
  INFO(evaluated.err);
  REQUIRE(evaluated.status == 0);
  CHECK(evaluated.err.find("left out") == std::string::npos);
  CHECK(evaluated.json()["alignment"]["median_epe_px"].get<double>() < 0.1);
  CHECK(evaluated.json()["alignment"]["frames"] == 24);
  CHECK(run_program(store, {"capture", "--retake", "--name", "head"}).status == 2);  // nothing is lacking now
  CHECK(run_program(store, {"store", "verify"}).status == 0);
}

TEST_CASE_METHOD(Pass, "a retake that was broken off leaves the scan as usable as it was, and is gone on with") {
  {
    const db::Store opened = db::Store::open(store);
    replace(tracking_frames(opened).back(), blink);
  }
  succeed(store, {"align", "head"});
  {
    // What a process that was killed after the first two frames leaves behind.
    db::Store opened = db::Store::open(store);
    const db::Scan scan = opened.scan("head");
    succeed(store, {"capture", "--retake", "--name", "head", "--i-know"});
    SQLite::Database((store / "store.sqlite").string(), SQLite::OPEN_READWRITE)
        .exec("DELETE FROM frames WHERE step_index >= " + std::to_string(scan.steps.size() + 2));
  }
  // The light that was taken again has no tracking frame after it.
  const auto report = succeed(store, {"align", "head"});
  INFO(report.dump());
  CHECK(report["aligned"] == 18);
  CHECK(report["lost_lights"].size() == 6);
  CHECK(report["excluded"].back()["reason"].get<std::string>().find("was not taken") != std::string::npos);
  CHECK(run_program(store, {"evaluate", "head", "--held-out", "--method", "nearest"}).status == 0);
  CHECK(run_program(store, {"capture", "--retake", "--name", "head"}).status == 2);
  CHECK(succeed(store, {"capture", "--resume", "--name", "head"})["stored"] == 6);
  CHECK(succeed(store, {"align", "head"})["lost_lights"].empty());
}

TEST_CASE_METHOD(Pass, "a subject that moves 40 pixels is refused with advice") {
  std::vector<db::Frame> tracking;
  {
    const db::Store opened = db::Store::open(store);
    tracking = tracking_frames(opened);
  }
  for (const std::size_t i : {0, 1, 3, 4})
    replace(tracking[i], [](core::Image& picture) { picture = shifted(picture, 40); });
  const test::Outcome outcome = run_program(store, {"align", "head"});
  INFO(outcome.err);
  CHECK(outcome.status == 3);
  CHECK(outcome.err.find("head supported") != std::string::npos);
  CHECK(outcome.err.find("--tracking-every") != std::string::npos);
  CHECK(db::Store::open(store).products("alignment").empty());
}

TEST_CASE_METHOD(Pass, "tracking frames that show nothing are not taken for a subject that stands still") {
  std::vector<db::Frame> tracking, dark;
  {
    const db::Store opened = db::Store::open(store);
    tracking = tracking_frames(opened);
    const db::Scan scan = opened.scan("head");
    for (const db::Frame& frame : opened.frames(scan.id))
      if (scan.steps[std::size_t(frame.step_index)].kind == db::StepKind::kDark) dark.push_back(frame);
  }
  const auto fill = [](float value) {
    return [value](core::Image& picture) { std::fill(picture.values().begin(), picture.values().end(), value); };
  };
  const auto refused = [&](const std::string& why) {
    const test::Outcome outcome = run_program(store, {"align", "head"});
    INFO(outcome.err);
    CHECK(outcome.status == 3);
    CHECK(outcome.err.find(why) != std::string::npos);
    CHECK(db::Store::open(store).products("alignment").empty());
  };
  SECTION("all black") {
    for (const db::Frame& frame : tracking) replace(frame, fill(0));
    refused("is black");
  }
  SECTION("the key frame saturated") {
    replace(tracking[2], fill(float(tracking[2].saturation)));
    refused("key frame (step 18)");
  }
  SECTION("all others saturated") {
    for (const std::size_t i : {0, 1, 3, 4}) replace(tracking[i], fill(float(tracking[i].saturation)));
    refused("cannot be aligned");
  }
  SECTION("dark frames brighter than the lit ones") {
    for (const db::Frame& frame : dark) replace(frame, fill(50));
    refused("once the dark frames are subtracted");
  }
}

TEST_CASE_METHOD(
    Pass, "values that are not finite do not come into the store, and a frame they were written into is refused") {
  std::vector<db::Frame> tracking, lights;
  {
    const db::Store opened = db::Store::open(store);
    tracking = tracking_frames(opened);
    const db::Scan scan = opened.scan("head");
    for (const db::Frame& frame : opened.frames(scan.id))
      if (scan.steps[std::size_t(frame.step_index)].kind == db::StepKind::kLight) lights.push_back(frame);
  }
  const auto with = [&](float value) {
    replace(tracking[1], [value](core::Image& picture) { picture(20, 30, 1) = value; });
  };
  CHECK_THROWS_AS(with(std::numeric_limits<float>::quiet_NaN()), core::BadInput);
  CHECK_THROWS_AS(with(-std::numeric_limits<float>::infinity()), core::BadInput);
  const auto refused = [&](const db::Frame& frame) {
    {
      std::fstream file(db::Store::open(store).object_path(frame.object),
                        std::ios::binary | std::ios::in | std::ios::out);
      const float nan = std::numeric_limits<float>::quiet_NaN();
      file.seekp(-std::streamoff(sizeof nan), std::ios::end);
      file.write(reinterpret_cast<const char*>(&nan), sizeof nan);
      REQUIRE(file.good());
    }
    const test::Outcome outcome = run_program(store, {"align", "head", "--quiet"});
    INFO(outcome.err);
    CHECK(outcome.status == 5);
    CHECK(std::count(outcome.err.begin(), outcome.err.end(), '\n') == 1);
    CHECK(outcome.err.find(frame.object.hex() + " is damaged") != std::string::npos);
    CHECK(db::Store::open(store).products("alignment").empty());
  };
  // Each is read before those that are damaged already.
  refused(lights[5]);
  refused(tracking[1]);
  refused(tracking[2]);
}

TEST_CASE_METHOD(Pass, "pictures of a pixel and of three columns are refused in one line") {
  std::vector<db::Frame> frames;
  {
    const db::Store opened = db::Store::open(store);
    frames = opened.frames(opened.scan("head").id);
  }
  for (const auto& [height, width] : {std::pair{1, 1}, std::pair{3, 200}, std::pair{200, 3}}) {
    // All of a camera's frames have one size, and the simulator's mask is of it.
    SQLite::Database((store / "store.sqlite").string(), SQLite::OPEN_READWRITE)
        .exec("PRAGMA foreign_keys = ON; DELETE FROM frames; DELETE FROM products WHERE kind = 'mask'");
    for (const db::Frame& frame : frames) {
      db::Store opened = db::Store::open(store);
      const core::Image picture = opened.object(frame.object);
      core::Image small(height, width, 3);
      for (int y = 0; y < height; ++y)
        for (int x = 0; x < width; ++x) std::copy_n(picture.pixel(40 + y % 48, 40 + x % 48), 3, small.pixel(y, x));
      opened.put_frame(frame, small);
    }
    for (const bool robust : {false, true}) {
      std::vector<std::string> arguments{"align", "head", "--quiet"};
      if (robust) arguments.emplace_back("--robust");
      const test::Outcome outcome = run_program(store, arguments);
      INFO(height << " x " << width << (robust ? ", robust: " : ": ") << outcome.err);
      CHECK(outcome.status == 3);
      CHECK(std::count(outcome.err.begin(), outcome.err.end(), '\n') == 1);
      CHECK(db::Store::open(store).products("alignment").empty());
    }
  }
}

TEST_CASE_METHOD(Pass, "a subject without texture is aligned by its outline, or left as it is") {
  std::vector<db::Frame> tracking;
  {
    const db::Store opened = db::Store::open(store);
    tracking = tracking_frames(opened);
  }
  for (std::size_t i = 0; i < tracking.size(); ++i) {
    replace(tracking[i], [&](core::Image& picture) {
      for (int y = 0; y < picture.height(); ++y)
        for (int x = 0; x < picture.width(); ++x)
          for (int c = 0; c < 3; ++c) picture(y, x, c) = std::hypot(y - 64.0, x - 64.0 - double(i)) < 40 ? 0.4F : 0.0F;
    });
  }
  const auto report = succeed(store, {"align", "head"});
  INFO(report.dump());
  CHECK(report["aligned"] == 24);
  CHECK(report["largest_motion_px"].get<double>() < 3);
}

TEST_CASE_METHOD(Pass, "Ctrl-C in mid alignment leaves the scan as it was, and it can be aligned again") {
  const auto objects = [&] {
    using Files = std::filesystem::recursive_directory_iterator;
    return std::count_if(Files(store / "objects"), Files(), [](const auto& entry) { return entry.is_regular_file(); });
  };
  const auto captured = objects();
  test::BackgroundRun run(store, {"align", "head", "--flow", "tvl1", "--threads", "1", "--quiet"});
  const auto deadline = std::chrono::steady_clock::now() + std::chrono::seconds(120);
  while (objects() == captured && std::chrono::steady_clock::now() < deadline)
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  REQUIRE(objects() > captured);  // the first flow of five is stored
  run.signal(SIGINT);
  const int status = run.wait();
  // This process may have been held up so long that all was done when the signal came.
  REQUIRE((status == 130 || status == 0));
  CHECK(db::Store::open(store).products("alignment").size() == (status == 0 ? 1 : 0));
  CHECK(run_program(store, {"evaluate", "head", "--held-out", "--method", "nearest"}).status == 0);
  CHECK(succeed(store, {"align", "head"})["aligned"] == 24);
  CHECK(succeed(store, {"store", "verify"})["ok"] == true);
}

TEST_CASE("a set without tracking frames is registered on demand, and says that this is weaker") {
  const test::TemporaryFolder folder;
  const std::filesystem::path store = folder / "store";
  const std::string stage = (folder / "stage.toml").string();
  succeed(store, {"init"});
  succeed(store, {"stage", "--lights", "40", "--out", stage});
  succeed(store, {"capture", "--sim", "--procedural", "3", "--stage", stage, "--size", "96", "--tracking-every", "0",
                  "--name", "head"});
  const test::Outcome refused = run_program(store, {"align", "head"});
  CHECK(refused.status == 2);
  CHECK(refused.err.find("--robust") != std::string::npos);
  const test::Outcome said = run_program(store, {"align", "head", "--robust"});
  INFO(said.err);
  REQUIRE(said.status == 0);
  CHECK(said.out.find("weaker") != std::string::npos);
  const auto report = succeed(store, {"align", "head", "--robust"});
  CHECK(report["aligned"].get<int>() + int(report["excluded"].size()) == 40);
  CHECK(report["aligned"].get<int>() > 30);
  CHECK(run_program(store, {"align", "head", "--robust", "--flow", "fast"}).status == 2);
  CHECK(run_program(store, {"evaluate", "head", "--held-out", "--method", "nearest"}).status == 0);
}
