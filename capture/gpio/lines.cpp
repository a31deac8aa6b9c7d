#include "capture/gpio/lines.h"

namespace lightstage::capture {

std::string describe(const GpioRequest& request) {
  std::string text = "GPIO " + request.chip + (request.lines.size() == 1 ? " line" : " lines");
  for (const std::string& line : request.lines) text += " " + line;
  return text;
}

}  // namespace lightstage::capture
