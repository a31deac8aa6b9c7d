#include <catch2/catch.hpp>
#include <fstream>
#include <iterator>
#include <random>

#include "capture/sequence.h"
#include "capture/stage.h"
#include "core/error.h"

using namespace lightstage;
using capture::Hardware;
using capture::Stage;

namespace {

Stage drawn_stage(std::size_t lights, int cameras) {
  capture::LayoutOptions options;
  options.lights = lights;
  options.cameras = cameras;
  return capture::make_stage("s", options);
}

Stage read_back(const Stage& stage) {
  const std::string text = capture::to_toml(stage);
  const Stage back = capture::parse_stage(text, "stage.toml");
  CHECK(capture::to_toml(back) == text);
  return back;
}

// A stage file of two cameras and three lights; every test changes a line of it.
const std::string kGood = R"(name = "s"
radius_m = 1.0
[[controller]]
name = "dome"
kind = "lightstage"
serial = "A1"
[[controller]]
name = "rim"
kind = "enttec_dmx_usb_pro"
[trigger]
chip = "cp2112_gpio"
lines = ["0", "1"]
pulse_us = 50
active_low = true
[strobe]
chip = "cp2112_gpio"
line = "2"
[[camera]]
name = "left"
width_pixels = 320
height_pixels = 240
focal_length_pixels = [300, 300]
principal_point_pixels = [160, 120]
radial_distortion = [0, 0, 0]
tangential_distortion = [0, 0]
position_m = [0, 0, 2]
right = [1, 0, 0]
down = [0, -1, 0]
forward = [0, 0, -1]
responsivity_per_s = 40
[camera.device]
match = "CAM-LEFT"
pixel_format = "Y10 "
gain = 7
black_level = 16
linearisation = [0.9, 0.1]
triggered = true
timestamp_offset_ms = -1.5
[[camera]]
name = "right"
width_pixels = 320
height_pixels = 240
focal_length_pixels = [300, 300]
principal_point_pixels = [160, 120]
radial_distortion = [0, 0, 0]
tangential_distortion = [0, 0]
position_m = [0, 0, 2]
right = [1, 0, 0]
down = [0, -1, 0]
forward = [0, 0, -1]
responsivity_per_s = 40
[camera.device]
match = "usb-0000:00:14.0-2"
triggered = false
[[light]]
position_m = [0, 1, 0]
controller = "dome"
channels = [4]
[[light]]
position_m = [0, 0, 1]
controller = "rim"
channels = [1, 2, 512]
[[light]]
position_m = [1, 0, 0]
controller = "dome"
)";

std::string changed(const std::string& from, const std::string& to) {
  std::string text = kGood;
  const std::size_t at = text.find(from);
  REQUIRE(at != std::string::npos);
  return text.replace(at, from.size(), to);
}

std::string message_of(const std::string& toml) {
  try {
    capture::parse_stage(toml, "stage.toml");
  } catch (const core::BadInput& error) {
    return error.what();
  }
  return "(no error)";
}

// The line on which `part` ends, the last time that it is in `text`.
std::string place_of(const std::string& text, const std::string& part) {
  REQUIRE(text.find(part) != std::string::npos);
  const std::size_t end = text.rfind(part) + part.size();
  return "stage.toml:" + std::to_string(1 + std::count(text.begin(), text.begin() + std::ptrdiff_t(end), '\n')) + ": ";
}

std::string random_text(std::mt19937& random) {
  const std::string characters = "aZ09-_ :/\"\\\n\t\x7f\x01#'[]é";
  std::string text = "x";
  for (unsigned n = random() % 12; n > 0; --n) text += characters[random() % (characters.size() - 2)];
  return text + (random() % 4 == 0 ? "é" : "");
}

// Any hardware that a stage of so many lights and cameras can have.
Hardware random_hardware(std::mt19937& random, std::size_t lights, std::size_t cameras) {
  Hardware hardware;
  const std::size_t controllers = 1 + random() % 3;
  for (std::size_t c = 0; c < controllers; ++c) {
    const auto kind =
        random() % 2 == 0 ? capture::ControllerKind::kLightstage : capture::ControllerKind::kEnttecDmxUsbPro;
    hardware.controllers.push_back({"c" + std::to_string(c), kind, std::to_string(c) + random_text(random)});
  }
  for (std::size_t i = 0; i < lights; ++i) {
    const capture::ControllerSpec& controller = hardware.controllers[i < controllers ? i : random() % controllers];
    const int first = 1 + 3 * int(i);
    const bool three = controller.kind == capture::ControllerKind::kEnttecDmxUsbPro && random() % 2 == 0;
    hardware.wiring.push_back({controller.name, {first}});
    if (three) hardware.wiring.back().channels = {first + 2, first, first + 1};
  }
  if (random() % 4 != 0) {
    hardware.trigger = {
        random_text(random), {"l0"}, 1000 + core::Nanoseconds(random() % 999'999'000), random() % 2 == 0};
    if (random() % 2 == 0) {
      for (std::size_t i = 1; i < cameras; ++i) hardware.trigger->lines.push_back("l" + std::to_string(i));
    }
  }
  if (random() % 2 == 0) hardware.strobe = {random_text(random), "strobe", random() % 2 == 0};
  if (random() % 4 == 0) return hardware;
  std::uniform_real_distribution<double> number(0, 1000);
  for (std::size_t i = 0; i < cameras; ++i) {
    capture::CameraDevice device;
    device.match = std::to_string(i) + random_text(random);
    device.pixel_format = random() % 2 == 0 ? "Y16-BE" : "RGGB";
    if (random() % 2 == 0) device.gain = int(random()) - 1'000'000;
    device.black_level = number(random);
    device.linearisation = {number(random), -number(random) / 1e6, 1.0 / 3};
    device.triggered = hardware.trigger && random() % 2 == 0;
    device.timestamp_offset = core::Nanoseconds(random() % 20'000'000'000) - 10'000'000'000;
    hardware.cameras.push_back(device);
  }
  return hardware;
}

}  // namespace

TEST_CASE("the hardware of a stage file is read", "[hardware_file]") {
  const Hardware hardware = capture::parse_stage(kGood, "stage.toml").hardware;
  REQUIRE(hardware.complete());
  CHECK(hardware.controllers ==
        std::vector<capture::ControllerSpec>{{"dome", capture::ControllerKind::kLightstage, "A1"},
                                             {"rim", capture::ControllerKind::kEnttecDmxUsbPro, ""}});
  // The third light is the second one of its controller.
  CHECK(hardware.wiring == std::vector<capture::LightWiring>{{"dome", {4}}, {"rim", {1, 2, 512}}, {"dome", {1}}});
  REQUIRE(hardware.cameras.size() == 2);
  CHECK(hardware.cameras[0] == capture::CameraDevice{"CAM-LEFT", "Y10", 7, 16, {0.9, 0.1}, true, -1'500'000});
  CHECK(hardware.cameras[1] == capture::CameraDevice{"usb-0000:00:14.0-2", "GREY", {}, 0, {1}, false, 0});
  CHECK(hardware.trigger == capture::TriggerSpec{"cp2112_gpio", {"0", "1"}, 50'000, true});
  CHECK(hardware.strobe == capture::StrobeSpec{"cp2112_gpio", "2", false});
}

TEST_CASE("with one controller nothing needs to be said of the lights", "[hardware_file]") {
  std::string text = capture::to_toml(drawn_stage(5, 1));
  text += "[[controller]]\nname = \"leds\"\nkind = \"lightstage\"\n";
  const Hardware hardware = capture::parse_stage(text, "stage.toml").hardware;
  REQUIRE(hardware.wiring.size() == 5);
  for (int i = 0; i < 5; ++i) CHECK(hardware.wiring[std::size_t(i)] == capture::LightWiring{"leds", {i}});
  CHECK_FALSE(hardware.complete());
}

TEST_CASE("hardware reads back exactly", "[hardware_file]") {
  std::mt19937 random(7);
  for (int round = 0; round < 300; ++round) {
    const std::size_t lights = 3 + random() % 100, cameras = 1 + random() % 4;
    Stage stage = drawn_stage(lights, int(cameras));
    const std::string key = capture::stage_key(stage);
    stage.hardware = random_hardware(random, lights, cameras);
    const Stage back = read_back(stage);
    REQUIRE(back.hardware == stage.hardware);
    REQUIRE(capture::stage_key(back) == key);
  }
}

TEST_CASE("a stage without hardware is written with a hint at how to add it", "[hardware_file]") {
  const Stage stage = drawn_stage(3, 1);
  CHECK(capture::to_toml(stage).find("docs/hardware.md") != std::string::npos);
  CHECK(read_back(stage).hardware == Hardware{});
}

TEST_CASE("mistakes in the hardware are named by file, line and key", "[hardware_file]") {
  REQUIRE(message_of(kGood) == "(no error)");
  const auto expect = [](const std::string& from, const std::string& to, const std::string& key,
                         const std::string& problem, const std::string& at) {
    const std::string text = changed(from, to);
    CHECK(message_of(text) == place_of(text, at) + "key '" + key + "' " + problem);
  };
  const auto expect_here = [&](const std::string& from, const std::string& to, const std::string& key,
                               const std::string& problem) { expect(from, to, key, problem, to); };

  expect_here("kind = \"lightstage\"", "kind = \"enttec\"", "controller[0].kind",
              "must be lightstage or enttec_dmx_usb_pro");
  expect_here("name = \"rim\"", "name = \"dome\"", "controller[1].name", "is another controller's already");
  expect_here("name = \"rim\"", "name = \"the rim\"", "controller[1].name",
              "must be made of letters, digits, '-', '_' and '.'");
  expect("name = \"rim\"\nkind = \"enttec_dmx_usb_pro\"", "name = \"rim\"\nkind = \"lightstage\"",
         "controller[1].serial", "is needed to tell 'rim' and 'dome' apart: give both (see `lightstage doctor`)",
         "serial = \"A1\"\n[[controller]]");
  expect_here("name = \"rim\"\nkind = \"enttec_dmx_usb_pro\"", "name = \"rim\"\nkind = \"lightstage\"\nserial = \"A1\"",
              "controller[1].serial", "is that of controller 'dome' already");

  expect_here("controller = \"rim\"", "controller = \"rom\"", "light[1].controller",
              "names 'rom', which is no [[controller]] of this file (did you mean 'rim'?)");
  expect("controller = \"rim\"\nchannels", "channels", "light[1].controller", "is missing: the stage has 2",
         "channels = [4]\n[[light]]");
  expect("controller = \"rim\"\nchannels = [1, 2, 512]", "controller = \"rim\"", "light[1].channels",
         "is missing: a light on a DMX widget has 1 or 3 channels from 1 to 512", "channels = [4]\n[[light]]");
  expect_here("channels = [1, 2, 512]", "channels = [1, 2]", "light[1].channels", "must be 1 or 3 DMX channels");
  expect_here("channels = [1, 2, 512]", "channels = [0, 1, 2]", "light[1].channels",
              "must hold whole numbers from 1 to 512");
  expect_here("channels = [1, 2, 512]", "channels = [513]", "light[1].channels",
              "must hold whole numbers from 1 to 512");
  expect_here("channels = [1, 2, 512]", "channels = [1, 2, 1]", "light[1].channels",
              "names channel 1 of controller 'rim', which is twice for this light");
  expect_here("channels = [4]", "channels = [4, 5, 6]", "light[0].channels", "must be one output of the controller");
  expect_here("channels = [4]", "channels = [4096]", "light[0].channels", "must hold whole numbers from 0 to 4095");
  expect_here("channels = [4]", "channels = [-1]", "light[0].channels", "must hold whole numbers from 0 to 4095");
  expect_here("channels = [4]", "channels = [0.5]", "light[0].channels", "must hold whole numbers from 0 to 4095");
  // The third light is output 1 by its place.
  expect("channels = [4]", "channels = [1]", "light[2].channels",
         "names channel 1 of controller 'dome', which is light 0's already", "channels = [1, 2, 512]\n[[light]]");
  expect("controller = \"rim\"\nchannels = [1, 2, 512]", "controller = \"dome\"\nchannels = [5]", "controller[1].name",
         "is of a controller that no light names", "serial = \"A1\"\n[[controller]]\nname");

  expect_here("match = \"CAM-LEFT\"", "match = \"\"", "camera[0].device.match", "must not be empty");
  expect_here("match = \"usb-0000:00:14.0-2\"", "match = \"CAM-LEFT\"", "camera[1].device.match",
              "is that of camera 'left' already");
  expect_here("pixel_format = \"Y10 \"", "pixel_format = \"MJPG\"", "camera[0].device.pixel_format",
              "cannot be measured in: compressed with loss: what a pixel says depends on its neighbours, so that no "
              "light can be measured in it");
  expect_here("pixel_format = \"Y10 \"", "pixel_format = \"grey8\"", "camera[0].device.pixel_format",
              "must be the driver's four characters, such as GREY, Y10, Y16, RGGB or YUYV");
  expect_here("gain = 7", "gain = 3000000000", "camera[0].device.gain", "must fit into 32 bits");
  expect_here("black_level = 16", "black_level = -1", "camera[0].device.black_level", "must not be negative");
  expect_here("linearisation = [0.9, 0.1]", "linearisation = []", "camera[0].device.linearisation",
              "must have 1 to 8 coefficients");
  expect_here("linearisation = [0.9, 0.1]", "linearisation = [1, -1]", "camera[0].device.linearisation",
              "must map full scale to something above 0");
  expect_here("timestamp_offset_ms = -1.5", "timestamp_offset_ms = 1e9", "camera[0].device.timestamp_offset_ms",
              "must be -10000 to 10000 (10 s)");
  expect("[camera.device]\nmatch = \"usb-0000:00:14.0-2\"\ntriggered = false\n", "", "camera[1].device",
         "is missing: other cameras have one", "timestamp_offset_ms = -1.5\n[[camera]]");
  expect("[trigger]\nchip = \"cp2112_gpio\"\nlines = [\"0\", \"1\"]\npulse_us = 50\nactive_low = true\n", "",
         "camera[0].device.triggered",
         "needs a [trigger] in the file; a camera that only runs free says triggered = false", "triggered = true");

  expect_here("lines = [\"0\", \"1\"]", "lines = [\"0\", \"1\", \"3\"]", "trigger.lines",
              "must be one for all cameras or one for each of the 2");
  expect_here("lines = [\"0\", \"1\"]", "lines = []", "trigger.lines",
              "must be one for all cameras or one for each of the 2");
  expect_here("lines = [\"0\", \"1\"]", "lines = [\"0\", \"0\"]", "trigger.lines", "names a line twice");
  expect_here("lines = [\"0\", \"1\"]", "lines = [\"\"]", "trigger.lines", "must not be empty");
  expect_here("pulse_us = 50", "pulse_us = 0.5", "trigger.pulse_us", "must be 1 to 1000000 (1 s)");
  expect_here("line = \"2\"", "line = \"1\"", "strobe.line", "is a trigger line: an output cannot hear");
  expect_here("pulse_us", "puls_us", "trigger.puls_us", "is not known (did you mean 'pulse_us'?)");
}

TEST_CASE("wiring without a controller is refused", "[hardware_file]") {
  const std::string good = capture::to_toml(drawn_stage(2, 1));
  CHECK(message_of(good + "channels = [1]\n")
            .ends_with("key 'light[1].channels' is of no use: the file has no [[controller]]"));
  CHECK(message_of(good + "controller = \"a\"\n")
            .ends_with("key 'light[1].controller' is of no use: the file has no [[controller]]"));
}

TEST_CASE("the examples of the hardware guide are a sequence, limits and a whole stage", "[hardware_file]") {
  std::ifstream file(LIGHTSTAGE_DOCS "/hardware.md");
  const std::string guide{std::istreambuf_iterator<char>(file), {}};
  const std::string fence = "```toml\n";
  std::vector<std::string> examples;
  for (std::size_t at = guide.find(fence); at != std::string::npos; at = guide.find(fence, at + 1)) {
    const std::size_t begin = at + fence.size();
    examples.push_back(guide.substr(begin, guide.find("```\n", begin) - begin));
  }
  REQUIRE(examples.size() == 3);
  const Stage stage = capture::parse_stage(examples[2], "docs/hardware.md");
  CHECK(stage.hardware.complete());
  CHECK(stage.hardware.controllers.size() == 2);
  CHECK(stage.hardware.trigger);
  CHECK(stage.hardware.strobe);
  CHECK(read_back(stage).hardware == stage.hardware);
  const capture::Sequence sequence =
      capture::parse_sequence(examples[0], "docs/hardware.md", stage.light_positions.size());
  CHECK(sequence.steps.size() == 5);
  // The limits of the guide are those of a stage file that names none.
  CHECK(capture::parse_stage(examples[2] + "\n" + examples[1], "docs/hardware.md").limits == stage.limits);
}
