// A driver's parameter that has this value until the end of the scope.
#pragma once

#include <filesystem>
#include <fstream>
#include <stdexcept>
#include <string>

namespace lightstage::hil {

class ModuleParameter {
 public:
  ModuleParameter(const std::string& module, const std::string& parameter, const std::string& value)
      : file_("/sys/module/" + module + "/parameters/" + parameter) {
    std::ifstream(file_) >> before_;
    write(value);
  }
  ~ModuleParameter() { std::ofstream(file_) << before_; }
  ModuleParameter(const ModuleParameter&) = delete;
  ModuleParameter& operator=(const ModuleParameter&) = delete;

 private:
  void write(const std::string& value) const {
    std::ofstream stream(file_);
    stream << value << std::flush;
    if (!stream) throw std::runtime_error("cannot write " + file_.string());
  }

  std::filesystem::path file_;
  std::string before_;
};

}  // namespace lightstage::hil
