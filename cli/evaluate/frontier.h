// Time and memory against error, for every method and each of its settings that trade one for the other.
#pragma once

#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "cli/evaluate/protocol.h"

namespace lightstage::cli {

// A method at one setting.
struct FrontierPoint {
  std::string setting;  // "default", or what is different: "--neighbours 4"
  model::MethodScore score;
  // Keys of the measures (cli/evaluate/scores.h) by which no other point is at least as good and cheaper, or as cheap and better.
  std::vector<std::string> time_fronts, memory_fronts;
};

// Judges each choice as it is and with every quality setting of its method, one after the other. Settings that this machine cannot run are
// noted and left out.
std::vector<FrontierPoint> measure_frontier(const std::vector<MethodChoice>& choices, const core::OlatScan& scan,
                                            const Protocol& protocol, const std::string& own_metric);

// {scan, protocol, notes, points: [{method, setting, images, MEASURES, seconds_per_image, peak_rss_bytes, time_fronts, memory_fronts}]}
nlohmann::ordered_json frontier_json(const std::string& scan, const Protocol& protocol,
                                     const std::vector<FrontierPoint>& points, const std::string& own_metric);

// The table for people; points on a front carry the measures by which they are.
std::string frontier_text(const std::vector<FrontierPoint>& points);

// Writes frontier.json, .csv and .svg into the folder, which must exist.
void write_frontier(const std::filesystem::path& folder, const nlohmann::ordered_json& json,
                    const std::vector<FrontierPoint>& points, const std::string& own_metric);

}  // namespace lightstage::cli
