#include "hil/rig/rig.h"

#include <fcntl.h>
#include <linux/gpio.h>
#include <poll.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include <algorithm>
#include <cstring>
#include <filesystem>
#include <iostream>
#include <stdexcept>
#include <utility>

#include "hil/rig/now.h"

namespace lightstage::hil {

namespace {

// Ports of the virtual host controller; cameras have those from 1 on.
constexpr int kLedPort = 0, kDmxPort = 7;
// The kernel keeps a port for a while after its device was unplugged.
constexpr Nanoseconds kPlugAgain = 10 * kMillisecond;

const char* fate(const FrameFault& fault) {
  if (fault.drop) return "dropped";
  if (fault.truncate) return "short";
  if (fault.flag_error) return "error";
  if (fault.duplicate) return "duplicate";
  return fault.delay > 0 ? "late" : "whole";
}

}  // namespace

Rig::Rig(int cameras, const std::string& log_path) : log_(log_path), led_(kLedPort, scene_), dmx_(kDmxPort, scene_) {
  scene_.on_change = [this](Nanoseconds time, const Levels& levels) {
    const nlohmann::json lit = lit_cells(levels);
    lit_ = lit.size();
    log_.write(time, "lights", {{"lit", lit}});
  };
  script_.act = [this](const std::vector<std::string>& action) { act(action); };
  led_.on_request = [this] {
    script_.happened("request");
    if (!cut_.empty()) act({"unplug", "led", std::exchange(cut_, {}).at(2)});
  };
  dmx_.on_values = [this] { script_.happened("show"); };
  gpio_.on_request = [this] { script_.happened("write"); };
  gpio_.on_line = [this](int line, bool high) {
    for (const auto& camera : cameras_) {
      if (high && (line == camera->index() || line == kCommonTrigger)) trigger(*camera);
    }
  };
  for (int i = 0; i < cameras; ++i) {
    cameras_.push_back(std::make_unique<UvcCamera>(i, scene_));
    wire(*cameras_.back());
    plug("cam" + std::to_string(i));
  }
  plug("led");
  plug("gpio");
}

void Rig::wire(UvcCamera& camera) {
  const int index = camera.index();
  camera.fault_of = [this, index](int number) { return script_.exposure(index, number); };
  camera.on_exposure = [this, &camera](const UvcCamera::Exposure& exposure) { log_exposure(camera, exposure); };
  camera.on_stream = [this, index](bool on) { log_.write(now(), "stream", {{"camera", index}, {"on", on}}); };
  if (index != 0) return;
  camera.on_strobe = [this](UvcCamera::Strobe strobe, Nanoseconds time) {
    const bool high = strobe == UvcCamera::Strobe::kOn;
    led_.strobe(high, time);
    gpio_.set_input(kStrobeInput, high);
  };
}

void Rig::trigger(UvcCamera& camera) {
  const Nanoseconds time = now();
  const bool taken = camera.trigger(time);
  log_.write(time, "trigger", {{"camera", camera.index()}, {"taken", taken}});
}

void Rig::log_exposure(const UvcCamera& camera, const UvcCamera::Exposure& exposure) {
  ++exposures_;
  log_.write(now(), "exposure",
             {{"camera", camera.index()},
              {"number", exposure.number},
              {"start", exposure.start},
              {"end", exposure.end},
              {"lit", lit_cells(exposure.levels)},
              {"sent", fate(exposure.fault)}});
}

UvcCamera& Rig::camera(const std::string& word) {
  const int number = camera_number(word);
  if (number < 0 || number >= static_cast<int>(cameras_.size())) throw std::runtime_error("no device '" + word + "'");
  return *cameras_[static_cast<std::size_t>(number)];
}

bool Rig::plug(const std::string& device) {
  const auto plug_usb = [&](UsbipDevice& usb) { return usb.plugged() || usb.plug(); };
  bool plugged = true;
  if (device == "gpio") {
    if (!gpio_.plugged()) gpio_.plug();
  } else if (device == "led") {
    plugged = plug_usb(led_);
  } else if (device == "dmx") {
    plugged = plug_usb(dmx_);
  } else {
    plugged = plug_usb(camera(device));
  }
  if (plugged) log_.write(now(), "plug", {{"device", device}});
  return plugged;
}

void Rig::unplug(const std::string& device) {
  if (device == "gpio") {
    gpio_.unplug();
  } else if (device == "led") {
    led_.unplug();
  } else if (device == "dmx") {
    dmx_.unplug();
  } else {
    camera(device).unplug();
  }
  log_.write(now(), "unplug", {{"device", device}});
}

void Rig::replug_later(const std::string& device, const std::vector<std::string>& words) {
  if (words.size() > 2) replugs_.push_back({device, now() + std::stoi(words[2]) * kMillisecond});
}

void Rig::hold_gpio_number() {
  for (const auto& entry : std::filesystem::directory_iterator("/dev")) {
    if (!entry.path().filename().string().starts_with("gpiochip")) continue;
    FileDescriptor chip(open(entry.path().c_str(), O_RDWR | O_CLOEXEC));
    gpiochip_info info{};
    if (chip && ioctl(chip.get(), GPIO_GET_CHIPINFO_IOCTL, &info) == 0 && std::strcmp(info.label, "cp2112_gpio") == 0) {
      held_chip_ = std::move(chip);
    }
  }
}

void Rig::act(const std::vector<std::string>& action) {
  const std::string& verb = action.at(0);
  const std::string device = action.size() > 1 ? action[1] : "";
  const auto count = [&] { return std::stoi(action.at(2)); };
  if (verb == "free" || verb == "triggered") {
    camera(device).set_free_running(verb == "free");
  } else if (verb == "plug") {
    if (!plug(device)) replugs_.push_back({device, now() + kPlugAgain});
  } else if (verb == "unplug") {
    unplug(device);
    replug_later(device, action);
  } else if (verb == "cut" && device == "led") {
    count();  // there must be one
    cut_ = action;
  } else if (verb == "renumber" && device == "gpio") {
    hold_gpio_number();
    unplug(device);
    replug_later(device, action);
  } else if (verb == "mute" && device == "led") {
    led_.mute(count());
  } else if (verb == "stall" && device == "led") {
    led_.stall(count());
  } else if (verb == "refuse" && device == "gpio") {
    gpio_.refuse(count());
  } else if (verb == "ignore" && device == "gpio") {
    gpio_.ignore(count());
  } else {
    throw std::runtime_error("no action '" + verb + " " + device + "'");
  }
  log_.write(now(), "fault", {{"action", action}});
}

std::string Rig::obey(const std::string& line) {
  try {
    const std::vector<std::string> all = words(line);
    if (!all.empty() && all[0] == "begin") {
      script_.clear();
      exposures_ = 0;
      led_.power_cycle();
      for (const auto& camera : cameras_) camera->restart_count();
      log_.write(now(), "begin", {{"name", all.at(1)}});
    } else if (line == "state") {
      return nlohmann::json{{"lit", lit_}, {"script", script_.size()}, {"exposures", exposures_}}.dump();
    } else {
      script_.add(line);
    }
    return "ok";
  } catch (const std::exception& error) {
    return std::string("error: ") + error.what();
  }
}

std::optional<Nanoseconds> Rig::next_event() const {
  std::optional<Nanoseconds> next;
  const auto consider = [&](std::optional<Nanoseconds> time) {
    if (time) next = next ? std::min(*next, *time) : *time;
  };
  for (const auto& camera : cameras_) consider(camera->next_event());
  consider(led_.next_event());
  consider(dmx_.next_event());
  for (const Replug& replug : replugs_) consider(replug.time);
  return next;
}

void Rig::replug_due(Nanoseconds time) {
  std::vector<Replug> due;
  std::erase_if(replugs_, [&](const Replug& r) { return r.time <= time && (due.push_back(r), true); });
  for (const Replug& replug : due) {
    if (!plug(replug.device)) replugs_.push_back({replug.device, time + kPlugAgain});
  }
}

// Everything that is due, in the order of its times: a camera whose exposure ended before the light changed must not see that
// change, however late both are looked at.
void Rig::advance_all(Nanoseconds until) {
  for (;;) {
    const std::optional<Nanoseconds> next = next_event();
    const Nanoseconds time = next ? std::min(*next, until) : until;
    for (const auto& camera : cameras_) camera->advance(time);
    led_.advance(time);
    dmx_.advance(time);
    replug_due(time);
    if (!next || *next > until) return;
  }
}

void Rig::run() {
  std::string commands;
  for (;;) {
    std::vector<pollfd> files{
        {STDIN_FILENO, POLLIN, 0}, {gpio_.fd(), POLLIN, 0}, {led_.fd(), POLLIN, 0}, {dmx_.fd(), POLLIN, 0}};
    for (const auto& camera : cameras_) files.push_back({camera->fd(), POLLIN, 0});
    const std::optional<Nanoseconds> next = next_event();
    timespec timeout{};
    if (next) {
      const Nanoseconds wait = std::max<Nanoseconds>(0, *next - now());
      timeout = {wait / 1'000'000'000, wait % 1'000'000'000};
    }
    if (ppoll(files.data(), files.size(), next ? &timeout : nullptr, nullptr) < 0)
      throw std::runtime_error("ppoll failed");
    advance_all(now());
    // One message each, so that time goes on between them. What one of them unplugged is not served.
    const auto ready = [&](std::size_t file, int fd) { return files[file].revents != 0 && files[file].fd == fd; };
    if (ready(1, gpio_.fd())) gpio_.serve();
    if (ready(2, led_.fd())) led_.serve();
    if (ready(3, dmx_.fd())) dmx_.serve();
    for (std::size_t i = 0; i < cameras_.size(); ++i) {
      if (ready(4 + i, cameras_[i]->fd())) cameras_[i]->serve();
    }
    if (!files[0].revents) continue;
    std::array<char, 4096> text{};
    const ssize_t count = read(STDIN_FILENO, text.data(), text.size());
    if (count <= 0) return;
    commands.append(text.data(), static_cast<std::size_t>(count));
    for (std::size_t end = 0; (end = commands.find('\n')) != std::string::npos; commands.erase(0, end + 1)) {
      std::cout << obey(commands.substr(0, end)) << std::endl;
    }
  }
}

}  // namespace lightstage::hil
