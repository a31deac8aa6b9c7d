#include "cli/report/light_files.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include <nlohmann/json.hpp>
#include <opencv2/imgproc.hpp>

#include "cli/options.h"
#include "cli/report/contact_sheet.h"
#include "core/display.h"
#include "core/file.h"
#include "core/image_file.h"
#include "core/light_list.h"
#include "core/text.h"

namespace lightstage::cli {

namespace {

constexpr int kCell = 640;  // pixels
const cv::Scalar kGood(0.2, 1, 0.3), kBad(1, 0.25, 0.2), kFaint(0.45, 0.45, 0.45);

cv::Mat as_mat(core::Image& image) {
  return {image.height(), image.width(), CV_32FC3, image.values().data()};
}

// Display values of the brightest each pixel gets under any light.
core::Image brightest(const LightSources& sources, std::size_t view) {
  core::Image result(sources.views[view].model.height, sources.views[view].model.width, 3);
  for (std::size_t i = 0; i < sources.names.size(); ++i) {
    const core::Image taken = sources.picture(view, i);
    if (taken.empty()) continue;
    const core::Image picture = core::to_rgb(taken);
    for (std::size_t k = 0; k < picture.values().size(); ++k) {
      result.values()[k] = std::max(result.values()[k], picture.values()[k]);
    }
  }
  for (float& value : result.values()) value = std::min(1.0F, core::display_encode(value));
  return result;
}

SheetCell view_cell(const LightSources& sources, const LightsReport& report, std::size_t v) {
  const SeenBall& view = sources.views[v];
  core::Image image = brightest(sources, v);
  const double scale = double(kCell) / std::max(image.width(), image.height());
  core::Image shown(int(std::lround(image.height() * scale)), int(std::lround(image.width() * scale)), 3);
  cv::Mat canvas = as_mat(shown);
  cv::resize(as_mat(image), canvas, canvas.size(), 0, 0, scale < 1 ? cv::INTER_AREA : cv::INTER_LINEAR);
  const auto at = [&](core::Pixel p) {
    return cv::Point(int(std::lround((p.x + 0.5) * scale - 0.5)), int(std::lround((p.y + 0.5) * scale - 0.5)));
  };
  std::vector<cv::Point> outline;
  for (const core::Pixel& p : calib::outline_pixels(view.model, report.balls[v])) outline.push_back(at(p));
  if (!outline.empty()) cv::polylines(canvas, outline, true, kFaint, 1, cv::LINE_AA);
  int seen = 0;
  for (const PlacedLight& light : report.lights) {
    const calib::LightEstimate& estimate = light.per_view[v];
    if (!estimate.highlight) continue;
    ++seen;
    const cv::Point p = at(estimate.highlight->position);
    const cv::Scalar colour = estimate.placed && light.used ? kGood : kBad;
    cv::drawMarker(canvas, p, colour, cv::MARKER_CROSS, 9, 1, cv::LINE_AA);
    cv::putText(canvas, std::to_string(light.index), p + cv::Point(4, -4), cv::FONT_HERSHEY_PLAIN, 0.7, colour, 1,
                cv::LINE_AA);
  }
  return {std::move(shown), view.name() + ": " + std::to_string(seen) + " highlights"};
}

// Azimuthal equidistant about +z: 180 degrees at the cell's edge.
cv::Point2d on_map(core::Vec3 d) {
  const double angle = std::acos(std::clamp(d.z, -1.0, 1.0)) / std::numbers::pi;
  const double across = std::hypot(d.x, d.y);
  const double reach = 0.48 * kCell * angle / std::max(across, 1e-12);
  return {0.5 * kCell + d.x * reach, 0.5 * kCell - d.y * reach};
}

SheetCell sphere_cell(const LightsReport& report) {
  constexpr double kExaggeration = 10;
  core::Image image(kCell, kCell, 3);
  cv::Mat canvas = as_mat(image);
  for (const double share : {0.25, 0.5, 1.0}) {
    cv::circle(canvas, {kCell / 2, kCell / 2}, int(0.48 * kCell * share), kFaint, 1, cv::LINE_AA);
  }
  for (const PlacedLight& light : report.lights) {
    if (!light.used) continue;
    const cv::Point2d p = on_map(light.direction.vec());
    for (const calib::LightEstimate& estimate : light.per_view) {
      if (!estimate.placed) continue;
      const cv::Point2d end = p + kExaggeration * (on_map(estimate.direction.vec()) - p);
      cv::line(canvas, p, end, {1, 0.7, 0.1}, 1, cv::LINE_AA);
    }
    cv::circle(canvas, p, 2, kGood, cv::FILLED, cv::LINE_AA);
    cv::putText(canvas, std::to_string(light.index), cv::Point(p) + cv::Point(4, -4), cv::FONT_HERSHEY_PLAIN, 0.7,
                kGood, 1, cv::LINE_AA);
  }
  return {std::move(image), "lights about +z (rings: 45, 90, 180 degrees), differences x 10"};
}

nlohmann::ordered_json xyz(core::Vec3 v) {
  return {{"x", v.x}, {"y", v.y}, {"z", v.z}};
}

std::string dome(const LightSources& sources, const LightsReport& report) {
  nlohmann::ordered_json directions = nlohmann::ordered_json::array(), on_sphere = directions, positions = directions;
  for (const PlacedLight& light : report.lights) {
    if (!light.used) continue;
    directions.push_back(xyz(light.direction.vec()));
    if (light.position) positions.push_back(xyz(*light.position));
    if (sources.stage_radius_m) on_sphere.push_back(xyz(light.direction.vec() * *sources.stage_radius_m));
  }
  const nlohmann::ordered_json file{
      {"label", "Lightstage"},    {"notes", "lengths in metres"},
      {"imageWidth", 0},          {"domeDiameter", 2 * sources.stage_radius_m.value_or(0)},
      {"verticalOffset", 0},      {"lightConfiguration", positions.empty() ? "directional" : "lights3d"},
      {"directions", directions}, {"positionsSphere", on_sphere},
      {"positions3d", positions}, {"ledAdjust", nlohmann::ordered_json::array()}};
  return json_text(file) + "\n";
}

std::string csv_field(const std::string& text) {
  if (text.find_first_of(",\"\n") == std::string::npos) return text;
  std::string quoted = "\"";
  for (const char c : text) quoted += c == '"' ? "\"\"" : std::string(1, c);
  return quoted + "\"";
}

std::string csv(const LightSources& sources, const LightsReport& report) {
  std::string text = "index,picture,x,y,z,sigma_deg,position_x_m,position_y_m,position_z_m,sigma_m,used,reason\n";
  for (std::size_t i = 0; i < report.lights.size(); ++i) {
    const PlacedLight& light = report.lights[i];
    text += std::to_string(light.index) + "," + csv_field(sources.names[i]) + ",";
    const auto numbers = [&](bool known, std::initializer_list<double> values) {
      for (const double value : values) text += (known ? core::number_text(value) : "") + ",";
    };
    const core::Direction& d = light.direction;
    const core::Vec3 p = light.position.value_or(core::Vec3{});
    numbers(light.used, {d.x(), d.y(), d.z(), light.sigma_degrees});
    numbers(light.used && light.position.has_value(), {p.x, p.y, p.z, light.sigma_m});
    text += light.used ? "1," : "0,";
    text += csv_field(light.reason) + "\n";
  }
  return text;
}

}  // namespace

core::Image light_picture(const LightSources& sources, const LightsReport& report) {
  constexpr std::size_t kColumns = 3;
  std::vector<std::vector<SheetCell>> rows(1);
  const auto add = [&](SheetCell cell) {
    if (rows.back().size() == kColumns) rows.emplace_back();
    rows.back().push_back(std::move(cell));
  };
  for (std::size_t v = 0; v < sources.views.size(); ++v) add(view_cell(sources, report, v));
  add(sphere_cell(report));
  return contact_sheet(rows, kCell);
}

void write_light_files(const std::filesystem::path& folder, const LightSources& sources, const LightsReport& report) {
  core::make_folder(folder);
  std::vector<core::LpEntry> entries;
  for (std::size_t i = 0; i < report.lights.size(); ++i) {
    if (report.lights[i].used) entries.push_back({sources.names[i], report.lights[i].direction});
  }
  if (!entries.empty()) {
    core::write_lp(folder / "lights.lp", entries);
    core::write_file_atomically(folder / "lights.dome", dome(sources, report));
  }
  core::write_file_atomically(folder / "lights.csv", csv(sources, report));
  core::write_image(folder / "lights.png", light_picture(sources, report), {.encoding = core::Encoding::kLinear});
}

}  // namespace lightstage::cli
