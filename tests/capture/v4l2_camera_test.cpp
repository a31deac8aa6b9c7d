#include "capture/v4l2/v4l2_camera.h"

#include <poll.h>

#include <catch2/catch.hpp>
#include <cerrno>
#include <random>

#include "capture/v4l2/video_stream.h"
#include "core/error.h"
#include "v4l2_fake_video.h"

using namespace lightstage;
using namespace lightstage::capture;
using Catch::Matchers::Contains;
using core::kMillisecond;
using core::kSecond;
using test::FakeCamera;
using test::FakeControl;
using test::FakeFrame;

namespace {

constexpr int kWidth = 8, kHeight = 6;

// One camera "left", Y16, 8 x 6 pixels, of responsivity 10.
struct Bench {
  Bench() {
    stage_camera.name = "left";
    stage_camera.model.width = kWidth;
    stage_camera.model.height = kHeight;
    stage_camera.responsivity = 10;
    device.match = "S1";
    device.pixel_format = "Y16";
    device.gain = 20;
    video.cameras = {fake};
    clock.sleep_until(100 * kSecond);
  }

  std::unique_ptr<V4l2Camera> open() { return std::make_unique<V4l2Camera>(video, clock, stage_camera, device); }

  // A picture of one value, ready now.
  FakeFrame& deliver(int value, std::uint32_t sequence) {
    FakeFrame frame;
    frame.bytes = test::flat_picture(kWidth, kHeight, 2, value, fake->row_padding);
    frame.sequence = sequence;
    frame.timestamp = frame.ready = clock.now();
    fake->frames.push_back(std::move(frame));
    return fake->frames.back();
  }

  std::int64_t control(std::uint32_t id) const { return fake->controls.at(id).value; }

  core::VirtualClock clock;
  test::FakeVideo video{clock};
  std::shared_ptr<FakeCamera> fake = test::uvc_camera("/dev/video0", "S1", "usb-0000:00:14.0-1");
  StageCamera stage_camera;
  CameraDevice device;
};

const auto names_camera = Contains("camera 'left'");

}  // namespace

TEST_CASE("opening sets format, gain and rate, and switches off what a camera does by itself", "[v4l2]") {
  Bench bench;
  const auto camera = bench.open();
  CHECK(camera->name() == "left");
  CHECK(bench.fake->format.pixelformat == V4L2_PIX_FMT_Y16);
  CHECK(bench.control(V4L2_CID_EXPOSURE_AUTO) == V4L2_EXPOSURE_MANUAL);
  CHECK(bench.control(V4L2_CID_EXPOSURE_AUTO_PRIORITY) == 0);
  CHECK(bench.control(V4L2_CID_AUTO_WHITE_BALANCE) == 0);
  CHECK(bench.control(V4L2_CID_FOCUS_AUTO) == 0);
  CHECK(bench.control(V4L2_CID_GAIN) == 20);
  CHECK(bench.fake->interval.denominator == 60);
  CHECK(bench.fake->streaming);
  CHECK(camera->frame_period() == 16'666'667);
}

TEST_CASE("closing stops the stream and lets go of everything", "[v4l2]") {
  Bench bench;
  bench.open();
  CHECK_FALSE(bench.fake->streaming);
  CHECK(bench.video.open_descriptors() == 0);
  CHECK(bench.video.mappings() == 0);
}

TEST_CASE("a frame is radiance, with number and time; its buffer goes back to the driver", "[v4l2]") {
  for (const bool mmap : {true, false}) {
    for (const std::size_t padding : {std::size_t(0), std::size_t(6)}) {
      Bench bench;
      bench.fake->has_mmap = mmap;
      bench.fake->row_padding = padding;
      const auto camera = bench.open();
      CHECK(bench.fake->memory == (mmap ? V4L2_MEMORY_MMAP : V4L2_MEMORY_USERPTR));
      camera->set_exposure(10 * kMillisecond);
      CHECK(bench.control(V4L2_CID_EXPOSURE_ABSOLUTE) == 100);
      for (std::uint32_t i = 0; i < 40; ++i) {
        bench.deliver(static_cast<int>(1000 * i), i);
        const std::optional<CameraFrame> frame = camera->wait_frame(bench.clock.now());
        REQUIRE(frame);
        CHECK(frame->sequence_number == i);
        CHECK(frame->timestamp == bench.clock.now());
        CHECK_FALSE(frame->damaged);
        CHECK(frame->saturation == Approx(1 / (10 * 0.01)));
        REQUIRE(frame->image.size() == core::ImageSize{kHeight, kWidth, 1});
        for (const float value : frame->image.values()) REQUIRE(value == Approx(1000 * i / 65535.0 * 10).margin(1e-7));
        REQUIRE(bench.fake->queued.size() == 8);
      }
      CHECK(bench.fake->stream_starts == 1);
    }
  }
}

TEST_CASE("waiting ends at the deadline, or when a frame comes", "[v4l2]") {
  Bench bench;
  const auto camera = bench.open();
  const core::Nanoseconds start = bench.clock.now();
  CHECK_FALSE(camera->wait_frame(start - kSecond));
  CHECK(bench.clock.now() == start);
  CHECK_FALSE(camera->wait_frame(start + kSecond));
  CHECK(bench.clock.now() == start + kSecond);
  bench.deliver(1, 0).ready = start + kSecond + 7;
  CHECK(camera->wait_frame(start + 2 * kSecond));
  CHECK(bench.clock.now() == start + kSecond + 7);
}

TEST_CASE("a format that is granted otherwise is refused by both names", "[v4l2]") {
  Bench bench;
  SECTION("another pixel format") {
    bench.fake->grant_format = [](v4l2_pix_format& format) { format.pixelformat = V4L2_PIX_FMT_YUYV; };
    CHECK_THROWS_WITH(bench.open(), names_camera && Contains("Y16 8x6") && Contains("YUYV 8x6"));
  }
  SECTION("another size") {
    bench.fake->grant_format = [](v4l2_pix_format& format) { format.width = 640, format.height = 480; };
    CHECK_THROWS_WITH(bench.open(), names_camera && Contains("Y16 8x6") && Contains("Y16 640x480"));
  }
  SECTION("interlaced") {
    bench.fake->grant_format = [](v4l2_pix_format& format) { format.field = V4L2_FIELD_INTERLACED; };
    CHECK_THROWS_WITH(bench.open(), names_camera && Contains("interlaced"));
  }
  SECTION("a colour encoding that cannot be undone") {
    bench.device.pixel_format = "YUYV";
    bench.fake->grant_format = [](v4l2_pix_format& format) { format.xfer_func = V4L2_XFER_FUNC_SMPTE2084; };
    CHECK_THROWS_WITH(bench.open(), names_camera && Contains("transfer function"));
  }
  CHECK_THROWS_AS(bench.open(), core::DeviceError);
  CHECK(bench.video.open_descriptors() == 0);
}

TEST_CASE("what cannot be measured in is refused before a device is touched", "[v4l2]") {
  Bench bench;
  bench.device.pixel_format = "MJPG";
  CHECK_THROWS_AS(bench.open(), core::BadInput);
  CHECK_THROWS_WITH(bench.open(), names_camera && Contains("compressed with loss"));
  bench.device.pixel_format = "what";
  CHECK_THROWS_WITH(bench.open(), Contains("not one of the raw formats"));
  bench.device.pixel_format = "GREYER";
  CHECK_THROWS_WITH(bench.open(), Contains("four characters"));
  CHECK(bench.fake->opened == 0);
}

TEST_CASE("exposures are never rounded or clamped without a word", "[v4l2]") {
  Bench bench;
  const auto camera = bench.open();
  camera->set_exposure(kMillisecond);
  CHECK_THROWS_WITH(camera->set_exposure(333'333), names_camera && Contains("0.3 ms") && Contains("0.4 ms"));
  CHECK_THROWS_WITH(camera->set_exposure(50'000), Contains("from 0.1 ms to 500 ms"));
  CHECK_THROWS_WITH(camera->set_exposure(501 * kMillisecond), Contains("from 0.1 ms to 500 ms"));
  CHECK_THROWS_WITH(camera->set_exposure(499'999'999), Contains("499.9 ms and 500 ms"));
  CHECK(bench.control(V4L2_CID_EXPOSURE_ABSOLUTE) == 10);

  SECTION("steps that do not start at 0") {
    FakeControl& exposure = bench.fake->controls[V4L2_CID_EXPOSURE_ABSOLUTE];
    exposure.minimum = 3, exposure.step = 5;
    camera->set_exposure(1'300'000);
    CHECK(exposure.value == 13);
    CHECK_THROWS_WITH(camera->set_exposure(kMillisecond), Contains("0.8 ms and 1.3 ms"));
  }
  SECTION("a driver that clamps below its own limit") {
    bench.fake->controls[V4L2_CID_EXPOSURE_ABSOLUTE].grants = 300;
    CHECK_THROWS_WITH(camera->set_exposure(40 * kMillisecond), names_camera && Contains("400") && Contains("300"));
  }
  // The frames still have the exposure that was last granted.
  bench.deliver(65535, 0);
  CHECK(camera->wait_frame(bench.clock.now())->saturation ==
        Approx(1 / (10 * 1e-7 *
                    static_cast<double>(std::min<std::int64_t>(
                        bench.control(V4L2_CID_EXPOSURE_ABSOLUTE) == 13 ? 13000 : 10000, 13000)))));
}

TEST_CASE("a camera whose exposure cannot be set in units of time says so", "[v4l2]") {
  Bench bench;
  bench.fake->controls.erase(V4L2_CID_EXPOSURE_ABSOLUTE);
  const auto camera = bench.open();
  CHECK_THROWS_WITH(camera->set_exposure(kMillisecond), names_camera && Contains("no exposure control"));
  bench.fake->controls[V4L2_CID_EXPOSURE] = {"Exposure", V4L2_CTRL_TYPE_INTEGER, 1, 1000, 1, 5};
  CHECK_THROWS_WITH(camera->set_exposure(kMillisecond), Contains("units of its own only"));
  // Its frames come all the same, scaled as if by a second.
  bench.deliver(65535, 0);
  CHECK(camera->wait_frame(bench.clock.now())->saturation == Approx(0.1));
}

TEST_CASE("gain that is clamped, or missing, is refused", "[v4l2]") {
  Bench bench;
  bench.device.gain = 101;
  CHECK_THROWS_WITH(bench.open(), names_camera && Contains("101") && Contains("stands at 100"));
  bench.device.gain = 7;
  bench.fake->controls.erase(V4L2_CID_GAIN);
  CHECK_THROWS_WITH(bench.open(), names_camera && Contains("no gain"));
  bench.fake->controls[V4L2_CID_ANALOGUE_GAIN] = {"Analogue Gain", V4L2_CTRL_TYPE_INTEGER, 0, 480, 1, 100};
  bench.open();
  CHECK(bench.control(V4L2_CID_ANALOGUE_GAIN) == 7);
}

TEST_CASE("something automatic that stays on is refused", "[v4l2]") {
  Bench bench;
  bench.fake->controls[V4L2_CID_AUTO_WHITE_BALANCE].grants = 1;
  CHECK_THROWS_WITH(bench.open(), names_camera && Contains("White Balance, Automatic"));
}

TEST_CASE("the frame rate gives way to the exposure, once", "[v4l2]") {
  Bench bench;
  const auto camera = bench.open();
  camera->set_exposure(10 * kMillisecond);
  CHECK(bench.fake->stream_starts == 1);
  camera->set_exposure(20 * kMillisecond);
  CHECK(bench.fake->stream_starts == 2);
  CHECK(camera->frame_period() == 33'333'333);
  camera->set_exposure(kMillisecond);
  camera->set_exposure(20 * kMillisecond);
  CHECK(bench.fake->stream_starts == 2);
  CHECK(camera->frame_period() == 33'333'333);
  // Longer than any rate allows: a trigger can wait.
  camera->set_exposure(400 * kMillisecond);
  camera->set_exposure(300 * kMillisecond);
  CHECK(bench.fake->stream_starts == 3);
  CHECK(camera->frame_period() == 300 * kMillisecond);
}

TEST_CASE("a range of frame rates gives the exposure its exact time", "[v4l2]") {
  Bench bench;
  bench.fake->intervals = {{1, 200}, {1, 2}};
  bench.fake->interval_range = true;
  const auto camera = bench.open();
  CHECK(camera->frame_period() == 5 * kMillisecond);
  camera->set_exposure(12'300'000);
  CHECK(camera->frame_period() == 12'300'000);
}

TEST_CASE("a frame rate that is granted otherwise is refused", "[v4l2]") {
  Bench bench;
  bench.fake->grant_interval = v4l2_fract{1, 15};
  CHECK_THROWS_WITH(bench.open(), names_camera && Contains("asked for 60 frames a second it grants 15"));
}

TEST_CASE("a driver that tells no rates runs triggered, not free", "[v4l2]") {
  Bench bench;
  bench.fake->intervals.clear();
  auto camera = bench.open();
  camera->set_exposure(7 * kMillisecond);
  CHECK(camera->frame_period() == 7 * kMillisecond);
  camera.reset();
  bench.device.triggered = false;
  CHECK_THROWS_WITH(bench.open(), names_camera && Contains("frame rate"));
}

TEST_CASE("without a trigger control a camera is what the stage file says", "[v4l2]") {
  Bench bench;
  SECTION("triggered") {
    const auto camera = bench.open();
    CHECK_NOTHROW(camera->set_exposing(Exposing::kTriggered));
    CHECK_THROWS_WITH(camera->set_exposing(Exposing::kFreeRunning),
                      names_camera && Contains("no control that switches"));
    bench.deliver(1, 0);
    CHECK(camera->wait_frame(bench.clock.now()));
    CHECK(bench.fake->stream_starts == 1);
  }
  SECTION("free") {
    bench.device.triggered = false;
    const auto camera = bench.open();
    CHECK_NOTHROW(camera->set_exposing(Exposing::kFreeRunning));
    CHECK_THROWS_WITH(camera->set_exposing(Exposing::kTriggered), names_camera && Contains("triggered = false"));
    CHECK_THROWS_WITH(camera->set_exposure(101 * kMillisecond),
                      names_camera && Contains("every 100 ms at its slowest"));
    CHECK_NOTHROW(camera->set_exposure(100 * kMillisecond));
    CHECK(camera->frame_period() == 100 * kMillisecond);
  }
}

TEST_CASE("a trigger control is set, by whatever name it goes", "[v4l2]") {
  Bench bench;
  const std::uint32_t id = V4L2_CID_USER_BASE + 0x1200;
  std::int64_t on = 1, off = 0;
  SECTION("a switch") {
    bench.fake->controls[id] = {"trigger_mode", V4L2_CTRL_TYPE_BOOLEAN, 0, 1, 1, 0, V4L2_CTRL_FLAG_GRABBED};
  }
  SECTION("a number") {
    bench.fake->controls[id] = {"External Trigger", V4L2_CTRL_TYPE_INTEGER, 0, 7, 1, 5};
  }
  SECTION("a menu") {
    on = 3, off = 2;
    bench.fake->controls[id] = {"Trigger Mode", V4L2_CTRL_TYPE_MENU, 0, 3, 1, 0};
    bench.fake->controls[id].menu = {{0, "Software"}, {2, "Free run"}, {3, "External"}};
  }
  const auto camera = bench.open();
  CHECK(bench.control(id) == on);
  camera->set_exposure(20 * kMillisecond);
  camera->set_exposing(Exposing::kFreeRunning);
  CHECK(bench.control(id) == off);
  CHECK(bench.fake->streaming);
  camera->set_exposing(Exposing::kTriggered);
  CHECK(bench.control(id) == on);
  const int starts = bench.fake->stream_starts;
  camera->set_exposing(Exposing::kTriggered);
  CHECK(bench.fake->stream_starts == starts);
  // Too long for any rate: running free is refused before anything changes.
  camera->set_exposure(200 * kMillisecond);
  CHECK_THROWS_WITH(camera->set_exposing(Exposing::kFreeRunning), Contains("at its slowest"));
  CHECK(bench.control(id) == on);
  CHECK(bench.fake->streaming);
}

TEST_CASE("sequence numbers: wraps are steps, gaps and repeats stay", "[v4l2]") {
  Bench bench;
  const auto camera = bench.open();
  std::vector<std::int64_t> numbers;
  for (const std::uint32_t sequence : {0xfffffffeu, 0xffffffffu, 0u, 0u, 3u, 2u, 4u}) {
    bench.deliver(1, sequence);
    numbers.push_back(camera->wait_frame(bench.clock.now())->sequence_number);
  }
  CHECK(numbers == std::vector<std::int64_t>{0, 1, 2, 2, 5, 4, 6});
}

TEST_CASE("flagged and short frames are damaged, and show what came", "[v4l2]") {
  Bench bench;
  const auto camera = bench.open();
  bench.deliver(65535, 0).flags |= V4L2_BUF_FLAG_ERROR;
  CHECK(camera->wait_frame(bench.clock.now())->damaged);
  bench.deliver(65535, 1).bytes.resize(kWidth * kHeight);
  const CameraFrame half = camera->wait_frame(bench.clock.now()).value();
  CHECK(half.damaged);
  CHECK(half.image(0, 0) == Approx(half.saturation));
  CHECK(half.image(kHeight - 1, 0) == 0);
  bench.deliver(65535, 2).bytes.clear();
  CHECK(camera->wait_frame(bench.clock.now())->damaged);
  bench.deliver(65535, 3);
  CHECK_FALSE(camera->wait_frame(bench.clock.now())->damaged);
}

TEST_CASE("time stamps become starts of exposures on the session's clock", "[v4l2]") {
  Bench bench;
  bench.device.timestamp_offset = -3 * kMillisecond;
  const auto camera = bench.open();
  camera->set_exposure(10 * kMillisecond);
  bench.clock.sleep_until(bench.clock.now() + kSecond);
  const core::Nanoseconds now = bench.clock.now();
  bench.deliver(1, 0).timestamp = now - kMillisecond;
  CHECK(camera->wait_frame(now)->timestamp == now - 4 * kMillisecond);
  FakeFrame& end = bench.deliver(1, 1);
  end.timestamp = now;
  end.flags = V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC | V4L2_BUF_FLAG_TSTAMP_SRC_EOF;
  CHECK(camera->wait_frame(now)->timestamp == now - 13 * kMillisecond);
  bench.deliver(1, 2).flags = V4L2_BUF_FLAG_TIMESTAMP_UNKNOWN;
  CHECK_THROWS_WITH(camera->wait_frame(now), names_camera && Contains("monotonic"));
}

TEST_CASE("a frame that was exposed before the exposure changed keeps the radiance of its own", "[v4l2]") {
  Bench bench;
  const auto camera = bench.open();
  camera->set_exposure(10 * kMillisecond);
  bench.clock.sleep_until(bench.clock.now() + kSecond);
  const core::Nanoseconds before = bench.clock.now();
  bench.clock.sleep_until(before + 5 * kMillisecond);
  camera->set_exposure(kMillisecond);
  bench.deliver(65535, 0).timestamp = before;
  CHECK(camera->wait_frame(bench.clock.now())->saturation == Approx(10));
  FakeFrame& end = bench.deliver(65535, 1);
  end.timestamp = before + kMillisecond / 2;
  end.flags = V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC | V4L2_BUF_FLAG_TSTAMP_SRC_EOF;
  const CameraFrame ended = camera->wait_frame(bench.clock.now()).value();
  CHECK(ended.saturation == Approx(10));
  CHECK(ended.timestamp == before + kMillisecond / 2 - 10 * kMillisecond);
  bench.deliver(65535, 2);
  CHECK(camera->wait_frame(bench.clock.now())->saturation == Approx(100));
}

TEST_CASE("a camera that is unplugged comes back under another node with all that was set", "[v4l2]") {
  Bench bench;
  const auto camera = bench.open();
  camera->set_exposure(20 * kMillisecond);
  bench.deliver(1, 41);
  const std::int64_t last = camera->wait_frame(bench.clock.now())->sequence_number;

  bench.fake->gone = true;
  CHECK_THROWS_WITH(camera->wait_frame(bench.clock.now() + kSecond), names_camera && Contains("unplugged"));
  CHECK(bench.video.open_descriptors() == 0);
  // Still away: looked for until the deadline, then said so.
  const core::Nanoseconds start = bench.clock.now();
  CHECK_THROWS_WITH(camera->wait_frame(start + kSecond), names_camera && Contains("S1"));
  CHECK(bench.clock.now() == start + kSecond);

  const auto again = test::uvc_camera("/dev/video4", "S1", "usb-0000:00:14.0-7");
  bench.fake = again;
  bench.video.on_list = [&, plugged_at = bench.clock.now() + 2 * kSecond] {
    if (bench.clock.now() >= plugged_at) bench.video.cameras = {again};
  };
  SECTION("found by set_exposure, which waits") {
    camera->set_exposure(20 * kMillisecond);
  }
  SECTION("found by wait_frame, which waits until its deadline") {
    CHECK_FALSE(camera->wait_frame(bench.clock.now() + 3 * kSecond));
  }
  CHECK(again->format.pixelformat == V4L2_PIX_FMT_Y16);
  CHECK(bench.control(V4L2_CID_EXPOSURE_AUTO) == V4L2_EXPOSURE_MANUAL);
  CHECK(bench.control(V4L2_CID_EXPOSURE_ABSOLUTE) == 200);
  CHECK(bench.control(V4L2_CID_GAIN) == 20);
  CHECK(again->interval.denominator == 30);
  bench.deliver(65535, 0);
  const CameraFrame frame = camera->wait_frame(bench.clock.now()).value();
  CHECK(frame.sequence_number == last + 1);
  CHECK(frame.saturation == Approx(5));
}

TEST_CASE("an error of any call costs that call, the next one works again", "[v4l2]") {
  for (const int error : {EIO, ENODEV, EINVAL, ENOMEM}) {
    Bench bench;
    const auto camera = bench.open();
    camera->set_exposure(20 * kMillisecond);
    for (const unsigned long request : {VIDIOC_DQBUF, VIDIOC_QBUF}) {
      bench.deliver(1, 0);
      bench.fake->errors[request] = {error};
      CHECK_THROWS_WITH(camera->wait_frame(bench.clock.now()), names_camera && Contains("cannot"));
      CHECK(bench.video.open_descriptors() == 0);
      CHECK_FALSE(camera->wait_frame(bench.clock.now()));
      bench.deliver(7, 0);
      CHECK(camera->wait_frame(bench.clock.now()));
    }
    bench.fake->errors[VIDIOC_S_EXT_CTRLS] = {error};
    CHECK_THROWS_AS(camera->set_exposure(kMillisecond), core::DeviceError);
    // What was last granted was restored.
    CHECK_FALSE(camera->wait_frame(bench.clock.now()));
    CHECK(bench.control(V4L2_CID_EXPOSURE_ABSOLUTE) == 200);
    camera->set_exposure(kMillisecond);
    CHECK(bench.control(V4L2_CID_EXPOSURE_ABSOLUTE) == 10);
  }
}

TEST_CASE("whatever call of opening fails, everything is let go of and trying again works", "[v4l2]") {
  for (const unsigned long request : {VIDIOC_QUERYCAP, VIDIOC_S_FMT, VIDIOC_S_EXT_CTRLS, VIDIOC_G_EXT_CTRLS,
                                      VIDIOC_S_PARM, VIDIOC_REQBUFS, VIDIOC_QUERYBUF, VIDIOC_QBUF, VIDIOC_STREAMON}) {
    for (std::size_t after = 0; after < 12; ++after) {
      Bench bench;
      std::deque<int>& errors = bench.fake->errors[request];
      errors.assign(after, 0);
      errors.push_back(EIO);
      try {
        bench.open();
      } catch (const core::DeviceError&) {
      }
      CHECK(bench.video.open_descriptors() == 0);
      CHECK(bench.video.mappings() == 0);
      errors.clear();
      CHECK_NOTHROW(bench.open());
    }
  }
}

TEST_CASE("messages say what to do", "[v4l2]") {
  Bench bench;
  const auto streamon = [&](int error) { bench.fake->errors[VIDIOC_STREAMON] = {error}; };
  streamon(EBUSY);
  CHECK_THROWS_WITH(bench.open(), names_camera && Contains("/dev/video0") && Contains("another program"));
  streamon(ENOSPC);
  CHECK_THROWS_WITH(bench.open(), names_camera && Contains("bandwidth"));
  bench.fake->open_error = EACCES;
  CHECK_THROWS_WITH(bench.open(), names_camera && Contains("group 'video'"));
  bench.device.match = "/dev/video7";
  CHECK_THROWS_WITH(bench.open(), names_camera && Contains("plugged in"));
  bench.fake->open_error = 0;
  bench.fake->device_caps = V4L2_CAP_META_CAPTURE | V4L2_CAP_STREAMING;
  bench.device.match = "/dev/video0";
  CHECK_THROWS_WITH(bench.open(), names_camera && Contains("no pictures"));
}

TEST_CASE("an error that poll reports and DQBUF does not is one all the same", "[v4l2]") {
  Bench bench;
  const auto camera = bench.open();
  bench.fake->poll_events = POLLERR;
  CHECK_THROWS_AS(camera->wait_frame(bench.clock.now() + kSecond), core::DeviceError);
  bench.fake->poll_events = 0;
  CHECK_FALSE(camera->wait_frame(bench.clock.now()));
}
