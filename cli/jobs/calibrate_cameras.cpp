#include "cli/jobs/calibrate_cameras.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>

#include <nlohmann/json.hpp>
#include <opencv2/imgproc.hpp>

#include "cli/format.h"
#include "cli/jobs/board_file.h"
#include "cli/jobs/stage_cameras.h"
#include "cli/options.h"
#include "cli/report/contact_sheet.h"
#include "core/direction.h"
#include "core/display.h"
#include "core/error.h"
#include "core/file.h"
#include "core/image_file.h"
#include "core/interrupt.h"
#include "core/parallel.h"
#include "core/progress.h"
#include "core/stopwatch.h"
#include "core/text.h"

namespace lightstage::cli {

namespace {

constexpr std::array kTermNames{"none", "k1", "k1,k2", "k1,k2,p1,p2", "k1,k2,k3,p1,p2"};

calib::BoardSeen look(const BoardPictures& pictures, const BoardPicture& picture) {
  core::Image image;
  try {
    image = picture.load();
  } catch (const core::BadInput& error) {
    return {{}, error.what()};
  }
  const calib::RigCamera& camera = pictures.cameras[picture.camera];
  if (image.width() != camera.width || image.height() != camera.height) {
    return {{},
            "it is " + std::to_string(image.width()) + " x " + std::to_string(image.height()) +
                " pixels, its camera's others are " + std::to_string(camera.width) + " x " +
                std::to_string(camera.height)};
  }
  return calib::find_board(image, pictures.board);
}

std::string most_frequent(const std::vector<std::string>& texts) {
  std::map<std::string, int> count;
  for (const std::string& text : texts) ++count[text];
  const auto most =
      std::max_element(count.begin(), count.end(), [](const auto& a, const auto& b) { return a.second < b.second; });
  return most == count.end() ? "" : most->first + " (" + std::to_string(most->second) + " pictures)";
}

// One camera's picture with most corners, all views' corners on it, and from each the way to where the calibration puts it, enlarged.
SheetCell camera_cell(const BoardPictures& pictures, const CamerasReport& report, std::size_t camera) {
  constexpr int kCell = 720;
  constexpr double kUsualLength = 14;  // of the ways, pixels of the cell
  const calib::CalibratedCamera& found = report.calibration.cameras[camera];
  const auto& views = report.calibration.views;
  std::size_t best = views.size();
  for (std::size_t v = 0; v < views.size(); ++v) {
    if (views[v].camera == camera && views[v].used &&
        (best == views.size() || views[v].corners.size() > views[best].corners.size())) {
      best = v;
    }
  }
  const double scale = double(kCell) / std::max(found.camera.width, found.camera.height);
  core::Image shown(int(std::lround(found.camera.height * scale)), int(std::lround(found.camera.width * scale)), 3);
  cv::Mat canvas(shown.height(), shown.width(), CV_32FC3, shown.values().data());
  if (best < views.size()) {
    core::Image image = core::to_rgb(pictures.pictures[best].load());
    const double bright = std::max(1e-12, core::quantile(image.values(), 0.99));
    // Half as bright, so that what is drawn stands out.
    for (float& value : image.values())
      value = 0.5F * std::min(1.0F, core::display_encode(float(double(value) / bright)));
    const cv::Mat from(image.height(), image.width(), CV_32FC3, image.values().data());
    cv::resize(from, canvas, canvas.size(), 0, 0, scale < 1 ? cv::INTER_AREA : cv::INTER_LINEAR);
  }
  double square = 0;
  std::size_t count = 0;
  for (const auto& view : views) {
    if (view.camera != camera || !view.used) continue;
    square += view.rms_px * view.rms_px * double(view.corners.size());
    count += view.corners.size();
  }
  const double rms = count > 0 ? std::sqrt(square / double(count)) : 0;
  const double enlarged = std::max(1.0, std::round(kUsualLength / std::max(1e-6, rms * scale)));
  const cv::Scalar good(0.2, 1, 0.3), way(1, 0.7, 0.1);
  for (std::size_t v = 0; v < views.size(); ++v) {
    if (views[v].camera != camera || !views[v].used) continue;
    for (std::size_t i = 0; i < views[v].corners.size(); ++i) {
      const core::Pixel seen = views[v].corners[i].position, predicted = views[v].predicted[i];
      const cv::Point2d at((seen.x + 0.5) * scale - 0.5, (seen.y + 0.5) * scale - 0.5);
      const cv::Point2d off = scale * enlarged * cv::Point2d(predicted.x - seen.x, predicted.y - seen.y);
      cv::line(canvas, at, at + off, way, 1, cv::LINE_AA);
      cv::circle(canvas, at, v == best ? 3 : 1, good, v == best ? 1 : cv::FILLED, cv::LINE_AA);
    }
  }
  return {std::move(shown), found.camera.name + ": " + std::to_string(count) + " corners of " +
                                std::to_string(found.views) + " views, " + fixed(rms, 3) + " px rms, drawn x " +
                                fixed(enlarged, 0)};
}

nlohmann::ordered_json sigma_json(const calib::CalibratedCamera& camera) {
  const calib::CameraErrors& s = camera.sigma;
  const auto degrees = [](double radians) { return core::degrees_from_radians(radians); };
  return {{"focal_length_px", {s.fx, s.fy}},
          {"principal_point_px", {s.cx, s.cy}},
          {"radial_distortion", {s.k1, s.k2, s.k3}},
          {"tangential_distortion", {s.p1, s.p2}},
          {"position_m", {s.position.x, s.position.y, s.position.z}},
          {"rotation_deg", {degrees(s.rotation.x), degrees(s.rotation.y), degrees(s.rotation.z)}},
          {"corner_px", camera.sigma_px}};
}

}  // namespace

std::string_view to_string(calib::DistortionTerms terms) {
  return kTermNames[std::size_t(terms)];
}

CamerasReport calibrate_cameras(const BoardPictures& pictures, calib::DistortionTerms terms) {
  const core::Stopwatch watch;
  std::vector<calib::BoardSeen> seen(pictures.pictures.size());
  core::Progress progress("corners", pictures.pictures.size());
  core::parallel_for(pictures.pictures.size(), 1, [&](std::size_t first, std::size_t last) {
    for (std::size_t i = first; i < last; ++i) {
      core::throw_if_interrupted();
      seen[i] = look(pictures, pictures.pictures[i]);
      progress.advance();
    }
  });
  calib::CameraCalibrationInput input{.board = pictures.board, .cameras = pictures.cameras, .distortion = terms};
  std::vector<std::string> reasons;
  for (std::size_t i = 0; i < seen.size(); ++i) {
    input.views.push_back({pictures.pictures[i].camera, pictures.pictures[i].instant, seen[i].corners});
    if (seen[i].corners.empty()) reasons.push_back(seen[i].reason);
  }
  CamerasReport report;
  try {
    report.calibration = calib::calibrate_cameras(input);
  } catch (const core::BadInput& error) {
    const std::string why = most_frequent(reasons);
    throw core::BadInput(error.what() + (why.empty() ? std::string() : ". Without corners: " + why));
  }
  for (std::size_t i = 0; i < seen.size(); ++i) {
    if (seen[i].corners.empty()) report.calibration.views[i].reason = seen[i].reason;
  }
  if (!pictures.drawn.empty()) {
    std::vector<core::CameraModel> drawn;
    for (const capture::StageCamera& camera : pictures.drawn) drawn.push_back(camera.model);
    report.placement = calib::place_rig(report.calibration, drawn);
  }
  report.seconds = watch.seconds();
  return report;
}

std::vector<capture::StageCamera> stage_entries(const BoardPictures& pictures, const CamerasReport& report) {
  std::vector<capture::StageCamera> entries;
  for (std::size_t c = 0; c < report.calibration.cameras.size(); ++c) {
    const calib::CalibratedCamera& camera = report.calibration.cameras[c];
    entries.push_back({camera.camera.name, camera.model, pictures.drawn.empty() ? 1 : pictures.drawn[c].responsivity});
  }
  return entries;
}

db::Id store_cameras(db::Store& store, const BoardPictures& pictures, const CamerasReport& report,
                     calib::DistortionTerms terms, const std::string& name) {
  nlohmann::ordered_json cameras = nlohmann::ordered_json::array();
  const std::vector<capture::StageCamera> entries = stage_entries(pictures, report);
  for (std::size_t c = 0; c < entries.size(); ++c) {
    cameras.push_back(camera_json(entries[c]));
    cameras.back()["sigma"] = sigma_json(report.calibration.cameras[c]);
  }
  db::NewProduct product;
  product.kind = "camera_calibration";
  product.name = name;
  product.stage_key = pictures.stage_key;
  product.input_scans = pictures.scans;
  product.parameters = json_text({{"cameras", cameras},
                                  {"board_toml", to_toml(pictures.board)},
                                  {"distortion", to_string(terms)},
                                  {"rms_px", report.calibration.rms_px},
                                  {"frame", report.placement ? "drawn rig" : "first camera"}});
  return store.add_product(product);
}

void write_camera_files(const std::filesystem::path& folder, const BoardPictures& pictures, const CamerasReport& report,
                        const std::optional<capture::Stage>& stage) {
  core::make_folder(folder);
  const std::vector<capture::StageCamera> entries = stage_entries(pictures, report);
  std::string toml = report.placement
                         ? "# Cameras in the stage frame, the rig placed where it is drawn.\n"
                         : "# Cameras in the frame of the first one: x right, y down, z forward of it, metres.\n";
  nlohmann::ordered_json cameras = nlohmann::ordered_json::array();
  for (std::size_t c = 0; c < entries.size(); ++c) {
    toml += capture::to_toml(entries[c]);
    cameras.push_back(camera_json(entries[c]));
    cameras.back()["sigma"] = sigma_json(report.calibration.cameras[c]);
  }
  core::write_file_atomically(folder / "cameras.toml", toml);
  core::write_file_atomically(
      folder / "cameras.json",
      json_text({{"frame", report.placement ? "drawn rig" : "first camera"}, {"cameras", cameras}}) + "\n");
  if (stage) {
    capture::Stage calibrated = *stage;
    for (capture::StageCamera& camera : calibrated.cameras) {
      for (const capture::StageCamera& entry : entries) {
        if (entry.name == camera.name) camera = entry;
      }
    }
    core::write_file_atomically(folder / "stage.toml", capture::to_toml(calibrated));
  }
  std::vector<std::vector<SheetCell>> rows(1);
  for (std::size_t c = 0; c < entries.size(); ++c) {
    constexpr std::size_t kColumns = 2;
    if (rows.back().size() == kColumns) rows.emplace_back();
    rows.back().push_back(camera_cell(pictures, report, c));
  }
  core::write_image(folder / "cameras.png", contact_sheet(rows, 720), {.encoding = core::Encoding::kLinear});
}

}  // namespace lightstage::cli
