#include "capture/usb/dmx_leds.h"

#include <catch2/catch.hpp>
#include <map>
#include <memory>
#include <utility>

#include "core/error.h"

using namespace lightstage;
using namespace lightstage::capture;
using core::kMillisecond;
using core::Nanoseconds;

namespace {

using Bytes = std::vector<std::uint8_t>;

enum class Fault { kNone, kMute, kAnswerLost, kAnswerLate, kAnswerDamaged, kUnplugged };

// A widget with dimmers: its frames follow each other at its rate, and a message takes effect with the frame after it.
class Widget {
 public:
  explicit Widget(const core::VirtualClock& clock) : clock_(clock) {}

  void hear(std::span<const std::uint8_t> bytes) {
    reader_.feed(bytes);
    while (const std::optional<DmxMessage> message = reader_.next()) {
      if (message->label == 6) sent.push_back({clock_.now(), {message->data.begin() + 1, message->data.end()}});
      if (message->label == 3) answer(encode(DmxMessage{3, {1, 4, 9, 1, rate}}));
    }
  }
  // What the dimmers have got for sure: the last pattern that two periods have passed since.
  std::uint8_t channel(std::size_t number) const {
    std::uint8_t level = 0;
    for (const Sent& s : sent) {
      const bool got = clock_.now() - s.time >= 2 * std::max<Nanoseconds>(core::kSecond / rate, 96'000 + 513 * 44'000);
      if (got && number <= s.channels.size()) level = s.channels[number - 1];
    }
    return level;
  }

  struct Sent {
    Nanoseconds time = 0;
    Bytes channels;
  };
  std::vector<Sent> sent;
  std::uint8_t rate = 40;
  Bytes output;

 private:
  void answer(const Bytes& bytes) { output.insert(output.end(), bytes.begin(), bytes.end()); }
  const core::VirtualClock& clock_;
  DmxReader reader_;
};

class FaultyLink : public LedLink {
 public:
  FaultyLink(Widget& widget, core::VirtualClock& clock) : widget_(widget), clock_(clock) {}
  void write(std::span<const std::uint8_t> bytes, Nanoseconds) override {
    const auto found = faults.find(writes++);
    fault_ = found == faults.end() ? Fault::kNone : found->second;
    if (fault_ == Fault::kUnplugged) plugged = false;
    if (!plugged) throw core::DeviceError("DMX widget: unplugged");
    if (fault_ != Fault::kMute) widget_.hear(bytes);
  }
  Bytes read(Nanoseconds deadline) override {
    if (!plugged) throw core::DeviceError("DMX widget: unplugged");
    Bytes bytes = std::exchange(late_, {});
    if (bytes.empty()) bytes = std::exchange(widget_.output, {});
    const Fault fault = bytes.empty() ? Fault::kNone : std::exchange(fault_, Fault::kNone);
    if (fault == Fault::kAnswerLate) late_ = bytes;
    if (fault == Fault::kAnswerLate || fault == Fault::kAnswerLost) bytes.clear();
    if (fault == Fault::kAnswerDamaged) bytes.back() ^= 1;
    if (bytes.empty()) clock_.sleep_until(deadline);
    return bytes;
  }
  std::map<int, Fault> faults;
  int writes = 0;
  bool plugged = true;

 private:
  Widget& widget_;
  core::VirtualClock& clock_;
  Fault fault_ = Fault::kNone;
  Bytes late_;
};

using Channels = std::vector<std::vector<int>>;

struct Rig {
  explicit Rig(Channels channels = {{1, 2, 3}, {30}, {7, 6, 5}}) : widget(clock) {
    auto owned = std::make_unique<FaultyLink>(widget, clock);
    link = owned.get();
    leds = std::make_unique<DmxLeds>(std::move(owned), DmxLedsOptions{"DMX widget 'A'", std::move(channels)}, clock);
  }
  core::VirtualClock clock;
  Widget widget;
  FaultyLink* link = nullptr;
  std::unique_ptr<DmxLeds> leds;
};

}  // namespace

TEST_CASE("a light's levels are on its channels when show returns", "[dmx]") {
  Rig rig;
  CHECK(rig.leds->light_count() == 3);
  rig.leds->show(std::vector<LightLevel>{{0, 1, 0.5F, 0}, {1, 0.3F, 0.6F, 0.9F}});
  CHECK(rig.widget.channel(1) == 255);
  CHECK(rig.widget.channel(2) == 128);
  CHECK(rig.widget.channel(3) == 0);
  CHECK(rig.widget.channel(30) == 153);
  CHECK(rig.widget.sent.back().channels.size() == 30);
  rig.leds->show(std::vector<LightLevel>{{2, 1.0F / 255, 0.499F / 255, 0.2F}});
  CHECK(rig.widget.channel(1) == 0);
  CHECK(rig.widget.channel(7) == 1);
  CHECK(rig.widget.channel(6) == 0);
  CHECK(rig.widget.channel(5) == 51);
  rig.leds->all_off();
  for (std::size_t channel = 1; channel <= 512; ++channel) CHECK(rig.widget.channel(channel) == 0);
  CHECK(rig.widget.sent.back().channels.size() == 512);
}

TEST_CASE("show waits for two frames and not longer", "[dmx]") {
  Rig rig;
  const Nanoseconds before = rig.clock.now();
  rig.leds->show({});
  CHECK(rig.clock.now() - before == 50 * kMillisecond);
}

TEST_CASE("everything is off after opening and after closing", "[dmx]") {
  Rig rig;
  REQUIRE(rig.widget.sent.size() == 1);
  CHECK(rig.widget.sent[0].channels == Bytes(512, 0));
  rig.leds->show(std::vector<LightLevel>{{0}});
  rig.leds.reset();
  CHECK(rig.widget.sent.back().channels == Bytes(512, 0));
}

TEST_CASE("channels that cannot be are refused", "[dmx]") {
  CHECK_THROWS_AS(Rig(Channels{{0}}), core::UsageError);
  CHECK_THROWS_AS(Rig(Channels{{513}}), core::UsageError);
  CHECK_THROWS_AS(Rig(Channels{{1, 2}}), core::UsageError);
  CHECK_THROWS_AS(Rig(Channels{{}}), core::UsageError);
  CHECK_THROWS_AS(Rig(Channels{{1, 2, 3}, {3}}), core::UsageError);
  CHECK_NOTHROW(Rig(Channels{{512}}));
  Rig rig;
  const std::size_t sent = rig.widget.sent.size();
  CHECK_THROWS_AS(rig.leds->show(std::vector<LightLevel>{{3}}), core::DeviceError);
  CHECK_THROWS_AS(rig.leds->show(std::vector<LightLevel>{{0, NAN, 1, 1}}), core::DeviceError);
  CHECK(rig.widget.sent.size() == sent);
}

TEST_CASE("a widget that misses a message or whose answer is lost is asked again", "[dmx]") {
  const Fault fault = GENERATE(Fault::kMute, Fault::kAnswerLost, Fault::kAnswerLate, Fault::kAnswerDamaged);
  const int times = GENERATE(1, 2);
  Rig rig;
  for (int i = 0; i < times; ++i) rig.link->faults[rig.link->writes + i] = fault;
  rig.leds->show(std::vector<LightLevel>{{0}});
  CHECK(rig.widget.channel(1) == 255);
  rig.leds->show(std::vector<LightLevel>{{1}});
  CHECK(rig.widget.channel(1) == 0);
  CHECK(rig.widget.channel(30) == 255);
}

TEST_CASE("a mute widget is named after three tries, an unplugged one at once", "[dmx]") {
  Rig rig;
  for (int i = 0; i < 3; ++i) rig.link->faults[rig.link->writes + i] = Fault::kMute;
  CHECK_THROWS_WITH(rig.leds->show({}), Catch::Contains("DMX widget 'A': no answer (asked 3 times)"));
  CHECK_NOTHROW(rig.leds->show({}));
  rig.link->faults[rig.link->writes] = Fault::kUnplugged;
  CHECK_THROWS_AS(rig.leds->show(std::vector<LightLevel>{{0}}), core::DeviceError);
  CHECK_THROWS_AS(rig.leds->status(), core::DeviceError);
  rig.link->plugged = true;
  rig.leds->all_off();
  CHECK(rig.widget.channel(1) == 0);
  CHECK(rig.leds->status().faults.empty());
}
