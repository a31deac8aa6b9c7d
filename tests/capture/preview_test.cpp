#include "capture/preview.h"

#include <arpa/inet.h>
#include <poll.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <unistd.h>
#include <catch2/catch.hpp>
#include <cstring>
#include <fstream>
#include <iterator>
#include <thread>

#include "capture/preview/tev_link.h"
#include "capture/preview/tev_packets.h"
#include "core/display.h"
#include "core/error.h"
#include "core/file.h"
#include "core/image_file.h"
#include "core/progress.h"
#include "fake_rig.h"
#include "support/support.h"

using namespace lightstage;
using capture::CameraFrame;
using capture::Preview;
using capture::PreviewOptions;
using capture::TevLink;
using namespace std::chrono_literals;
using SteadyClock = std::chrono::steady_clock;

namespace {

CameraFrame frame_of(int height, int width, int channels, float offset = 0) {
  CameraFrame frame;
  frame.image = core::Image(height, width, channels);
  float v = offset;
  for (float& value : frame.image.values()) value = v += 0.01f;
  frame.saturation = 2;
  return frame;
}

// Reads one packet's fields in the order in which tev reads them.
class PacketReader {
 public:
  explicit PacketReader(const std::string& bytes) : bytes_(bytes) {}
  template <class T>
  T number() {
    REQUIRE(at_ + sizeof(T) <= bytes_.size());
    T value{};
    std::memcpy(&value, bytes_.data() + at_, sizeof value);  // tests run on little-endian machines
    at_ += sizeof value;
    return value;
  }
  std::string text() {
    const std::size_t end = bytes_.find('\0', at_);
    REQUIRE(end != std::string::npos);
    const std::string value = bytes_.substr(at_, end - at_);
    at_ = end + 1;
    return value;
  }
  bool at_end() const { return at_ == bytes_.size(); }

 private:
  const std::string& bytes_;
  std::size_t at_ = 0;
};

// What a viewer holds after these packets.
std::map<std::string, core::Image> shown_by(const std::vector<std::string>& packets) {
  std::map<std::string, core::Image> images;
  for (const std::string& packet : packets) {
    PacketReader read(packet);
    REQUIRE(read.number<std::uint32_t>() == packet.size());
    const int operation = read.number<std::uint8_t>();
    CHECK(read.number<std::uint8_t>() == 0);
    const std::string name = read.text();
    if (operation == 4) {
      const int width = read.number<std::int32_t>(), height = read.number<std::int32_t>();
      const int channels = read.number<std::int32_t>();
      for (int c = 0; c < channels; ++c)
        CHECK(read.text() == (channels == 1 ? "Y" : c == 0 ? "R" : c == 1 ? "G" : "B"));
      images[name] = core::Image(height, width, channels);
    } else {
      REQUIRE(operation == 6);
      REQUIRE(images.count(name) == 1);
      core::Image& image = images[name];
      REQUIRE(read.number<std::int32_t>() == image.channels());
      for (int c = 0; c < image.channels(); ++c) read.text();
      CHECK(read.number<std::int32_t>() == 0);
      CHECK(read.number<std::int32_t>() == 0);
      REQUIRE(read.number<std::int32_t>() == image.width());
      REQUIRE(read.number<std::int32_t>() == image.height());
      std::vector<std::int64_t> offsets, strides;
      for (int c = 0; c < image.channels(); ++c) offsets.push_back(read.number<std::int64_t>());
      for (int c = 0; c < image.channels(); ++c) strides.push_back(read.number<std::int64_t>());
      std::vector<float> floats(image.values().size());
      for (float& v : floats) v = read.number<float>();
      for (int y = 0; y < image.height(); ++y) {
        for (int x = 0; x < image.width(); ++x) {
          for (int c = 0; c < image.channels(); ++c) {
            const std::int64_t pixel = std::int64_t{y} * image.width() + x;
            image(y, x, c) = floats.at(static_cast<std::size_t>(offsets[static_cast<std::size_t>(c)] +
                                                                pixel * strides[static_cast<std::size_t>(c)]));
          }
        }
      }
    }
    CHECK(read.at_end());
  }
  return images;
}

// Listens on a free port of loopback as tev would.
class FakeViewer {
 public:
  explicit FakeViewer(std::uint16_t port = 0) : listener_(::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0)) {
    const int yes = 1;
    ::setsockopt(listener_, SOL_SOCKET, SO_REUSEADDR, &yes, sizeof yes);
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_port = htons(port);
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    REQUIRE(::bind(listener_, reinterpret_cast<sockaddr*>(&address), sizeof address) == 0);
    REQUIRE(::listen(listener_, 5) == 0);
    socklen_t size = sizeof address;
    ::getsockname(listener_, reinterpret_cast<sockaddr*>(&address), &size);
    port_ = ntohs(address.sin_port);
  }
  ~FakeViewer() {
    if (connection_ >= 0) ::close(connection_);
    ::close(listener_);
  }
  FakeViewer(const FakeViewer&) = delete;
  FakeViewer& operator=(const FakeViewer&) = delete;

  std::uint16_t port() const { return port_; }
  std::string address() const { return "127.0.0.1:" + std::to_string(port_); }

  // Whole packets that come until `count` have come, or none for `patience`.
  std::vector<std::string> read(std::size_t count, std::chrono::milliseconds patience = 3s) {
    std::vector<std::string> packets;
    while (packets.size() < count) {
      std::uint32_t length = 0;
      if (buffer_.size() >= sizeof length) std::memcpy(&length, buffer_.data(), sizeof length);
      if (length >= sizeof length && buffer_.size() >= length) {
        packets.push_back(buffer_.substr(0, length));
        buffer_.erase(0, length);
        continue;
      }
      pollfd wanted{connection_ >= 0 ? connection_ : listener_, POLLIN, 0};
      if (::poll(&wanted, 1, static_cast<int>(patience.count())) <= 0) break;
      if (connection_ < 0) {
        connection_ = ::accept(listener_, nullptr, nullptr);
        continue;
      }
      char block[65536];
      const ssize_t n = ::recv(connection_, block, sizeof block, 0);
      if (n <= 0) break;
      buffer_.append(block, static_cast<std::size_t>(n));
    }
    return packets;
  }

 private:
  int listener_ = -1, connection_ = -1;
  std::uint16_t port_ = 0;
  std::string buffer_;
};

// A port where nobody listens.
std::string closed_address() {
  const FakeViewer for_its_port;
  return for_its_port.address();
}

PreviewOptions only_still(const std::filesystem::path& path) {
  PreviewOptions options;
  options.still = path;
  options.tev_address.clear();
  return options;
}

}  // namespace

TEST_CASE("packets to tev are those of its protocol, byte for byte", "[preview]") {
  using namespace std::string_literals;
  CHECK(capture::tev_create_packet("a", {2, 3, 1}) == "\x16\0\0\0\x04\0a\0\x03\0\0\0\x02\0\0\0\x01\0\0\0Y\0"s);
  core::Image image(1, 1, 3);
  image(0, 0, 0) = 1;
  image(0, 0, 2) = -2;
  const std::string packet = capture::tev_update_packet("b", image);
  CHECK(packet == "\x5e\0\0\0\x06\0b\0\x03\0\0\0R\0G\0B\0"s + "\0\0\0\0\0\0\0\0\x01\0\0\0\x01\0\0\0"s +
                      "\0\0\0\0\0\0\0\0\x01\0\0\0\0\0\0\0\x02\0\0\0\0\0\0\0"s +
                      "\x03\0\0\0\0\0\0\0\x03\0\0\0\0\0\0\0\x03\0\0\0\0\0\0\0"s + "\0\0\x80\x3f\0\0\0\0\0\0\0\xc0"s);
}

TEST_CASE("tev shows every camera's newest frame, 1 where the sensor clips", "[preview]") {
  core::set_quiet(true);
  FakeViewer viewer;
  PreviewOptions options;
  options.tev_address = viewer.address();
  const CameraFrame left = frame_of(5, 7, 3), right = frame_of(4, 3, 1), later = frame_of(5, 7, 3, 1);
  std::map<std::string, core::Image> shown;
  {
    Preview preview(options);
    preview.show("left", left);
    const std::vector<std::string> first = viewer.read(2);  // so that nothing is dropped
    preview.show("right", right);
    std::vector<std::string> packets = viewer.read(2);
    packets.insert(packets.begin(), first.begin(), first.end());
    preview.show("left", later);
    for (std::string& p : viewer.read(1)) packets.push_back(std::move(p));
    REQUIRE(packets.size() == 5);  // created once each
    shown = shown_by(packets);
  }
  REQUIRE(shown.size() == 2);
  const auto expected = [](const CameraFrame& frame) {
    core::Image image = frame.image;
    for (float& v : image.values()) v /= 2;
    return image;
  };
  CHECK(shown.at("lightstage left") == expected(later));
  CHECK(shown.at("lightstage right") == expected(right));
}

TEST_CASE("a large frame is shown smaller, one with a value that is no number without it", "[preview]") {
  core::set_quiet(true);
  FakeViewer viewer;
  TevLink link(viewer.address());
  PreviewOptions options;
  options.tev_address = viewer.address();
  CameraFrame frame = frame_of(1500, 2050, 1);
  for (float& v : frame.image.values()) v = 2;
  frame.image(1499, 2049) = std::nanf("");
  std::map<std::string, core::Image> shown;
  {
    Preview preview(options);
    preview.show("c", frame);
    shown = shown_by(viewer.read(2));
  }
  const core::Image& image = shown.at("lightstage c");
  CHECK(image.size() == core::ImageSize{500, 684, 1});
  CHECK(image(0, 0) == 1);
  CHECK(image(499, 683) == 0);
}

TEST_CASE("every n-th frame of each camera is shown", "[preview]") {
  core::set_quiet(true);
  FakeViewer viewer;
  PreviewOptions options;
  options.tev_address = viewer.address();
  options.every = 3;
  Preview preview(options);
  for (int i = 0; i < 7; ++i) {
    preview.show("a", frame_of(2, 2, 1, static_cast<float>(i)));
    if (i % 3 != 0) continue;
    const std::vector<std::string> packets = viewer.read(i == 0 ? 2 : 1);
    REQUIRE(packets.size() == (i == 0 ? 2u : 1u));
    float first = 0;
    std::memcpy(&first, packets.back().data() + packets.back().size() - 16, sizeof first);
    CHECK(first == Approx((static_cast<float>(i) + 0.01f) / 2));
  }
  CHECK(viewer.read(1, 50ms).empty());
}

TEST_CASE("a still is the first camera's, display-encoded, white where the sensor clips", "[preview]") {
  core::set_quiet(true);
  const test::TemporaryFolder folder;
  const std::filesystem::path path = folder / "still.png";
  CameraFrame frame = frame_of(3, 4, 3);
  frame.image(1, 2, 0) = 1;
  frame.image(2, 3, 1) = 5;
  {
    Preview preview(only_still(path));
    CHECK(core::read_image(path)(0, 0) == 0);  // before the first frame
    preview.show("first", frame);
    preview.show("second", frame_of(9, 9, 1));
  }
  const core::Image still = core::read_image(path, {core::Encoding::kLinear});
  REQUIRE(still.size() == core::ImageSize{3, 4, 3});
  CHECK(still(1, 2, 0) == Approx(core::srgb_encode(0.5f)).margin(0.003));
  CHECK(still(2, 3, 1) == 1);
  CHECK(still(0, 1, 2) == Approx(core::srgb_encode(0.03f)).margin(0.003));
  CHECK(std::distance(std::filesystem::directory_iterator(folder.path()), {}) == 1);
}

TEST_CASE("a reader never sees half a still", "[preview]") {
  core::set_quiet(true);
  const test::TemporaryFolder folder;
  const std::filesystem::path path = folder / "still.png";
  Preview preview(only_still(path));
  std::set<int> widths;
  const SteadyClock::time_point end = SteadyClock::now() + 700ms;
  for (int i = 0; SteadyClock::now() < end; ++i) {
    preview.show("c", frame_of(200, 200 + i % 8, 3));
    const core::Image seen = core::read_image(path);  // throws for a damaged or missing file
    widths.insert(seen.width());
  }
  CHECK(widths.size() > 3);
}

TEST_CASE("what is wrong with a preview is known before the pass", "[preview]") {
  const test::TemporaryFolder folder;
  CHECK_THROWS_WITH(Preview(only_still(folder / "no" / "still.png")), Catch::Contains("there is no folder"));
  CHECK_THROWS_AS(Preview(only_still(folder / "no" / "still.png")), core::BadInput);
  CHECK_THROWS_WITH(Preview(only_still(folder / "still.xyz")), Catch::Contains("not an image format"));
  CHECK_THROWS_WITH(Preview(only_still(folder.path())), Catch::Contains("cannot") || Catch::Contains("not an image"));
  std::filesystem::create_directory(folder / "folder.png");
  CHECK_THROWS_WITH(Preview(only_still(folder / "folder.png")), Catch::Contains("it names a folder"));
  if (::geteuid() != 0) {
    ::chmod(folder.path().c_str(), 0500);
    CHECK_THROWS_AS(Preview(only_still(folder / "still.png")), core::BadInput);
    ::chmod(folder.path().c_str(), 0700);
  }
  PreviewOptions options;
  for (const char* address : {"127.0.0.1", "127.0.0.1:tev", ":14158", "::1:14158", "no.such.host.invalid:14158"}) {
    CAPTURE(address);
    options.tev_address = address;
    CHECK_THROWS_AS(Preview(options), core::BadInput);
  }
  options = {};
  options.every = 0;
  CHECK_THROWS_AS(Preview(options), core::UsageError);
}

TEST_CASE("nobody listening costs a pass nothing", "[preview]") {
  core::set_quiet(true);
  test::FakeRig fake(6, 2);
  PreviewOptions options;
  options.tev_address = closed_address();
  capture::OlatOptions olat;
  olat.light_count = 6;
  const capture::Sequence sequence = capture::make_olat_sequence(olat);
  Preview preview(options);
  capture::SessionOptions session;
  session.on_frame = [&](const db::Step&, const std::string& camera, const CameraFrame& frame) {
    preview.show(camera, frame);
  };
  const SteadyClock::time_point begin = SteadyClock::now();
  CHECK(capture::dry_run(sequence, fake.rig(), session).stored == 2 * sequence.steps.size());
  CHECK(SteadyClock::now() - begin < 3s);
}

TEST_CASE("a viewer that accepts and never reads slows nothing and is given up", "[preview]") {
  core::set_quiet(true);
  FakeViewer viewer;                                  // the system accepts for it
  const CameraFrame large = frame_of(1024, 1024, 3);  // more than loopback's buffers hold
  const auto longest_call = [&](const std::string& address) {
    PreviewOptions options;
    options.tev_address = address;
    SteadyClock::duration longest{};
    Preview preview(options);
    for (int i = 0; i < 20; ++i) {
      const SteadyClock::time_point before = SteadyClock::now();
      preview.show("c", large);
      longest = std::max(longest, SteadyClock::now() - before);
      std::this_thread::sleep_for(20ms);
    }
    return longest;
  };
  const SteadyClock::duration alone = longest_call("");
  const SteadyClock::time_point begin = SteadyClock::now();
  // A stalled send takes 300 ms; a call that waited for it would show.
  CHECK(longest_call(viewer.address()) < 2 * alone + 250ms);
  CHECK(SteadyClock::now() - begin < 20 * (2 * alone + 20ms) + 3s);
}

TEST_CASE("a viewer that goes away is found again, and is sent whole images anew", "[preview]") {
  core::set_quiet(true);
  capture::TevPatience patience;
  patience.retry = 30ms;
  auto viewer = std::make_unique<FakeViewer>();
  const std::uint16_t port = viewer->port();
  TevLink link(viewer->address(), patience);
  const core::Image image = frame_of(4, 4, 3).image;
  CHECK(link.show("x", image));
  CHECK(viewer->read(2).size() == 2);
  viewer.reset();
  CHECK_FALSE(link.show("x", image));  // gone, and too early to try again
  std::this_thread::sleep_for(50ms);
  CHECK_FALSE(link.show("x", image));  // still gone
  viewer = std::make_unique<FakeViewer>(port);
  std::this_thread::sleep_for(50ms);
  CHECK(link.show("x", image));
  CHECK(shown_by(viewer->read(2)).at("x") == image);
}

TEST_CASE("a viewer that stops within a packet gets no second half of it", "[preview]") {
  core::set_quiet(true);
  capture::TevPatience patience;
  patience.stall = 50ms;
  patience.retry = 0ms;
  auto viewer = std::make_unique<FakeViewer>();
  const std::uint16_t port = viewer->port();
  TevLink link(viewer->address(), patience);
  CHECK_FALSE(link.show("x", frame_of(1500, 1500, 3).image));
  viewer.reset();
  viewer = std::make_unique<FakeViewer>(port);
  const core::Image small = frame_of(2, 2, 3).image;
  CHECK(link.show("x", small));
  CHECK(shown_by(viewer->read(2)).at("x") == small);
}

TEST_CASE("a still that can no longer be written does not end the pass", "[preview]") {
  core::set_quiet(true);
  const test::TemporaryFolder folder;
  std::filesystem::create_directory(folder / "there");
  {
    Preview preview(only_still(folder / "there" / "still.png"));
    std::filesystem::remove_all(folder / "there");
    for (int i = 0; i < 3; ++i) CHECK_NOTHROW(preview.show("c", frame_of(4, 4, 1)));
  }  // waits for the stills
  CHECK_FALSE(std::filesystem::exists(folder / "there"));
}
