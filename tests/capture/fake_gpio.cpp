#include "capture/fake_gpio.h"

#include "core/error.h"

namespace lightstage::test {

namespace {

// Lines that are held, as long as it lives.
class Held {
 public:
  Held(FakeGpio& gpio, const capture::GpioRequest& request) : gpio_(gpio) {
    gpio.requests.push_back(request);
    check();
    gpio.held += 1;
  }
  ~Held() { gpio_.held -= 1; }
  Held(const Held&) = delete;
  Held& operator=(const Held&) = delete;

  void check() {
    if (!gpio_.is_there()) throw core::DeviceError("GPIO fake: gone");
  }

 protected:
  void spend(core::Nanoseconds time) { gpio_.clock->sleep_until(gpio_.clock->now() + time); }

  FakeGpio& gpio_;
};

class Outputs final : public capture::GpioOutputs, private Held {
 public:
  Outputs(FakeGpio& gpio, const capture::GpioRequest& request) : Held(gpio, request) {
    gpio.levels.resize(request.lines.size());
    gpio.ignores_orders.resize(request.lines.size());
    change(false);
  }

  void set(bool active) override {
    gpio_.sets += 1;
    spend(gpio_.set_takes);
    check();
    if (gpio_.good_sets > 0) {
      gpio_.good_sets -= 1;
    } else if (gpio_.failing_sets > 0) {
      gpio_.failing_sets -= 1;
      throw core::DeviceError("GPIO fake: cannot set");
    }
    change(active);
  }

  std::vector<bool> read() override {
    gpio_.reads += 1;
    spend(gpio_.read_takes);
    check();
    if (!gpio_.tells_outputs) throw core::DeviceError("GPIO fake: cannot read back");
    return gpio_.levels;
  }

 private:
  void change(bool active) {
    for (std::size_t i = 0; i < gpio_.levels.size(); ++i) {
      if (gpio_.ignores_orders[i]) continue;
      if (i == 0 && gpio_.levels[0] != active) gpio_.changes.push_back({gpio_.clock->now(), active});
      gpio_.levels[i] = active;
    }
  }
};

class Edges final : public capture::GpioEdges, private Held {
 public:
  Edges(FakeGpio& gpio, const capture::GpioRequest& request) : Held(gpio, request) {}

  std::optional<core::Nanoseconds> next_edge(core::Nanoseconds timeout) override {
    if (gpio_.failing_edges > 0) {
      gpio_.failing_edges -= 1;
      throw core::DeviceError("GPIO fake: cannot read an edge");
    }
    const core::Nanoseconds now = gpio_.clock->now();
    if (gpio_.edges_never_end) return now;
    if (gpio_.edges.empty() || gpio_.edges.front() > now + timeout || !gpio_.is_there()) {
      gpio_.clock->sleep_until(now + timeout);
      return {};
    }
    const core::Nanoseconds edge = gpio_.edges.front();
    gpio_.edges.pop_front();
    gpio_.clock->sleep_until(edge);
    return edge;
  }

  void check() override { Held::check(); }
};

class Chips final : public capture::GpioChips {
 public:
  explicit Chips(FakeGpio& gpio) : gpio_(gpio) {}
  std::unique_ptr<capture::GpioOutputs> open_outputs(const capture::GpioRequest& request) override {
    return std::make_unique<Outputs>(gpio_, request);
  }
  std::unique_ptr<capture::GpioEdges> open_edges(const capture::GpioRequest& request) override {
    return std::make_unique<Edges>(gpio_, request);
  }

 private:
  FakeGpio& gpio_;
};

}  // namespace

bool FakeGpio::any_active() const {
  return std::any_of(levels.begin(), levels.end(), [](bool active) { return active; });
}

bool FakeGpio::is_there() {
  if (comes_back_at >= 0 && clock->now() >= comes_back_at) plugged_in = true;
  return plugged_in;
}

std::unique_ptr<capture::GpioChips> fake_chips(FakeGpio& gpio) {
  return std::make_unique<Chips>(gpio);
}

}  // namespace lightstage::test
