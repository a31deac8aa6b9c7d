#include "hil/rig/fault_script.h"

#include <set>
#include <sstream>
#include <stdexcept>

namespace lightstage::hil {

std::vector<std::string> words(const std::string& line) {
  std::istringstream stream(line);
  std::vector<std::string> list;
  for (std::string word; stream >> word;) list.push_back(word);
  return list;
}

int camera_number(const std::string& word) {
  return word.size() == 4 && word.starts_with("cam") && word[3] >= '0' && word[3] <= '9' ? word[3] - '0' : -1;
}

void FaultScript::add(const std::string& line) {
  static const std::set<std::string> kFrameActions{"drop", "short", "error", "duplicate", "late"};
  Words all = words(line);
  if (all.empty()) throw std::runtime_error("an empty line");
  if (all[0] != "at") return act(all);
  if (all.size() < 4) throw std::runtime_error("'" + line + "' says no event, number and action");
  const std::string event = all[1];
  const int number = std::stoi(all[2]);
  const Words action(all.begin() + 3, all.end());
  if (!kFrameActions.contains(action[0])) {
    waiting_[{event, number}].push_back(action);
    return;
  }
  const int camera = action.size() > 1 ? camera_number(action[1]) : -1;
  if (event != "exposure" || camera < 0) throw std::runtime_error("'" + line + "' names no exposure of a camera");
  FrameFault& fault = frame_faults_[{camera, number}];
  if (action[0] == "drop") fault.drop = true;
  if (action[0] == "short") fault.truncate = true;
  if (action[0] == "error") fault.flag_error = true;
  if (action[0] == "duplicate") fault.duplicate = true;
  if (action[0] == "late") fault.delay = std::stoi(action.at(2)) * kMillisecond;
}

void FaultScript::clear() {
  counts_.clear();
  waiting_.clear();
  frame_faults_.clear();
}

std::size_t FaultScript::size() const {
  std::size_t size = frame_faults_.size();
  for (const auto& [when, actions] : waiting_) size += actions.size();
  return size;
}

void FaultScript::happened(const std::string& event) {
  const auto found = waiting_.find({event, ++counts_[event]});
  if (found == waiting_.end()) return;
  const std::vector<Words> actions = std::move(found->second);
  waiting_.erase(found);
  for (const Words& action : actions) act(action);
}

FrameFault FaultScript::exposure(int camera, int number) {
  if (camera == 0) happened("exposure");
  const auto found = frame_faults_.find({camera, number});
  if (found == frame_faults_.end()) return {};
  const FrameFault fault = found->second;
  frame_faults_.erase(found);
  return fault;
}

}  // namespace lightstage::hil
