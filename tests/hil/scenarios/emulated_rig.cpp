#include "hil/scenarios/emulated_rig.h"

#include <fcntl.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <cstdlib>
#include <fstream>
#include <stdexcept>

#include "capture/gpio_lines.h"
#include "capture/v4l2_cameras.h"
#include "hil/scenarios/wait.h"

namespace lightstage::hil {

namespace {

std::array<int, 2> make_pipe() {
  std::array<int, 2> ends{};
  if (pipe2(ends.data(), O_CLOEXEC) != 0) throw std::runtime_error("no pipe");
  return ends;
}

bool devices_are_there() {
  const auto cameras = capture::v4l2_cameras_seen();
  const auto count =
      std::count_if(cameras.begin(), cameras.end(), [](const auto& c) { return c.driver == "uvcvideo"; });
  return count == kRigCameras && !capture::gpio_chips_seen().empty();
}

}  // namespace

std::filesystem::path output_folder() {
  const char* folder = std::getenv("LIGHTSTAGE_HIL_OUT");
  if (!folder) throw std::runtime_error("LIGHTSTAGE_HIL_OUT is not set: run tests/hil/run");
  return folder;
}

EmulatedRig& EmulatedRig::instance() {
  static EmulatedRig rig;
  return rig;
}

EmulatedRig::EmulatedRig() : log_(output_folder() / "events.jsonl") {
  const auto [commands_out, commands_in] = make_pipe();
  const auto [answers_out, answers_in] = make_pipe();
  const std::string cameras = std::to_string(kRigCameras), log = log_.string();
  process_ = fork();
  if (process_ < 0) throw std::runtime_error("cannot fork");
  if (process_ == 0) {
    dup2(commands_out, STDIN_FILENO);
    dup2(answers_in, STDOUT_FILENO);
    execl(LIGHTSTAGE_HIL_RIG, "hil_rig", cameras.c_str(), log.c_str(), nullptr);
    _exit(127);
  }
  close(commands_out);
  close(answers_in);
  to_rig_ = commands_in;
  from_rig_ = answers_out;
  if (answer() != "ready") throw std::runtime_error("hil_rig did not start");
  if (!holds_within(20 * core::kSecond, devices_are_there)) throw std::runtime_error("the kernel does not see the rig");
}

EmulatedRig::~EmulatedRig() {
  close(to_rig_);  // ends it
  close(from_rig_);
  waitpid(process_, nullptr, 0);
}

std::string EmulatedRig::answer() {
  std::size_t end = 0;
  while ((end = received_.find('\n')) == std::string::npos) {
    std::array<char, 4096> text{};
    const ssize_t count = read(from_rig_, text.data(), text.size());
    if (count <= 0) throw std::runtime_error("hil_rig has ended");
    received_.append(text.data(), static_cast<std::size_t>(count));
  }
  const std::string line = received_.substr(0, end);
  received_.erase(0, end + 1);
  return line;
}

std::string EmulatedRig::command(const std::string& line) {
  const std::string text = line + "\n";
  if (write(to_rig_, text.data(), text.size()) < 0) throw std::runtime_error("hil_rig has ended");
  const std::string result = answer();
  if (result.starts_with("error: ")) throw std::runtime_error(line + ": " + result);
  return result;
}

nlohmann::json EmulatedRig::state() {
  return nlohmann::json::parse(command("state"));
}

std::vector<nlohmann::json> EmulatedRig::events() const {
  std::vector<nlohmann::json> events;
  std::ifstream file(log_);
  for (std::string line; std::getline(file, line);) {
    events.push_back(nlohmann::json::parse(line));
    if (events.back()["event"] == "begin") events.clear();
  }
  return events;
}

std::optional<core::Nanoseconds> EmulatedRig::dark_from(core::Nanoseconds time) const {
  bool dark = true;
  for (const nlohmann::json& event : events()) {
    if (event["event"] != "lights") continue;
    if (event["t"] > time && dark) return time;
    dark = event["lit"].empty();
    if (event["t"] >= time && dark) return event["t"].get<core::Nanoseconds>();
  }
  return dark ? std::optional(time) : std::nullopt;
}

}  // namespace lightstage::hil
