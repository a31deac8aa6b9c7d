#include <catch2/catch.hpp>
#include <fstream>

#include "capture/devices_seen.h"
#include "support/support.h"

using namespace lightstage;
using capture::ControllerKind;
using capture::DevicesSeen;
using capture::Stage;
namespace fs = std::filesystem;

namespace {

using Lines = std::vector<std::string>;

// A stage and the very devices that it needs.
struct Bench {
  Stage stage;
  DevicesSeen seen;

  Bench() {
    capture::LayoutOptions options;
    options.lights = 3;
    options.cameras = 2;
    options.camera_pixels = 320;
    stage = capture::make_stage("dome", options);
    capture::Hardware& hardware = stage.hardware;
    hardware.controllers = {{"leds", ControllerKind::kLightstage, "L1"}, {"rim", ControllerKind::kEnttecDmxUsbPro, ""}};
    hardware.wiring = {{"leds", {0}}, {"leds", {7}}, {"rim", {500}}};
    hardware.cameras = {{.match = "C1", .pixel_format = "Y16"}, {.match = "usb-2", .pixel_format = "GREY"}};
    hardware.trigger = {"bridge", {"trigger", "1"}};
    hardware.strobe = {"bridge", "2"};

    seen.controllers = {controller(ControllerKind::kLightstage, "L1"),
                        controller(ControllerKind::kEnttecDmxUsbPro, "D1")};
    seen.cameras = {camera("/dev/video0", "usb-1", "C1"), camera("/dev/video2", "usb-2", "")};
    seen.gpio_chips = {{"/dev/gpiochip0", "soc", std::vector<capture::GpioLineSeen>(54), ""},
                       {"/dev/gpiochip3", "bridge", std::vector<capture::GpioLineSeen>(8), ""}};
    seen.gpio_chips[1].lines[0].name = "trigger";
  }

  static capture::UsbLedsSeen controller(ControllerKind kind, const std::string& serial) {
    capture::UsbLedsSeen controller;
    controller.kind = kind;
    controller.serial = serial;
    controller.bus_path = "1-" + serial;
    controller.accessible = true;
    return controller;
  }

  static capture::V4l2CameraSeen camera(const std::string& node, const std::string& bus_path,
                                        const std::string& serial) {
    capture::V4l2CameraSeen camera;
    camera.node = node;
    camera.bus_path = bus_path;
    camera.serial = serial;
    camera.formats = {{"GREY",
                       "8-bit",
                       "",
                       {{.width = 16,
                         .height = 16,
                         .largest_width = 640,
                         .largest_height = 480,
                         .width_step = 16,
                         .height_step = 8}}},
                      {"Y16", "16-bit", "", {{.width = 320, .height = 320}, {.width = 640, .height = 480}}},
                      {"MJPG", "Motion-JPEG", "it is lossy", {}}};
    return camera;
  }

  Lines problems() const { return capture::stage_problems(stage, seen); }
};

}  // namespace

TEST_CASE("a stage whose devices are all there has no problems", "[stage_check]") {
  Bench bench;
  CHECK(bench.problems() == Lines{});
  CHECK(capture::device_problems(bench.seen) == Lines{});
  bench.stage.hardware.trigger->chip = "/dev/gpiochip3";
  bench.stage.hardware.cameras[0].match = "/dev/video0";
  CHECK(bench.problems() == Lines{});
}

TEST_CASE("a stage that is only drawn is told how to become real", "[stage_check]") {
  Bench bench;
  bench.stage.hardware = {};
  CHECK(bench.problems() == Lines{"stage dome: the file has no [[controller]]: see docs/hardware.md",
                                  "stage dome: no camera of the file has a [camera.device]: see docs/hardware.md"});
}

TEST_CASE("missing and ambiguous controllers are named", "[stage_check]") {
  Bench bench;
  bench.stage.hardware.controllers[0].serial = "L2";
  bench.seen.controllers.pop_back();
  CHECK(bench.problems() == Lines{"controller leds: no lightstage controller with the serial number 'L2' is plugged in "
                                  "(there are: L1): plug it "
                                  "in, or correct `serial`",
                                  "controller rim: no DMX widget is plugged in"});
  bench = Bench();
  bench.seen.controllers.push_back(Bench::controller(ControllerKind::kEnttecDmxUsbPro, "D2"));
  CHECK(bench.problems() == Lines{"controller rim: there are several (D1, D2): say which by `serial`"});
  bench = Bench();
  for (capture::UsbLedsSeen& controller : bench.seen.controllers) {
    controller.accessible = false;
    controller.advice = "install the udev rules";
  }
  bench.seen.controllers[1].certain = false;  // it may be any serial adapter, but the stage says that it is none
  CHECK(bench.problems() == Lines{"controller leds: install the udev rules", "controller rim: install the udev rules"});
  CHECK(capture::device_problems(bench.seen) == Lines{"LED controller L1 at 1-L1: install the udev rules"});
}

TEST_CASE("missing cameras, formats and sizes are named with those that there are", "[stage_check]") {
  Bench bench;
  bench.stage.hardware.cameras[0].match = "C7";
  bench.stage.hardware.cameras[1].pixel_format = "Y12";
  CHECK(bench.problems() ==
        Lines{"camera cam0: no camera matches 'C7' (there are: C1 at usb-1, usb-2): plug it in, or correct `match`",
              "camera cam1: the camera has no pixel format Y12 but GREY, Y16: correct `pixel_format`"});
  bench = Bench();
  bench.stage.cameras[0].model.width = 322;
  bench.stage.cameras[1].model.height = 324;  // not in steps of 8 from 16
  CHECK(bench.problems() == Lines{"camera cam0: the camera has no 322x320 in Y16 but 320x320, 640x480: correct "
                                  "`width_pixels` and `height_pixels`",
                                  "camera cam1: the camera has no 320x324 in GREY but 16x16 to 640x480: correct "
                                  "`width_pixels` and `height_pixels`"});
  bench = Bench();
  bench.seen.cameras[1].serial = "C1";
  bench.stage.hardware.cameras[1].pixel_format = "MJPG";
  CHECK(bench.problems() ==
        Lines{"camera cam0: several cameras match 'C1': match by bus path (C1 at usb-1, C1 at usb-2)",
              "camera cam1: pixel format MJPG: it is lossy"});
  bench = Bench();
  bench.seen.cameras[0].problem = "used by another program";
  CHECK(bench.problems() == Lines{"camera cam0: used by another program"});
  bench.seen.cameras[1].problem = "/dev/video2: cannot open it";
  CHECK(capture::device_problems(bench.seen) ==
        Lines{"camera /dev/video0: used by another program", "camera /dev/video2: cannot open it"});
}

TEST_CASE("missing and held lines are named", "[stage_check]") {
  Bench bench;
  bench.stage.hardware.trigger->lines = {"8", "trigger"};
  bench.stage.hardware.strobe->chip = "brigde";
  bench.seen.gpio_chips[1].lines[0].used = true;
  bench.seen.gpio_chips[1].lines[0].consumer = "blinker";
  CHECK(bench.problems() ==
        Lines{"trigger: chip 'bridge' has no line '8': it has 8, from 0",
              "trigger: line trigger is held by 'blinker': end it, or choose another line",
              "strobe: no GPIO chip 'brigde' is plugged in (there are: soc, bridge): plug it in, or "
              "correct `chip`"});
  bench = Bench();
  bench.seen.gpio_chips[0].label = "bridge";
  CHECK(bench.problems().at(0) ==
        "trigger: /dev/gpiochip0 and /dev/gpiochip3 are both labelled 'bridge': name one by its path in `chip`");
  bench = Bench();
  bench.seen.gpio_chips[1] = {"/dev/gpiochip3", "", {}, "no permission"};
  CHECK(bench.problems().at(0) ==
        "trigger: no GPIO chip 'bridge' is plugged in (there are: soc, /dev/gpiochip3 (no "
        "permission)): plug it in, or correct `chip`");
  CHECK(capture::device_problems(bench.seen) == Lines{"GPIO chip /dev/gpiochip3: no permission"});
}

TEST_CASE("USB devices without their driver tell which module is missing", "[stage_check]") {
  const test::TemporaryFolder sysfs;
  const fs::path devices = sysfs / "bus/usb/devices";
  const auto write = [&](const char* device, const char* name, const char* value) {
    fs::create_directories(devices / device);
    std::ofstream(devices / device / name) << value << "\n";
  };
  CHECK(capture::missing_modules(sysfs.path()) == Lines{});
  write("1-1:1.0", "bInterfaceClass", "0e");
  write("1-1:1.1", "bInterfaceClass", "03");
  write("1-2", "idVendor", "10c4");
  write("1-2", "idProduct", "ea90");
  CHECK(capture::missing_modules(sysfs.path()) == Lines{"hid_cp2112", "uvcvideo"});
  DevicesSeen seen;
  seen.missing_modules = {"uvcvideo"};
  CHECK(capture::device_problems(seen) ==
        Lines{"a device that needs the kernel module uvcvideo is plugged in, but not driven: sudo modprobe uvcvideo"});

  fs::create_directories(devices / "1-1:1.0/driver");
  fs::create_directories(devices / "1-2/1-2:1.0/0003:10C4:EA90.0001/gpiochip3");
  CHECK(capture::missing_modules(sysfs.path()) == Lines{});
}
