#include "cli/calibrate_cameras.h"

#include <algorithm>
#include <cmath>

#include <nlohmann/json.hpp>

#include "cli/format.h"
#include "cli/jobs/board_file.h"
#include "cli/jobs/calibrate_cameras.h"
#include "cli/jobs/stage_cameras.h"
#include "cli/options.h"
#include "core/direction.h"
#include "core/error.h"
#include "core/file.h"
#include "core/image_file.h"
#include "core/text.h"

namespace lightstage::cli {

namespace {

struct Options {
  std::vector<std::string> scans;
  std::filesystem::path pictures, board, stage, out;
  calib::DistortionTerms distortion = calib::DistortionTerms::kK1K2P1P2;
  std::string name;
};

nlohmann::ordered_json camera_object(const capture::StageCamera& entry, const calib::CalibratedCamera& camera) {
  const calib::CameraErrors& s = camera.sigma;
  nlohmann::ordered_json object = camera_json(entry);
  object["sigma"] = {{"focal_length_px", {s.fx, s.fy}},
                     {"principal_point_px", {s.cx, s.cy}},
                     {"radial_distortion", {s.k1, s.k2, s.k3}},
                     {"tangential_distortion", {s.p1, s.p2}},
                     {"position_m", {s.position.x, s.position.y, s.position.z}},
                     {"rotation_deg",
                      {core::degrees_from_radians(s.rotation.x), core::degrees_from_radians(s.rotation.y),
                       core::degrees_from_radians(s.rotation.z)}}};
  object["sigma_px"] = camera.sigma_px;
  object["views"] = camera.views;
  object["corners"] = camera.corners;
  object["reach"] = camera.reach;
  object["tilt_deg"] = camera.tilt_degrees;
  object["warnings"] = camera.warnings;
  return object;
}

std::string camera_text(const calib::CalibratedCamera& camera, bool first) {
  const core::CameraModel& m = camera.model;
  const auto with = [](double value, double sigma, int digits) {
    return fixed(value, digits) + " +- " + fixed(sigma, digits + 1);
  };
  std::string text = camera.camera.name + ": " + core::counted(camera.views, "view") + ", " +
                     std::to_string(camera.corners) + " corners to " + fixed(camera.sigma_px, 3) +
                     " px; focal length " + with(m.fx, camera.sigma.fx, 1) + ", " + with(m.fy, camera.sigma.fy, 1) +
                     " px; principal point " + with(m.cx, camera.sigma.cx, 1) + ", " + with(m.cy, camera.sigma.cy, 1) +
                     " px; k1 " + with(m.k1, camera.sigma.k1, 3);
  if (!first) {
    text += "; place certain to " + fixed(1000 * norm(camera.sigma.position), 2) + " mm and " +
            fixed(core::degrees_from_radians(norm(camera.sigma.rotation)), 3) + " degrees against the first camera";
  }
  text += "\n";
  for (const std::string& warning : camera.warnings) text += "  " + warning + "\n";
  return text;
}

void run_cameras(const Options& options, const Context& context) {
  const bool from_store = !options.scans.empty();
  if (from_store == !options.pictures.empty()) {
    throw core::UsageError(
        "calibrate cameras: give either chessboard passes (SCAN) or a folder of pictures (--pictures)");
  }
  if (from_store && !options.stage.empty()) {
    throw core::UsageError("--stage: passes know their stage; it is for loose pictures");
  }
  if (!from_store && !options.name.empty()) throw core::UsageError("--name: only calibrations from passes are stored");
  const calib::Board board = read_board(options.board);
  std::optional<capture::Stage> stage;
  std::optional<db::Store> store;
  BoardPictures pictures;
  if (from_store) {
    store.emplace(context.open_store());
    store->require_writable();
    pictures = board_passes(*store, options.scans, board);
    stage = capture_provenance(store->scan(options.scans.front())).stage;
  } else {
    if (!options.stage.empty()) stage = capture::read_stage(options.stage);
    pictures = loose_board_pictures(options.pictures, board, stage);
  }
  const CamerasReport report = calibrate_cameras(pictures, options.distortion);

  const calib::CameraCalibration& found = report.calibration;
  const std::vector<capture::StageCamera> entries = stage_entries(pictures, report);
  std::string text;
  nlohmann::ordered_json cameras = nlohmann::ordered_json::array(), views = cameras;
  for (std::size_t c = 0; c < entries.size(); ++c) {
    text += camera_text(found.cameras[c], c == 0);
    cameras.push_back(camera_object(entries[c], found.cameras[c]));
  }
  for (std::size_t v = 0; v < found.views.size(); ++v) {
    const calib::CalibratedView& view = found.views[v];
    const std::string& label = pictures.pictures[v].label;
    views.push_back({{"picture", label},
                     {"camera", pictures.cameras[view.camera].name},
                     {"used", view.used},
                     {"corners", view.corners.size()},
                     {"rms_px", view.used ? nlohmann::ordered_json(view.rms_px) : nlohmann::ordered_json(nullptr)},
                     {"reason", view.reason}});
    if (!view.used) text += "  " + label + " left out: " + view.reason + "\n";
  }
  text += "bundle adjustment leaves " + fixed(found.rms_px, 3) + " px of the corners\n";
  nlohmann::ordered_json object{{"cameras", cameras},
                                {"views", views},
                                {"rms_px", found.rms_px},
                                {"distortion", to_string(options.distortion)},
                                {"frame", report.placement ? "drawn rig" : "first camera"}};
  if (report.placement) {
    const calib::RigPlacement& placed = *report.placement;
    text += "in the stage frame: the rig as drawn, off by " + fixed(1000 * placed.position_rms_m, 1) + " mm and " +
            fixed(placed.rotation_rms_degrees, 2) + " degrees a camera (root mean square)\n";
    constexpr double kNotable = 0.03;
    if (std::abs(placed.drawn_over_found - 1) > kNotable) {
      text += "  cameras are drawn " + fixed(placed.drawn_over_found, 3) +
              " times as far apart as they were found: is the board's square_mm right?\n";
    }
    object["placement"] = {{"position_rms_m", placed.position_rms_m},
                           {"rotation_rms_deg", placed.rotation_rms_degrees},
                           {"drawn_over_found", placed.drawn_over_found}};
  } else {
    text += "in the frame of the first camera; --stage FILE places the rig where it is drawn\n";
  }
  if (store) {
    object["calibration_id"] = store_cameras(*store, pictures, report, options.distortion, options.name);
    text += "stored: passes on this stage are measured with these cameras from now on\n";
  }
  if (!options.out.empty()) {
    write_camera_files(options.out, pictures, report, stage);
    object["folder"] = options.out.string();
    text += "wrote cameras.toml, cameras.json, cameras.png" + std::string(stage ? " and stage.toml" : "") + " to " +
            options.out.string() + "\n";
  }
  object["seconds"] = report.seconds;
  context.result(text, object);
}

struct BoardOptions {
  calib::Board board;
  std::string kind = "charuco";
  double square_mm = 25, marker_mm = 0;
  std::optional<std::string> dictionary;
  int dpi = 600;
  std::filesystem::path out;
};

void run_board(BoardOptions options, const Context& context) {
  calib::Board& board = options.board;
  if (options.kind == "chessboard" && (options.marker_mm > 0 || options.dictionary)) {
    throw core::UsageError("--marker-mm and --dictionary: a chessboard has no markers; give --kind charuco");
  }
  if (options.dictionary) board.dictionary = *options.dictionary;
  board.kind = options.kind == "charuco" ? calib::BoardKind::kCharuco : calib::BoardKind::kChessboard;
  // Whole pixels; the description says what these are when printed.
  const auto pixels = [&](double mm) { return int(std::lround(mm / 25.4 * options.dpi)); };
  const auto printed_mm = [&](int px) { return px * 25.4 / options.dpi; };
  constexpr double kUsualMarker = 0.6;
  const int square_px = pixels(options.square_mm);
  const int marker_px = pixels(options.marker_mm > 0 ? options.marker_mm : kUsualMarker * options.square_mm);
  board.square_m = printed_mm(square_px) / 1000;
  board.marker_m = printed_mm(marker_px) / 1000;
  calib::require_usable(board);
  constexpr double kMostPixels = 4e8;
  if (double(square_px) * square_px * (board.columns + 2) * (board.rows + 2) > kMostPixels) {
    throw core::UsageError("--dpi: the picture would have more than 400 million pixels");
  }
  const std::string extension = options.out.extension().string();
  if (extension != ".png") throw core::UsageError("--out: boards are written as .png");
  std::filesystem::path toml = options.out;
  toml.replace_extension(".toml");
  // Squares that were measured, or a file of another use, are not overwritten.
  if (std::filesystem::exists(toml) && core::read_text_file(toml) != to_toml(board)) {
    throw core::UsageError("--out: the description would go to '" + toml.string() +
                           "', which is there already and says something else; choose another name");
  }
  core::write_image(options.out, calib::board_picture(board, square_px, square_px / 2));
  core::write_file_atomically(toml, to_toml(board));
  context.result(
      "wrote " + options.out.string() + " and " + toml.string() + "\nprint it at " + std::to_string(options.dpi) +
          " dots per inch (squares of " + fixed(printed_mm(square_px), 3) +
          " mm), glue it onto something flat, measure its squares, and correct square_mm in the .toml file\n",
      {{"picture", options.out.string()},
       {"board", toml.string()},
       {"dpi", options.dpi},
       {"printed_square_mm", printed_mm(square_px)}});
}

}  // namespace

void add_calibrate_cameras(CLI::App& calibrate, Context& context) {
  CLI::App* command = calibrate.add_subcommand(
      "cameras", "Lenses and poses of cameras, from pictures of a chessboard or ChArUco board");
  command->footer(
      "Examples:\n"
      "  lightstage calibrate board --out board.png            (to print; writes board.toml too)\n"
      "  lightstage calibrate cameras --pictures folder --board board.toml --out cameras\n"
      "  lightstage calibrate cameras boards --board board.toml   (a pass of capture --chessboard)");
  auto options = std::make_shared<Options>();
  command->add_option("SCAN", options->scans, "Chessboard passes, one or more");
  command->add_option(
      "--pictures", options->pictures,
      "Loose pictures instead: a folder for each camera in this one, or the pictures of a single camera; "
      "pictures of one name were taken at one instant");
  command->add_option("--board", options->board, "TOML file: kind, columns, rows, square_mm, marker_mm, dictionary")
      ->required();
  command->add_option(
      "--stage", options->stage,
      "Stage file, for loose pictures: folders are named as its cameras, and the rig is placed where it is "
      "drawn");
  std::map<std::string, calib::DistortionTerms> terms;
  for (const auto term : {calib::DistortionTerms::kNone, calib::DistortionTerms::kK1, calib::DistortionTerms::kK1K2,
                          calib::DistortionTerms::kK1K2P1P2, calib::DistortionTerms::kAll}) {
    terms.emplace(to_string(term), term);
  }
  command
      ->add_option("--distortion", options->distortion,
                   "Terms to estimate: none, k1, k1,k2 or k1,k2,p1,p2 [default] or k1,k2,k3,p1,p2")
      ->transform(one_of(terms));
  command->add_option("--name", options->name, "Name of the calibration in the store");
  command->add_option("--out", options->out, "Folder for cameras.toml, cameras.json, cameras.png and stage.toml");
  command->callback([options, &context] { run_cameras(*options, context); });
}

void add_calibrate_board(CLI::App& calibrate, Context& context) {
  CLI::App* command = calibrate.add_subcommand("board", "A calibration board to print, and its description");
  command->footer("Example:\n  lightstage calibrate board --columns 10 --rows 7 --square-mm 25 --out board.png");
  auto options = std::make_shared<BoardOptions>();
  options->board.columns = 10;
  command->add_option("--kind", options->kind, "charuco or chessboard")
      ->capture_default_str()
      ->check(CLI::IsMember({"charuco", "chessboard"}));
  command->add_option("--columns", options->board.columns, "Squares across")
      ->capture_default_str()
      ->check(CLI::Range(3, 100));
  command->add_option("--rows", options->board.rows, "Squares down")->capture_default_str()->check(CLI::Range(3, 100));
  command->add_option("--square-mm", options->square_mm, "Side of a square, millimetres")
      ->capture_default_str()
      ->check(number_between(1.0, 1000.0));
  command->add_option("--marker-mm", options->marker_mm, "Side of a marker, millimetres [0.6 squares]")
      ->check(number_between(0.5, 1000.0));
  command->add_option("--dictionary", options->dictionary,
                      "Of the markers: 4x4_50 to 7x7_1000, aruco_original [4x4_250]");
  command->add_option("--dpi", options->dpi, "Dots per inch of the print")
      ->capture_default_str()
      ->check(CLI::Range(50, 2400));
  command->add_option("--out", options->out, "Picture to write (.png); the description goes beside it (.toml)")
      ->required();
  command->callback([options, &context] { run_board(*options, context); });
}

}  // namespace lightstage::cli
