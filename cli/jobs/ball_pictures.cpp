#include "cli/jobs/ball_pictures.h"

#include <fnmatch.h>

#include <algorithm>
#include <cmath>
#include <set>

#include "calib/ball_circle.h"
#include "cli/jobs/picture_folder.h"
#include "core/config.h"
#include "core/error.h"
#include "core/foreign_path.h"
#include "core/printable.h"

namespace lightstage::cli {

namespace {

namespace fs = std::filesystem;
using core::Vec3;

constexpr double kHandSigmaPx = 0.5;  // of circles given by numbers, where the file does not say

std::vector<std::string> picture_names(const fs::path& folder, const std::string& pattern,
                                       const std::set<std::string>& others) {
  std::vector<std::string> names = pictures_in(folder);
  std::erase_if(names, [&](const std::string& name) {
    return others.contains(name) || (!pattern.empty() && fnmatch(pattern.c_str(), name.c_str(), 0) != 0);
  });
  if (names.empty()) {
    throw core::BadInput("balls: no pictures" + (pattern.empty() ? "" : " named '" + pattern + "'") + " in '" +
                         folder.string() + "'");
  }
  return names;
}

Vec3 vector(const core::TomlTable& table, const char* key) {
  const std::vector<double> v = table.numbers(key, 3);
  return {v[0], v[1], v[2]};
}

// A camera without a place stands at the origin and looks along -z, image up along y.
struct NamedCamera {
  std::string name;
  core::CameraModel model;
  bool placed = false;
};

NamedCamera read_camera(const core::TomlTable& table) {
  constexpr double kAxisTolerance = 1e-5;
  NamedCamera camera;
  camera.name = table.string("name", "camera");
  core::CameraModel& m = camera.model;
  const std::vector<double> focal = table.numbers("focal_length_pixels", 2);
  if (!(focal[0] > 0 && focal[1] > 0)) table.fail("focal_length_pixels", "must be above 0");
  m.fx = focal[0];
  m.fy = focal[1];
  const std::vector<double> principal = table.numbers("principal_point_pixels", 2);
  m.cx = principal[0];
  m.cy = principal[1];
  if (table.has("radial_distortion")) {
    const std::vector<double> k = table.numbers("radial_distortion", 3);
    m.k1 = k[0], m.k2 = k[1], m.k3 = k[2];
  }
  if (table.has("tangential_distortion")) {
    const std::vector<double> p = table.numbers("tangential_distortion", 2);
    m.p1 = p[0], m.p2 = p[1];
  }
  // What a stage file's entries say besides: pictures have sizes of their own, crops among them.
  if (table.has("width_pixels")) table.integer("width_pixels");
  if (table.has("height_pixels")) table.integer("height_pixels");
  if (table.has("responsivity_per_s")) table.number("responsivity_per_s");
  camera.placed = table.has("position_m");
  Vec3 right{1, 0, 0}, down{0, -1, 0}, forward{0, 0, -1};
  if (camera.placed) {
    right = vector(table, "right"), down = vector(table, "down"), forward = vector(table, "forward");
    m.stage_from_camera.translation = vector(table, "position_m");
  }
  if (std::abs(norm(right) - 1) > kAxisTolerance || std::abs(norm(down) - 1) > kAxisTolerance ||
      norm(cross(right, down) - forward) > kAxisTolerance) {
    table.fail("forward", "right, down and forward must be unit vectors with forward = right x down");
  }
  m.stage_from_camera.rotation = core::Mat3{{right, down, forward}}.transposed();
  return camera;
}

// A file or folder that the description names, below the folder of the pictures.
fs::path below(const fs::path& folder, const core::TomlTable& table, const char* key) {
  const std::string name = table.string(key);
  if (const auto objection = core::objection_to_name(folder, name)) {
    table.fail(key, "names " + core::quoted(name) + ", which " + *objection);
  }
  return folder / name;
}

// What the description says of one view of a ball.
struct BallEntry {
  BallInPictures view;
  std::optional<NamedCamera> camera;
  std::optional<calib::Circle> circle;
  std::optional<fs::path> outline;  // a picture that shows the ball brighter than its surroundings
  double sigma_px = kHandSigmaPx;
  std::optional<double> radius_m;
};

BallEntry read_ball(const core::TomlTable& table, const fs::path& folder, const std::vector<NamedCamera>& cameras,
                    std::size_t index) {
  BallEntry entry;
  entry.view.ball = table.string("name", "ball " + std::to_string(index + 1));
  entry.view.folder = table.has("folder") ? below(folder, table, "folder") : folder;
  if (!cameras.empty()) {
    const std::string name = table.string("camera", cameras.front().name);
    const auto camera = std::find_if(cameras.begin(), cameras.end(), [&](const auto& c) { return c.name == name; });
    if (camera == cameras.end()) table.fail("camera", "names no [[camera]]: '" + name + "'");
    entry.camera = *camera;
    entry.view.camera = name;
  }
  if (entry.camera || table.has("radius_m")) {
    entry.radius_m = table.number("radius_m");
    if (!(*entry.radius_m > 0)) table.fail("radius_m", "must be above 0");
  }
  if (table.has("crop")) {
    const std::vector<double> corner = table.numbers("crop", 2);
    if (!entry.camera) table.fail("crop", "means nothing without a [[camera]]");
    entry.camera->model.cx -= corner[0];
    entry.camera->model.cy -= corner[1];
  }
  if (table.has("circle")) {
    const std::vector<double> c = table.numbers("circle", 3);
    if (!(c[2] > 0)) table.fail("circle", "is [x, y, radius] in pixels; the radius must be above 0");
    entry.circle = calib::Circle{{c[0], c[1]}, c[2]};
  }
  entry.sigma_px = table.number("circle_sigma_px", kHandSigmaPx);
  if (!(entry.sigma_px > 0)) table.fail("circle_sigma_px", "must be above 0");
  if (table.has("outline")) {
    if (entry.circle) table.fail("outline", "and 'circle' both say where the ball is: leave one out");
    entry.outline = below(entry.view.folder, table, "outline");
  }
  return entry;
}

void require_size(core::ImageView picture, const core::CameraModel& model, const fs::path& file,
                  const fs::path& first) {
  if (picture.width() == model.width && picture.height() == model.height) return;
  throw core::BadInput(file.string() + ": is " + std::to_string(picture.width()) + " x " +
                       std::to_string(picture.height()) + " pixels, '" + first.filename().string() + "' is " +
                       std::to_string(model.width) + " x " + std::to_string(model.height));
}

core::Image mean_picture(const BallPictures& pictures, const BallInPictures& view) {
  core::Image mean;
  for (std::size_t i = 0; i < pictures.names.size(); ++i) {
    const core::Image picture = load_picture(pictures, view, i);
    if (i == 0) mean = core::Image(picture.size());
    if (picture.channels() != mean.channels()) {
      throw core::BadInput((view.folder / pictures.names[i]).string() + ": has " + std::to_string(picture.channels()) +
                           " channels, '" + pictures.names.front() + "' has " + std::to_string(mean.channels()));
    }
    const auto count = float(pictures.names.size());
    for (std::size_t k = 0; k < mean.values().size(); ++k) mean.values()[k] += picture.values()[k] / count;
  }
  return mean;
}

void place(const BallPictures& pictures, BallEntry& entry, bool detect) {
  BallInPictures& view = entry.view;
  const fs::path first = view.folder / pictures.names.front();
  const core::ImageSize size = core::read_image_size(first);
  view.model = entry.camera ? entry.camera->model : core::CameraModel{};
  view.model.width = size.width;
  view.model.height = size.height;
  if (!entry.circle && !entry.outline && !detect) {
    throw core::BadInput("ball '" + view.ball +
                         "': nothing says where it is; give 'circle' or 'outline' in the description, or --detect");
  }
  std::optional<core::Image> picture;
  if (entry.outline) {
    picture = core::read_image(*entry.outline, {.encoding = pictures.encoding});
    require_size(*picture, view.model, *entry.outline, first);
  }
  if (entry.circle) {
    const auto& [middle, radius] = *entry.circle;
    if (middle.x + radius < 0 || middle.y + radius < 0 || middle.x - radius > size.width - 1 ||
        middle.y - radius > size.height - 1) {
      throw core::BadInput("ball '" + view.ball + "': its circle lies outside the pictures, which have " +
                           std::to_string(size.width) + " x " + std::to_string(size.height) + " pixels");
    }
  }
  if (!entry.circle && !entry.outline) picture = mean_picture(pictures, view);
  try {
    if (picture && entry.camera) {
      view.sphere = calib::locate_sphere(*picture, view.model, *entry.radius_m);
      return;
    }
    if (entry.camera) {
      view.sphere = calib::ball_in_circle(view.model, *entry.circle, *entry.radius_m, entry.sigma_px);
      return;
    }
    view.sphere = {{0, 0, 0}, 1, entry.sigma_px, 3};
    if (picture) {
      const calib::FoundCircle found = calib::locate_circle(*picture);
      entry.circle = found.circle;
      view.sphere.outline_rms_px = found.rms_px;
      view.sphere.outline_points = found.points;
    }
    view.model = calib::distant_camera(size.width, size.height, *entry.circle);
  } catch (const core::BadInput& error) {
    throw core::BadInput((entry.outline ? entry.outline->string() : view.folder.string()) + ": " + error.what());
  }
}

// Where no camera's place is known, the stage's centre is the middle of the balls.
void centre_on_balls(BallPictures& pictures) {
  Vec3 middle;
  for (const BallInPictures& view : pictures.views) {
    middle = middle + view.sphere.centre / double(pictures.views.size());
  }
  for (BallInPictures& view : pictures.views) {
    view.sphere.centre = view.sphere.centre - middle;
    view.model.stage_from_camera.translation = view.model.stage_from_camera.translation - middle;
  }
}

}  // namespace

BallPictures find_balls(const fs::path& folder, const std::optional<fs::path>& description, bool detect) {
  BallPictures pictures;
  std::vector<BallEntry> entries;
  std::vector<NamedCamera> cameras;
  std::string pattern;
  std::optional<double> saturation;
  std::set<std::string> others;
  if (description) {
    const core::TomlTable table = core::TomlTable::read_file(*description);
    pattern = table.string("pictures", "");
    const std::string encoding = table.string("encoding", "auto");
    if (encoding == "linear") {
      pictures.encoding = core::Encoding::kLinear;
    } else if (encoding == "srgb") {
      pictures.encoding = core::Encoding::kSrgb;
    } else if (encoding != "auto") {
      table.fail("encoding", "must be auto, linear or srgb");
    }
    saturation = table.has("saturation") ? std::optional(table.number("saturation")) : std::nullopt;
    if (saturation && !(*saturation >= 0)) table.fail("saturation", "must not be below 0");
    if (table.has("stage_radius_m")) {
      pictures.stage_radius_m = table.number("stage_radius_m");
      if (!(*pictures.stage_radius_m > 0)) table.fail("stage_radius_m", "must be above 0");
      constexpr double kUsualShare = 0.01;
      pictures.stage_radius_sigma_m = table.number("stage_radius_sigma_m", kUsualShare * *pictures.stage_radius_m);
      if (!(pictures.stage_radius_sigma_m > 0)) table.fail("stage_radius_sigma_m", "must be above 0");
    }
    if (table.has("dark")) pictures.dark = table.string("dark");
    for (const core::TomlTable& camera : table.tables("camera")) cameras.push_back(read_camera(camera));
    const bool some_placed = std::any_of(cameras.begin(), cameras.end(), [](const auto& c) { return c.placed; });
    const bool all_placed = std::all_of(cameras.begin(), cameras.end(), [](const auto& c) { return c.placed; });
    if ((some_placed || cameras.size() > 1) && !all_placed) {
      table.fail("camera", "every one of several cameras needs position_m, right, down and forward");
    }
    for (const core::TomlTable& ball : table.tables("ball")) {
      entries.push_back(read_ball(ball, folder, cameras, entries.size()));
      const BallInPictures& view = entries.back().view;
      const bool twice = std::any_of(entries.begin(), entries.end() - 1, [&](const BallEntry& e) {
        return e.view.ball == view.ball && e.view.camera == view.camera;
      });
      if (twice) ball.fail("name", "'" + view.ball + "' is described twice; only other cameras see a ball again");
    }
    if (entries.empty() && !cameras.empty()) table.fail("ball", "is missing: a camera alone shows no light");
    if (pictures.dark) {
      below(folder, table, "dark");
      for (const BallEntry& entry : entries) below(entry.view.folder, table, "dark");
    }
    table.finish();
  }
  if (entries.empty()) {
    entries.emplace_back();
    entries.back().view.ball = "ball 1";
    entries.back().view.folder = folder;
  }
  if (pictures.dark) others.insert(pictures.dark->filename().string());
  for (const BallEntry& entry : entries) {
    if (entry.outline) others.insert(entry.outline->filename().string());
  }
  pictures.names = picture_names(entries.front().view.folder, pattern, others);
  const std::string extension = fs::path(pictures.names.front()).extension().string();
  pictures.saturation = saturation.value_or(extension == ".exr" || extension == ".hdr" ? 0 : 1);
  for (const BallEntry& entry : entries) {
    if (picture_names(entry.view.folder, pattern, others) != pictures.names) {
      throw core::BadInput("balls: '" + entry.view.folder.string() + "' and '" + entries.front().view.folder.string() +
                           "' do not hold pictures of the same names; 'pictures' in the description picks them");
    }
  }
  for (BallEntry& entry : entries) {
    place(pictures, entry, detect);
    // Parallel rays know no lengths but the ball's radius.
    if (pictures.stage_radius_m && !entry.radius_m) {
      throw core::BadInput("ball '" + entry.view.ball + "': 'stage_radius_m' needs the ball's 'radius_m' too");
    }
    const double unit_m = entry.camera ? 1 : entry.radius_m.value_or(1);
    if (pictures.stage_radius_m) entry.view.light_distance = *pictures.stage_radius_m / unit_m;
    pictures.views.push_back(entry.view);
  }
  pictures.metric = !cameras.empty();
  if (pictures.metric && !cameras.front().placed) centre_on_balls(pictures);
  return pictures;
}

core::Image load_picture(const BallPictures& pictures, const BallInPictures& view, std::size_t light) {
  const fs::path file = view.folder / pictures.names[light];
  core::Image picture = core::read_image(file, {.encoding = pictures.encoding});
  require_size(picture, view.model, file, pictures.names.front());
  if (pictures.dark) {
    const core::Image dark = core::read_image(view.folder / *pictures.dark, {.encoding = pictures.encoding});
    if (dark.size() != picture.size()) {
      throw core::BadInput((view.folder / *pictures.dark).string() + ": the dark picture is of another size than '" +
                           pictures.names[light] + "'");
    }
    for (std::size_t k = 0; k < picture.values().size(); ++k) picture.values()[k] -= dark.values()[k];
  }
  return picture.channels() == 4 || picture.channels() == 2 ? core::to_rgb(picture) : picture;
}

}  // namespace lightstage::cli
