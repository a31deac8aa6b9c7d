// The texts in a checkpoint's header.
#pragma once

#include <filesystem>
#include <map>
#include <string>

#include "model/checkpoint.h"
#include "model/net/safetensors.h"

namespace lightstage::model {

// JSON of a configuration, and back. Reading throws BadInput saying what is missing or out of range.
std::string config_to_json(const NetworkConfig& config);
NetworkConfig config_from_json(const std::string& json);

// "format", "version", "config" and "provenance" of a checkpoint.
std::map<std::string, std::string> checkpoint_metadata(const NetworkConfig& config, const std::string& provenance);

// Checks a header as read_checkpoint_info does; `path` is for messages.
CheckpointInfo checkpoint_info(const std::filesystem::path& path, const SafetensorsHeader& header);

}  // namespace lightstage::model
