// The message of an error that must be thrown.
#pragma once

#include <catch2/catch.hpp>
#include <string>

namespace lightstage::test {

template <class ExpectedError, class Function>
std::string failure_of(Function&& function) {
  try {
    function();
  } catch (const ExpectedError& error) {
    return error.what();
  }
  FAIL("nothing was thrown");
  return "";
}

// Whether a message holds all the given pieces, on one line.
template <class... Pieces>
bool says(const std::string& message, const Pieces&... pieces) {
  INFO(message);
  const bool all = ((message.find(pieces) != std::string::npos) && ...) && message.find('\n') == std::string::npos;
  CHECKED_ELSE(all) {
    WARN("the message was: " << message);
  }
  return all;
}

}  // namespace lightstage::test
