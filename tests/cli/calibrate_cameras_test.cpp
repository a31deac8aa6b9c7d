// Cameras from pictures of a board, loose and in a store, and their way out to other programs.
#include <catch2/catch.hpp>

#include <cmath>
#include <fstream>
#include <sstream>

#include "calib/board.h"
#include "capture/stage.h"
#include "cli/program.h"
#include "core/direction.h"
#include "core/file.h"
#include "core/image_file.h"
#include "core/light_list.h"
#include "core/text.h"
#include "db/store.h"
#include "sim/held_board.h"
#include "sim/print.h"
#include "support/support.h"

using namespace lightstage;
namespace fs = std::filesystem;

namespace {

constexpr int kViews = 9;

// Two cameras of a drawn stage, which really stand elsewhere by a rigid motion and a little more.
struct Studio {
  test::TemporaryFolder folder;
  std::vector<core::CameraModel> truth;
  calib::Board board{.columns = 10, .rows = 7, .square_m = 0.036, .marker_m = 0.0216};

  Studio() {
    REQUIRE(
        run({"calibrate", "board", "--square-mm", "36", "--dpi", "254", "--out", path("board.png"), "--json"}).status ==
        0);
    for (int c = 0; c < 2; ++c) {
      core::CameraModel camera = core::look_at({c == 0 ? -0.2 : 0.2, 0.05, 0.95}, {0, 0, 0}, 480, 360, 34);
      camera.k1 = -0.2 + 0.05 * c;
      camera.p1 = 0.001;
      camera.cx += 4;
      truth.push_back(camera);
    }
    const sim::Print print{calib::board_picture(board, 40, 30), board.square_m / 40, 30};
    for (int c = 0; c < 2; ++c) {
      fs::create_directories(views() / name(c));
      for (int i = 0; i < kViews; ++i) {
        core::write_image(views() / name(c) / ("view" + std::to_string(i) + ".png"),
                          sim::photograph(truth[std::size_t(c)], print, pose(i)));
      }
    }
  }
  static std::string name(int camera) { return camera == 0 ? "left" : "right"; }
  fs::path views() const { return folder / "views"; }
  std::string path(const std::string& file) const { return (folder / file).string(); }
  core::RigidTransform pose(int i) const {
    const core::RigidTransform held = sim::held_board_pose(4, i, 0.1);
    const core::Mat3 axes{{core::Vec3{1, 0, 0}, core::Vec3{0, -1, 0}, core::Vec3{0, 0, -1}}};
    return {held.rotation * axes, held.apply({-5 * board.square_m, 3.5 * board.square_m, 0})};
  }
  test::Outcome run(const std::vector<std::string>& arguments) const {
    return test::run_program(folder / "store", arguments);
  }
  test::Outcome calibrate(std::vector<std::string> more) const {
    std::vector<std::string> arguments{"calibrate", "cameras",          "--pictures", views().string(),
                                       "--board",   path("board.toml"), "--json"};
    arguments.insert(arguments.end(), more.begin(), more.end());
    return run(arguments);
  }
};

core::Vec3 vec(const nlohmann::json& json) {
  return {json.at(0), json.at(1), json.at(2)};
}

}  // namespace

TEST_CASE("calibrate cameras: loose pictures of two cameras, files that others read, a damaged picture") {
  Studio studio;
  // One more picture, which is none; it is named and left out.
  std::ofstream(studio.views() / "left" / "view99.png") << "no picture";
  const test::Outcome outcome = studio.calibrate({"--out", studio.path("out")});
  INFO(outcome.err << outcome.out);
  REQUIRE(outcome.status == 0);
  const nlohmann::json result = outcome.json();
  REQUIRE(result.at("cameras").size() == 2);
  CHECK(result.at("frame") == "first camera");
  for (int c = 0; c < 2; ++c) {
    const nlohmann::json& camera = result.at("cameras").at(std::size_t(c));
    const core::CameraModel& truth = studio.truth[std::size_t(c)];
    CHECK(camera.at("name") == Studio::name(c));
    CHECK(camera.at("focal_length_px").at(0).get<double>() == Approx(truth.fx).epsilon(0.003));
    CHECK(camera.at("principal_point_px").at(0).get<double>() == Approx(truth.cx).margin(2));
    CHECK(camera.at("sigma").at("focal_length_px").at(0).get<double>() > 0);
  }
  const core::Vec3 place = vec(result.at("cameras").at(1).at("position_m"));
  const core::Vec3 expected = studio.truth[0].stage_from_camera.inverse().apply(studio.truth[1].centre());
  CHECK(norm(place - expected) < 0.002);
  bool named = false;
  for (const nlohmann::json& view : result.at("views")) {
    if (view.at("picture") != "left/view99.png") continue;
    named = true;
    CHECK(view.at("used") == false);
    CHECK(view.at("reason").get<std::string>().find("view99.png") != std::string::npos);
  }
  CHECK(named);
  for (const char* file : {"cameras.toml", "cameras.json", "cameras.png"})
    CHECK(fs::exists(studio.folder / "out" / file));
  CHECK(core::read_image_size(studio.folder / "out" / "cameras.png").width > 400);

  // Entries that `calibrate lights --circles` reads: it gets past the cameras to what is wrong with the ball.
  std::ofstream balls(studio.folder / "balls.toml");
  balls << core::read_text_file(studio.folder / "out" / "cameras.toml")
        << "\n[[ball]]\ncamera = \"left\"\nradius_m = 0.05\nfolder = \"left\"\n";
  balls.close();
  const test::Outcome lights =
      studio.run({"calibrate", "lights", "--balls", studio.views().string(), "--circles", studio.path("balls.toml")});
  CHECK(lights.err.find("nothing says where it is") != std::string::npos);
}

TEST_CASE("calibrate cameras: a stage file says where the rig stands, and gets its cameras") {
  Studio studio;
  capture::LayoutOptions layout;
  layout.lights = 12;
  layout.cameras = 2;
  capture::Stage stage = capture::make_stage("studio", layout);
  for (int c = 0; c < 2; ++c) {
    stage.cameras[std::size_t(c)].name = Studio::name(c);
    core::CameraModel& model = stage.cameras[std::size_t(c)].model;
    model = studio.truth[std::size_t(c)];
    model.k1 = model.p1 = 0;
    model.stage_from_camera.translation.y += c == 0 ? 0.004 : -0.004;  // drawn so much off
  }
  core::write_file_atomically(studio.folder / "stage.toml", capture::to_toml(stage));
  const test::Outcome outcome = studio.calibrate({"--stage", studio.path("stage.toml"), "--out", studio.path("out")});
  INFO(outcome.err << outcome.out);
  REQUIRE(outcome.status == 0);
  const nlohmann::json result = outcome.json();
  CHECK(result.at("frame") == "drawn rig");
  CHECK(result.at("placement").at("position_rms_m").get<double>() == Approx(0.004).margin(0.002));
  const capture::Stage found = capture::read_stage(studio.folder / "out" / "stage.toml");
  for (std::size_t c = 0; c < 2; ++c) {
    CHECK(norm(found.cameras[c].model.centre() - studio.truth[c].centre()) < 0.004);
    CHECK(found.cameras[c].model.k1 == Approx(studio.truth[c].k1).margin(0.03));
    CHECK(found.cameras[c].responsivity == stage.cameras[c].responsivity);
  }
}

TEST_CASE("calibrate cameras: what cannot be calibrated is refused in one line") {
  Studio studio;
  const auto refused = [&](const test::Outcome& outcome, int status, const std::string& what) {
    INFO(outcome.err);
    CHECK(outcome.status == status);
    CHECK(outcome.err.find(what) != std::string::npos);
    CHECK(std::count(outcome.err.begin(), outcome.err.end(), '\n') == 1);
  };
  const auto with_board = [&](const std::string& toml) {
    core::write_file_atomically(studio.folder / "other.toml", toml);
    return studio.run({"calibrate", "cameras", "--pictures", studio.views().string(), "--board",
                       studio.path("other.toml"), "--quiet"});
  };
  refused(with_board("kind = \"chessboard\"\ncolumns = 8\nrows = 8\nsquare_mm = 20\n"), 3, "turned by a quarter");
  refused(with_board("kind = \"charuco\"\ncolumns = 9\nrows = 8\n"), 3, "square_mm");
  refused(with_board("kind = \"paper\"\n"), 3, "kind");
  refused(with_board("kind = \"charuco\"\ncolumns = 10\nrows = 7\nsquare_mm = 36\nmarker_mm = 21.6\n"
                     "dictionary = \"6x6_250\"\n"),
          3, "no marker of dictionary");
  refused(studio.run({"calibrate", "cameras", "--board", studio.path("board.toml")}), 2, "--pictures");
  // Squares that were measured are not written over, and markers have a pixel for each bit.
  refused(studio.run({"calibrate", "board", "--square-mm", "30", "--out", studio.path("board.png")}), 2, "already");
  refused(studio.run({"calibrate", "board", "--square-mm", "1", "--dpi", "50", "--out", studio.path("tiny.png")}), 3,
          "dots per inch");
  refused(studio.run({"calibrate", "board", "--kind", "chessboard", "--marker-mm", "9", "--out", studio.path("c.png")}),
          2, "no markers");
  refused(
      studio.run({"calibrate", "cameras", "--pictures", studio.path("nowhere"), "--board", studio.path("board.toml")}),
      3, "no folder");
  fs::create_directory(studio.folder / "one");
  fs::copy_file(studio.views() / "left" / "view0.png", studio.folder / "one" / "view0.png");
  refused(studio.run({"calibrate", "cameras", "--pictures", studio.path("one"), "--board", studio.path("board.toml"),
                      "--quiet"}),
          3, "at least 3");
  fs::copy_file(studio.views() / "left" / "view0.png", studio.views() / "view0.png");
  refused(studio.calibrate({}), 3, "a folder of its own");
}

TEST_CASE("a chessboard pass calibrates the stage's cameras, which passes are then measured with and exports write") {
  const test::TemporaryFolder folder;
  const auto run = [&](std::vector<std::string> arguments) { return test::run_program(folder / "store", arguments); };
  capture::LayoutOptions layout;
  layout.lights = 12;
  layout.cameras = 2;
  capture::Stage stage = capture::make_stage("rig", layout);
  for (std::size_t c = 0; c < 2; ++c) {
    core::CameraModel& m = stage.cameras[c].model;
    m.k1 = -0.3;
    m.cx += 10;
  }
  const std::string stage_file = (folder / "stage.toml").string();
  core::write_file_atomically(stage_file, capture::to_toml(stage));
  REQUIRE(run({"init"}).status == 0);
  const test::Outcome captured = run({"capture", "--sim", "--chessboard", "--views", "10", "--stage", stage_file,
                                      "--size", "320", "--name", "boards", "--quiet"});
  INFO(captured.err);
  REQUIRE(captured.status == 0);
  // The simulator's board: 9 x 7 squares in 0.16 m.
  core::write_file_atomically(folder / "board.toml",
                              "kind = \"chessboard\"\ncolumns = 9\nrows = 7\nsquare_mm = 22.857142857\n");
  const test::Outcome outcome = run({"calibrate", "cameras", "boards", "--board", (folder / "board.toml").string(),
                                     "--distortion", "k1", "--json", "--quiet"});
  INFO(outcome.err << outcome.out);
  REQUIRE(outcome.status == 0);
  // A pass counts once.
  CHECK(run({"calibrate", "cameras", "boards", "boards", "--board", (folder / "board.toml").string()}).status == 2);
  const nlohmann::json result = outcome.json();
  CHECK(result.at("frame") == "drawn rig");
  const double scale = 320.0 / 512;
  for (std::size_t c = 0; c < 2; ++c) {
    const nlohmann::json& camera = result.at("cameras").at(c);
    const double sigma = camera.at("sigma").at("focal_length_px").at(0);
    CHECK(std::abs(camera.at("focal_length_px").at(0).get<double>() - stage.cameras[c].model.fx * scale) < 4 * sigma);
    CHECK(sigma < 0.01 * stage.cameras[c].model.fx);
    CHECK(norm(vec(camera.at("position_m")) - stage.cameras[c].model.centre()) < 0.02);
  }

  // The same points through the conventions of COLMAP and of transforms.json, written out here as their documentation has them.
  for (const std::string format : {"colmap", "transforms"}) {
    for (const bool undistort : {false, true}) {
      const std::string out = (folder / (format + (undistort ? "-flat" : ""))).string();
      std::vector<std::string> arguments{"export", "boards", "--format", format, "--out", out};
      if (undistort) arguments.push_back("--undistort");
      const test::Outcome exported = run(arguments);
      INFO(exported.err);
      REQUIRE(exported.status == 0);
      for (std::size_t c = 0; c < 2; ++c) {
        const nlohmann::json& camera = result.at("cameras").at(c);
        const std::string name = camera.at("name");
        REQUIRE(core::read_image_size(fs::path(out) / "images" / (name + ".png")).width == 320);
        // Our own camera.
        core::CameraModel ours;
        ours.width = ours.height = 320;
        ours.fx = camera.at("focal_length_px").at(0), ours.fy = camera.at("focal_length_px").at(1);
        ours.cx = camera.at("principal_point_px").at(0), ours.cy = camera.at("principal_point_px").at(1);
        if (!undistort) ours.k1 = camera.at("radial_distortion").at(0);
        ours.stage_from_camera = {
            core::Mat3{{vec(camera.at("right")), vec(camera.at("down")), vec(camera.at("forward"))}}.transposed(),
            vec(camera.at("position_m"))};
        for (const core::Vec3 point :
             {core::Vec3{0, 0, 0}, core::Vec3{0.08, -0.05, 0.03}, core::Vec3{-0.07, 0.09, -0.06}}) {
          double px = 0, py = 0;
          if (format == "colmap") {
            std::istringstream cameras(core::read_text_file(fs::path(out) / "sparse" / "cameras.txt"));
            std::istringstream images(core::read_text_file(fs::path(out) / "sparse" / "images.txt"));
            std::string line, model;
            double w = 0, h = 0, fx = 0, fy = 0, cx = 0, cy = 0, k1 = 0, k2 = 0, p1 = 0, p2 = 0;
            int id = 0, camera_id = 0;
            while (std::getline(cameras, line)) {
              std::istringstream row(line);
              if (line[0] != '#' && row >> id && id == int(c) + 1) {
                row >> model >> w >> h >> fx >> fy >> cx >> cy;
                if (model == "OPENCV") row >> k1 >> k2 >> p1 >> p2;
              }
            }
            CHECK(model == (undistort ? "PINHOLE" : "OPENCV"));
            double qw = 0, qx = 0, qy = 0, qz = 0, tx = 0, ty = 0, tz = 0;
            while (std::getline(images, line)) {
              if (line.find(name + ".png") != std::string::npos) {
                std::istringstream(line) >> id >> qw >> qx >> qy >> qz >> tx >> ty >> tz >> camera_id;
              }
            }
            CHECK(camera_id == int(c) + 1);
            // v + 2 q x (q x v + w v)
            const core::Vec3 q{qx, qy, qz};
            const core::Vec3 v = point + 2 * cross(q, cross(q, point) + qw * point) + core::Vec3{tx, ty, tz};
            const double x = v.x / v.z, y = v.y / v.z, r2 = x * x + y * y, radial = 1 + k1 * r2 + k2 * r2 * r2;
            px = fx * (x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)) + cx;
            py = fy * (y * radial + 2 * p2 * x * y + p1 * (r2 + 2 * y * y)) + cy;
          } else {
            const nlohmann::json file = nlohmann::json::parse(core::read_text_file(fs::path(out) / "transforms.json"));
            const nlohmann::json& frame = file.at("frames").at(c);
            const auto& m = frame.at("transform_matrix");
            // Into the camera's OpenGL frame by the transpose of its rotation; it looks along -z.
            double local[3];
            for (std::size_t k = 0; k < 3; ++k) {
              local[k] = 0;
              const double d[3] = {point.x - m[0][3].get<double>(), point.y - m[1][3].get<double>(),
                                   point.z - m[2][3].get<double>()};
              for (std::size_t r = 0; r < 3; ++r) local[k] += m[r][k].get<double>() * d[r];
            }
            const double x = local[0] / -local[2], y = -local[1] / -local[2], r2 = x * x + y * y;
            const double k1 = frame.at("k1"), k2 = frame.at("k2"), p1 = frame.at("p1"), p2 = frame.at("p2");
            const double radial = 1 + k1 * r2 + k2 * r2 * r2;
            px = frame.at("fl_x").get<double>() * (x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)) +
                 frame.at("cx").get<double>();
            py = frame.at("fl_y").get<double>() * (y * radial + 2 * p2 * x * y + p1 * (r2 + 2 * y * y)) +
                 frame.at("cy").get<double>();
            CHECK(frame.contains("mask_path") == undistort);
          }
          // Theirs count from the corner of the top left pixel.
          const core::Pixel expected = *ours.project(point);
          CHECK(px - 0.5 == Approx(expected.x).margin(1e-6));
          CHECK(py - 0.5 == Approx(expected.y).margin(1e-6));
        }
      }
    }
  }
  // Ball passes are measured with the newest cameras: the directions follow a lens that is said to be elsewhere.
  REQUIRE(
      run({"capture", "--sim", "--mirror-ball", "--stage", stage_file, "--size", "320", "--name", "ball", "--quiet"})
          .status == 0);
  const auto directions = [&](const std::string& file) {
    const test::Outcome calibrated = run({"calibrate", "ball", "--lp", (folder / file).string(), "--quiet"});
    INFO(calibrated.err);
    REQUIRE(calibrated.status == 0);
    std::vector<core::Vec3> found;
    for (const core::LpEntry& entry : core::read_lp(folder / file)) found.push_back(entry.direction.vec());
    return found;
  };
  const std::vector<core::Vec3> before = directions("before.lp");
  {
    db::Store store = db::Store::open(folder / "store");
    const db::Product measured = store.products("camera_calibration").back();
    nlohmann::json parameters = nlohmann::json::parse(measured.parameters);
    for (nlohmann::json& camera : parameters.at("cameras")) {
      // The cameras turned by two degrees about the stage's y axis.
      for (const char* key : {"position_m", "right", "down", "forward"}) {
        const core::Vec3 v = core::rotation_about({0, 1, 0}, core::radians_from_degrees(2)) * vec(camera.at(key));
        camera[key] = {v.x, v.y, v.z};
      }
    }
    db::NewProduct turned;
    turned.kind = "camera_calibration";
    turned.stage_key = measured.stage_key;
    turned.parameters = parameters.dump();
    store.add_product(turned);
  }
  const std::vector<core::Vec3> after = directions("after.lp");
  REQUIRE(before.size() == after.size());
  for (std::size_t i = 0; i < before.size(); ++i) {
    const core::Vec3 expected = core::rotation_about({0, 1, 0}, core::radians_from_degrees(2)) * before[i];
    CHECK(norm(after[i] - expected) < 0.003);
  }

  const test::Outcome again = run({"export", "boards", "--format", "colmap", "--out", (folder / "colmap").string()});
  CHECK(again.status == 2);
  CHECK(run({"export", "boards", "--undistort", "--out", (folder / "lp").string()}).status == 2);
}
