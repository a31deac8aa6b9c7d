#include "capture/led_group.h"

#include <algorithm>
#include <exception>

#include "core/error.h"

namespace lightstage::capture {

namespace {

// Where a light of the group is.
struct Place {
  std::size_t member = 0;
  int light = 0;
};

// Runs call(i) for each of `count` members, whatever they throw, and throws at the end.
template <class Call>
void for_each_member(std::size_t count, const Call& call) {
  std::string troubles;
  std::exception_ptr other;  // what is no device's fault comes first
  for (std::size_t i = 0; i < count; ++i) {
    try {
      call(i);
    } catch (const core::DeviceError& error) {
      troubles += (troubles.empty() ? "" : "; ") + std::string(error.what());
    } catch (...) {
      if (other == nullptr) other = std::current_exception();
    }
  }
  if (other != nullptr) std::rethrow_exception(other);
  if (!troubles.empty()) throw core::DeviceError(troubles);
}

std::vector<Place> place_lights(const std::vector<LedGroupMember>& members) {
  std::size_t count = 0;
  for (const LedGroupMember& member : members) count += member.lights.size();
  std::vector<Place> places(count);
  for (std::size_t m = 0; m < members.size(); ++m) {
    for (std::size_t i = 0; i < members[m].lights.size(); ++i) {
      places.at(static_cast<std::size_t>(members[m].lights[i])) = {m, static_cast<int>(i)};
    }
  }
  return places;
}

class LedGroup final : public LedController, public PatternPlayer {
 public:
  explicit LedGroup(std::vector<LedGroupMember> members)
      : members_(std::move(members)), places_(place_lights(members_)) {}

  std::size_t light_count() const override { return places_.size(); }

  void show(std::span<const LightLevel> levels) override {
    const std::vector<std::vector<LightLevel>> parts = split(levels);
    for_each_member(members_.size(), [&](std::size_t i) { members_[i].controller->show(parts[i]); });
  }

  void all_off() override {
    for_each_member(members_.size(), [&](std::size_t i) { members_[i].controller->all_off(); });
  }

  LedStatus status() override {
    LedStatus all;
    for_each_member(members_.size(), [&](std::size_t i) {
      const LedStatus one = members_[i].controller->status();
      if (one.temperature_celsius) {
        all.temperature_celsius = std::max(*one.temperature_celsius, all.temperature_celsius.value_or(-273.15));
      }
      if (one.supply_volts)
        all.supply_volts = std::min(*one.supply_volts, all.supply_volts.value_or(*one.supply_volts));
      for (const std::string& fault : one.faults) all.faults.push_back(members_[i].name + ": " + fault);
    });
    return all;
  }

  PatternPlayer* player() override {
    for (const LedGroupMember& member : members_) {
      if (member.controller->player() == nullptr) return nullptr;
    }
    return this;
  }

  void load(std::span<const std::vector<LightLevel>> patterns) override {
    std::vector<std::vector<std::vector<LightLevel>>> parts(members_.size());
    for (const std::vector<LightLevel>& pattern : patterns) {
      std::vector<std::vector<LightLevel>> part = split(pattern);
      for (std::size_t i = 0; i < members_.size(); ++i) parts[i].push_back(std::move(part[i]));
    }
    for_each_member(members_.size(), [&](std::size_t i) { player_of(i).load(parts[i]); });
  }

  void arm(std::size_t first, core::Nanoseconds delay) override {
    for_each_member(members_.size(), [&](std::size_t i) { player_of(i).arm(first, delay); });
  }

  std::size_t position() override {
    std::vector<std::size_t> positions(members_.size(), 0);
    for_each_member(members_.size(), [&](std::size_t i) { positions[i] = player_of(i).position(); });
    for (std::size_t i = 1; i < positions.size(); ++i) {
      if (positions[i] == positions[0]) continue;
      throw core::DeviceError("LED controllers " + members_[0].name + " and " + members_[i].name +
                              " are at different patterns: look at the strobe's wires");
    }
    return positions.at(0);
  }

  std::optional<core::Nanoseconds> wait_for_pattern(std::size_t index, core::Nanoseconds deadline) override {
    std::optional<core::Nanoseconds> last;
    bool reached = true;
    for_each_member(members_.size(), [&](std::size_t i) {
      const std::optional<core::Nanoseconds> time = player_of(i).wait_for_pattern(index, deadline);
      reached = reached && time;
      if (time) last = std::max(*time, last.value_or(*time));
    });
    return reached ? last : std::nullopt;
  }

 private:
  // Each member's part, in its own numbering: an empty one turns all its lights off.
  std::vector<std::vector<LightLevel>> split(std::span<const LightLevel> levels) const {
    std::vector<std::vector<LightLevel>> parts(members_.size());
    for (LightLevel level : levels) {
      const Place& place = places_.at(static_cast<std::size_t>(level.light_index));
      level.light_index = place.light;
      parts[place.member].push_back(level);
    }
    return parts;
  }

  PatternPlayer& player_of(std::size_t member) {
    PatternPlayer* player = members_[member].controller->player();
    if (player == nullptr) {
      throw core::DeviceError("LED controller " + members_[member].name + ": no longer holds sequences");
    }
    return *player;
  }

  std::vector<LedGroupMember> members_;
  std::vector<Place> places_;
};

}  // namespace

std::unique_ptr<LedController> make_led_group(std::vector<LedGroupMember> members) {
  return std::make_unique<LedGroup>(std::move(members));
}

}  // namespace lightstage::capture
