// Cameras behind another driver than uvcvideo: every format, what the driver grants instead of what it was asked for, and
// faults that it injects. Under emulation vivid repeats and skips frames by itself: nothing here counts on its timing.
#include <catch2/catch.hpp>

#include <set>

#include "capture/v4l2_cameras.h"
#include "core/error.h"
#include "hil/scenarios/report_line.h"
#include "hil/scenarios/vivid.h"

namespace lightstage::hil {

namespace {

// Of the few sizes that the driver has the smallest.
constexpr int kWidth = 320, kHeight = 180;

core::Nanoseconds soon(const core::Clock& clock) {
  return clock.now() + 3 * core::kSecond;
}

struct OpenVivid {
  explicit OpenVivid(int index, const std::string& pixel_format = "GREY")
      : driver(index),
        camera(capture::open_v4l2_camera(driver.camera(kWidth, kHeight), driver.device(pixel_format), clock)) {}

  std::optional<capture::CameraFrame> frame() { return camera->wait_frame(soon(clock)); }

  core::SystemClock clock;
  Vivid driver;
  std::unique_ptr<capture::Camera> camera;
};

}  // namespace

TEST_CASE("vivid: every format that the driver has shows the same picture", "[vivid]") {
  ReportLine report("vivid_formats");
  core::SystemClock clock;
  Vivid driver(0);
  driver.choose("Test Pattern", "100% Red");
  std::set<std::string> seen;
  for (const capture::V4l2CameraSeen& camera : capture::v4l2_cameras_seen()) {
    if (camera.node != driver.node()) continue;
    for (const capture::V4l2Format& format : camera.formats) {
      if (!format.refused.empty()) continue;
      INFO(format.pixel_format);
      const auto opened =
          capture::open_v4l2_camera(driver.camera(kWidth, kHeight), driver.device(format.pixel_format), clock);
      const auto frame = opened->wait_frame(soon(clock));
      REQUIRE(frame);
      report.add_frame();
      const float* pixel = frame->image.view().pixel(kHeight / 2, kWidth / 2);
      if (frame->image.channels() == 3) {
        CHECK(pixel[0] > 0.9f * static_cast<float>(frame->saturation));
        CHECK(pixel[1] < 0.1f * pixel[0]);
        CHECK(pixel[2] < 0.1f * pixel[0]);
      } else {
        // The luma of full red.
        CHECK(pixel[0] / static_cast<float>(frame->saturation) == Approx(0.25).margin(0.1));
      }
      seen.insert(format.pixel_format);
    }
  }
  for (const char* needed :
       {"GREY", "Y10", "Y12", "Y16", "RGB3", "YUYV", "RGGB", "GRBG", "GBRG", "BA81", "RG10", "BG12", "RG16"}) {
    CHECK(seen.contains(needed));
  }
  report.pass();
}

TEST_CASE("vivid: what the driver grants instead is refused", "[vivid]") {
  ReportLine report("vivid_fallbacks");
  core::SystemClock clock;
  Vivid driver(0);
  // It falls back on another size without a word, and on YUYV for a packed format that it does not have.
  CHECK_THROWS_AS(capture::open_v4l2_camera(driver.camera(300, 200), driver.device("GREY"), clock), core::DeviceError);
  CHECK_THROWS_AS(capture::open_v4l2_camera(driver.camera(kWidth, kHeight), driver.device("Y10P"), clock),
                  core::DeviceError);
  CHECK_THROWS_AS(capture::open_v4l2_camera(driver.camera(kWidth, kHeight), driver.device("MJPG"), clock),
                  core::BadInput);
  // It has no exposure control.
  const auto camera = capture::open_v4l2_camera(driver.camera(kWidth, kHeight), driver.device("GREY"), clock);
  CHECK_THROWS_AS(camera->set_exposure(5 * core::kMillisecond), core::DeviceError);
  report.add_fault(4);
  report.pass();
}

TEST_CASE("vivid: injected faults are reported, and the camera comes back", "[vivid]") {
  ReportLine report("vivid_faults");
  OpenVivid vivid(1);
  REQUIRE(vivid.frame());

  vivid.driver.set("Inject V4L2_BUF_FLAG_ERROR", 1);
  bool damaged = false;
  for (int i = 0; i < 30 && !damaged; ++i) {
    const auto frame = vivid.frame();
    REQUIRE(frame);
    damaged = frame->damaged;
  }
  CHECK(damaged);

  for (const char* fault : {"Inject Fatal Streaming Error", "Disconnect"}) {
    INFO(fault);
    vivid.driver.set(fault, 1);
    const auto until_it_fails = [&] {
      for (int i = 0; i < 30; ++i) vivid.frame();
    };
    CHECK_THROWS_AS(until_it_fails(), core::DeviceError);
    const auto frame = vivid.frame();
    REQUIRE(frame);
    CHECK_FALSE(frame->damaged);
  }
  report.add_fault(3);
  report.pass();
}

TEST_CASE("vivid: sequence numbers go on where the driver's wrap", "[vivid]") {
  ReportLine report("vivid_wrap");
  core::SystemClock clock;
  Vivid driver(2);
  driver.set("Wrap Sequence Number", 1);
  const auto camera = capture::open_v4l2_camera(driver.camera(kWidth, kHeight), driver.device("GREY"), clock);
  std::optional<std::int64_t> first;
  std::int64_t last = 0;
  // They start 128 before the wrap. Repeats and gaps are the driver's; what matters is that no number leaps.
  for (int i = 0; i < 400 && (!first || last < *first + 160); ++i) {
    const auto frame = camera->wait_frame(soon(clock));
    REQUIRE(frame);
    report.add_frame();
    if (first) REQUIRE(std::abs(frame->sequence_number - last) < 100);
    if (!first) first = frame->sequence_number;
    last = frame->sequence_number;
  }
  CHECK(last >= *first + 160);
  report.pass();
}

TEST_CASE("vivid: four cameras at once", "[vivid]") {
  ReportLine report("vivid_four");
  std::vector<std::unique_ptr<OpenVivid>> cameras;
  for (int i = 0; i < 4; ++i) cameras.push_back(std::make_unique<OpenVivid>(i));
  for (int round = 0; round < 10; ++round) {
    for (const auto& camera : cameras) {
      const auto frame = camera->frame();
      REQUIRE(frame);
      CHECK(frame->image.width() == kWidth);
      CHECK(frame->timestamp <= camera->clock.now());
      report.add_frame();
    }
  }
  report.pass();
}

}  // namespace lightstage::hil
