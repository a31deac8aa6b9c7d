// Reading the JSON that the store keeps for this program.
#pragma once

#include <string>

#include <nlohmann/json.hpp>

#include "core/error.h"

namespace lightstage::cli {

// Calls `work`, in which a value that is missing or of another type than this program writes becomes StoreError naming `what`.
template <class Work>
decltype(auto) reading_json(const std::string& what, Work&& work) {
  try {
    return work();
  } catch (const nlohmann::json::exception&) {
    throw core::StoreError(what + " is damaged: it is not as this program writes it");
  }
}

}  // namespace lightstage::cli
