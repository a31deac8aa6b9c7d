// Work in a process of its own: for libraries that a damaged or hostile file can make crash, loop or ask for all memory.
#pragma once

#include <chrono>
#include <cstddef>
#include <filesystem>
#include <functional>
#include <string>

namespace lightstage::core {

struct ChildLimits {
  std::chrono::seconds processor_time{60};
  std::size_t memory_bytes = std::size_t(1) << 30;  // beyond what this process has; not kept to under a sanitizer
};

// Calls `work` in a child of this process and returns the bytes that it returned; nothing else of what it did is seen here. What it or a library prints is
// lost. `work` may use no threads: the child has the one that called. Throws what `work` threw of core::Error as BadInput, BadInput naming the file when
// the child crashed or went beyond its limits, and Interrupted. Costs some milliseconds.
std::string in_child(const std::filesystem::path& file, const ChildLimits& limits,
                     const std::function<std::string()>& work);

}  // namespace lightstage::core
