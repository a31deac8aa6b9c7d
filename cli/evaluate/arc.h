// How smoothly methods change their picture while the light moves along an arc.
#pragma once

#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "cli/evaluate/protocol.h"
#include "model/smoothness.h"

namespace lightstage::cli {

// Part of a great circle.
struct Arc {
  core::Direction from, to;
  int steps = 60;

  double degrees() const;
  // steps + 1 of them, evenly, both ends included.
  std::vector<core::Direction> directions() const;
};

// From the light nearest to longitude 30, latitude 30 degrees over its nearest neighbour as far again beyond. UsageError for a scan of one place.
Arc arc_between_lights(std::span<const core::Direction> lights);

// What one method, or the simulator, shows along the arc.
struct ArcScore {
  std::string name;
  double largest_difference = 0, mean_difference = 0;  // second differences, frame to frame
  std::optional<double> rmse;                          // against the truth, where there is one
  core::Image strip;                                   // the edge's row of the picture over the mask, a row a frame
  std::vector<std::optional<double>> edge;             // where the shadow's edge is, pixels
  std::optional<model::LineFit> fit;
};

struct ArcResult {
  Arc arc;
  int row = 0;                    // of the strips
  std::optional<ArcScore> truth;  // of simulated scans; without it there is no edge
  std::vector<ArcScore> methods;
};

// `truth`: the linear pictures for the arc's directions, or nothing for a scan that has none. Frames are judged at the scan's exposure, display-encoded or
// linear. The edge and its row are found in the truth; a method's is where its picture crosses the truth's level within 12 pixels of the truth's edge.
ArcResult judge_along_arc(const core::OlatScan& scan, const std::vector<MethodChoice>& choices, const Arc& arc,
                          std::vector<core::Image> truth, bool linear_values);

// {scan, protocol, from, to, degrees, steps, row, truth, methods: [...]} (docs/cli.md); each of them has its own edge, or null.
nlohmann::ordered_json arc_json(const std::string& scan, const ArcResult& result);

std::string arc_text(const ArcResult& result);

// Writes arc.json, strip_NAME.png of the truth and every method, edge.svg where there is an edge, and index.html into the folder, which must exist.
void write_arc(const std::filesystem::path& folder, const std::string& scan, const ArcResult& result);

}  // namespace lightstage::cli
