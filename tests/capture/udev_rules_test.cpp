#include <catch2/catch.hpp>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <regex>
#include <sstream>

#include "capture/led_protocol.h"

using namespace lightstage;

TEST_CASE("the udev rules know the LED controllers' USB interface and give access to whoever sits at the machine",
          "[udev]") {
  std::ifstream file(LIGHTSTAGE_UDEV_RULES);
  const std::string rules{std::istreambuf_iterator<char>(file), {}};
  char interface[16];
  std::snprintf(interface, sizeof interface, ":%02x%02x%02x:", capture::kLedUsbClass, capture::kLedUsbSubclass,
                capture::kLedUsbProtocol);
  CHECK(rules.find("ENV{ID_USB_INTERFACES}==\"*" + std::string(interface) + "*\"") != std::string::npos);
  // uaccess is acted upon by 73-seat-late.rules.
  CHECK(std::filesystem::path(LIGHTSTAGE_UDEV_RULES).filename().string() < "73");

  const std::regex rule("SUBSYSTEM==\"(usb|gpio)\".*");
  const std::regex with_access(".*, GROUP=\"plugdev\", MODE=\"0660\", TAG\\+=\"uaccess\"");
  int count = 0;
  std::istringstream lines(rules);
  for (std::string line; std::getline(lines, line);) {
    if (!std::regex_match(line, rule)) continue;
    INFO(line);
    CHECK(std::regex_match(line, with_access));
    ++count;
  }
  CHECK(count == 3);
}
