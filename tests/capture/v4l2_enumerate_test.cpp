#include "capture/v4l2/enumerate.h"

#include <catch2/catch.hpp>
#include <cerrno>

#include "capture/v4l2/video_device.h"
#include "v4l2_fake_video.h"

using namespace lightstage;
using namespace lightstage::capture;
using Catch::Matchers::Contains;
using test::FakeCamera;

namespace {

// Two UVC cameras with a metadata node each.
struct Desk {
  Desk() {
    for (const auto& camera : {left, right}) {
      auto metadata = std::make_shared<FakeCamera>();
      metadata->node = camera->node;
      metadata->node.path += "9";
      metadata->node.index = 1;
      metadata->bus_path = camera->bus_path;
      metadata->device_caps = V4L2_CAP_META_CAPTURE | V4L2_CAP_STREAMING;
      video.cameras.push_back(metadata);
      video.cameras.push_back(camera);
    }
  }
  std::string find(const std::string& match, std::uint32_t fourcc = V4L2_PIX_FMT_GREY) {
    return find_camera_node(video, match, fourcc, "camera 'left'");
  }

  core::VirtualClock clock;
  test::FakeVideo video{clock};
  std::shared_ptr<FakeCamera> left = test::uvc_camera("/dev/video0", "S1", "usb-0000:00:14.0-1");
  std::shared_ptr<FakeCamera> right = test::uvc_camera("/dev/video2", "S2", "usb-0000:00:14.0-2");
};

}  // namespace

TEST_CASE("cameras are listed once each, with what they can", "[v4l2]") {
  Desk desk;
  const std::vector<V4l2CameraSeen> cameras = cameras_seen(desk.video);
  REQUIRE(cameras.size() == 2);
  const V4l2CameraSeen& left = cameras[0];
  CHECK(left.node == "/dev/video0");
  CHECK(left.card == "Fake camera");
  CHECK(left.driver == "fake");
  CHECK(left.bus_path == "usb-0000:00:14.0-1");
  CHECK(left.serial == "S1");
  CHECK(left.problem.empty());
  CHECK(left.has_exposure);
  CHECK_FALSE(left.has_trigger);
  REQUIRE(left.formats.size() == 4);
  CHECK(left.formats[1].pixel_format == "MJPG");
  CHECK_FALSE(left.formats[1].refused.empty());
  CHECK(left.formats[2].pixel_format == "Y16");
  CHECK(left.formats[2].description == "format 2");
  CHECK(left.formats[2].refused.empty());
  REQUIRE(left.formats[2].sizes.size() == 2);
  CHECK(left.formats[2].sizes[0].width == 640);
  CHECK(left.formats[2].sizes[0].largest_height == 480);
  CHECK(left.formats[2].sizes[0].rates == std::vector<double>{60, 30, 10});
  CHECK(cameras[1].serial == "S2");
  CHECK(desk.video.open_descriptors() == 0);
}

TEST_CASE("a camera that cannot be used is listed with what to do", "[v4l2]") {
  Desk desk;
  desk.left->open_error = EACCES;
  desk.right->formats = {V4L2_PIX_FMT_MJPEG};
  const std::vector<V4l2CameraSeen> cameras = cameras_seen(desk.video);
  REQUIRE(cameras.size() == 2);
  CHECK_THAT(cameras[0].problem, Contains("/dev/video0") && Contains("group 'video'"));
  CHECK(cameras[0].card == "Fake camera");
  CHECK_THAT(cameras[1].problem, Contains("no format"));
  desk.right->formats = {V4L2_PIX_FMT_GREY};
  desk.right->controls.clear();
  CHECK_THAT(cameras_seen(desk.video)[1].problem, Contains("exposure"));
}

TEST_CASE("a camera is found by serial number, bus path or node", "[v4l2]") {
  Desk desk;
  CHECK(desk.find("S2") == "/dev/video2");
  CHECK(desk.find("usb-0000:00:14.0-1") == "/dev/video0");
  CHECK(desk.find("/dev/v4l/by-id/anything") == "/dev/v4l/by-id/anything");
  CHECK_THROWS_WITH(desk.find("S3"), Contains("camera 'left'") && Contains("'S3'") && Contains("S1") &&
                                         Contains("usb-0000:00:14.0-2") && !Contains("\n"));
  desk.video.cameras.clear();
  CHECK_THROWS_WITH(desk.find("S1"), Contains("none"));
}

TEST_CASE("of a camera's capturing nodes the one with the format is taken", "[v4l2]") {
  Desk desk;
  const auto depth = test::uvc_camera("/dev/video4", "S2", "usb-0000:00:14.0-2");
  depth->formats = {V4L2_PIX_FMT_Y12};
  desk.video.cameras.push_back(depth);
  CHECK(desk.find("S2", V4L2_PIX_FMT_GREY) == "/dev/video2");
  CHECK(desk.find("S2", V4L2_PIX_FMT_Y12) == "/dev/video4");
  CHECK(desk.find("S2", V4L2_PIX_FMT_RGB24) == "/dev/video2");
}

TEST_CASE("two cameras of one serial number must be told apart by their bus paths", "[v4l2]") {
  Desk desk;
  desk.right->node.serial = "S1";
  CHECK_THROWS_WITH(desk.find("S1"),
                    Contains("two cameras") && Contains("usb-0000:00:14.0-1") && Contains("usb-0000:00:14.0-2"));
  CHECK(desk.find("usb-0000:00:14.0-2") == "/dev/video2");
}

TEST_CASE("a camera that is meant but not permitted is not called missing", "[v4l2]") {
  Desk desk;
  desk.right->open_error = EACCES;
  CHECK_THROWS_WITH(desk.find("S2"), Contains("group 'video'"));
  CHECK(desk.find("S1") == "/dev/video0");
}

TEST_CASE("the kernel's own answer for what is not a camera", "[v4l2]") {
  CHECK_THROWS_WITH(VideoDevice(kernel_video_system(), "/dev/null", "camera 'left'"),
                    Contains("camera 'left' (/dev/null)") && Contains("not a video device"));
  CHECK_THROWS_WITH(VideoDevice(kernel_video_system(), "/nonexistent/video0", ""), Contains("cannot open it"));
}
