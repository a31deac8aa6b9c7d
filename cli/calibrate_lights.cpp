#include "cli/calibrate_lights.h"

#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>

#include "cli/context.h"
#include "cli/format.h"
#include "cli/jobs/calibrate_pictures.h"
#include "cli/report/light_files.h"
#include "core/error.h"

namespace lightstage::cli {

namespace {

struct Options {
  std::filesystem::path balls, circles, out;
  bool detect = false;
};

nlohmann::ordered_json xyz(const core::Direction& d) {
  return nlohmann::ordered_json::array({d.x(), d.y(), d.z()});
}

nlohmann::ordered_json number_or_null(double value) {
  return std::isfinite(value) ? nlohmann::ordered_json(value) : nlohmann::ordered_json(nullptr);
}

nlohmann::ordered_json light_object(const BallPictures& pictures, const PlacedLight& light) {
  nlohmann::ordered_json balls = nlohmann::ordered_json::array();
  for (std::size_t v = 0; v < light.per_view.size(); ++v) {
    const calib::LightEstimate& estimate = light.per_view[v];
    nlohmann::ordered_json ball{{"ball", pictures.views[v].ball}};
    if (!pictures.views[v].camera.empty()) ball["camera"] = pictures.views[v].camera;
    if (estimate.highlight) ball["highlight"] = {estimate.highlight->position.x, estimate.highlight->position.y};
    if (estimate.placed) {
      ball["direction"] = xyz(estimate.direction);
    } else {
      ball["reason"] = estimate.reason;
    }
    balls.push_back(ball);
  }
  nlohmann::ordered_json object{
      {"index", light.index},
      {"direction", light.used ? xyz(light.direction) : nlohmann::ordered_json(nullptr)},
      {"sigma_deg", light.used ? nlohmann::ordered_json(light.sigma_degrees) : nlohmann::ordered_json(nullptr)},
      {"used", light.used},
      {"reason", light.reason},
      {"picture", pictures.names[std::size_t(light.index)]},
      {"balls", balls}};
  if (light.position) {
    object["position"] = {light.position->x, light.position->y, light.position->z};
    object["sigma_m"] = light.sigma_m;
  }
  return object;
}

void run_lights(const Options& options, const Context& context) {
  if (options.circles.empty() && !options.detect) {
    throw core::UsageError("calibrate lights: say where the balls are with --circles FILE, or --detect");
  }
  const std::optional<std::filesystem::path> description =
      options.circles.empty() ? std::nullopt : std::optional(options.circles);
  const BallPictures pictures = find_balls(options.balls, description, options.detect);
  const PicturesReport report = calibrate_pictures(pictures);

  std::string text = "placed " + std::to_string(report.used) + " of " + std::to_string(report.lights.size()) +
                     " lights; median standard error " + fixed(report.median_sigma_degrees, 3) + " degrees\n";
  if (std::isfinite(report.mean_degrees_between)) {
    text += "balls differ by " + fixed(report.mean_degrees_between, 3) + " degrees on average, " +
            fixed(report.mean_degrees_to_joint, 3) + " from their joint directions\n";
  }
  nlohmann::ordered_json lights = nlohmann::ordered_json::array();
  for (const PlacedLight& light : report.lights) {
    lights.push_back(light_object(pictures, light));
    if (!light.reason.empty()) {
      text += "  light " + std::to_string(light.index) + " (" + pictures.names[std::size_t(light.index)] + ")" +
              (light.used ? " " : " not placed: ") + light.reason + "\n";
    }
  }
  nlohmann::ordered_json object{{"lights", lights},
                                {"placed", report.used},
                                {"median_sigma_deg", number_or_null(report.median_sigma_degrees)},
                                {"mean_deg_between_balls", number_or_null(report.mean_degrees_between)},
                                {"mean_deg_to_joint", number_or_null(report.mean_degrees_to_joint)},
                                {"seconds", report.seconds}};
  if (report.rms_px) {
    object["rms_px"] = *report.rms_px;
    text += "bundle adjustment leaves " + fixed(*report.rms_px, 3) + " px of the highlights\n";
  }
  if (!options.out.empty()) {
    write_light_files(
        options.out,
        {.names = pictures.names,
         .views = {pictures.views.begin(), pictures.views.end()},
         .stage_radius_m = pictures.stage_radius_m,
         .picture = [&](std::size_t view,
                        std::size_t light) { return load_picture(pictures, pictures.views[view], light); }},
        report);
    object["folder"] = options.out.string();
    text += "wrote lights.lp, lights.dome, lights.csv and lights.png to " + options.out.string() + "\n";
  }
  context.result(text, object);
}

}  // namespace

void add_calibrate_lights(CLI::App& calibrate, Context& context) {
  CLI::App* command = calibrate.add_subcommand("lights", "Light directions from loose pictures of balls, one a light");
  command->footer("Example:\n  lightstage calibrate lights --balls pictures --circles balls.toml --out lights --json");
  auto options = std::make_shared<Options>();
  command->add_option("--balls", options->balls, "Folder of pictures, one a light")->required();
  command->add_option("--circles", options->circles,
                      "TOML file: where the balls are, and what is known of cameras and stage");
  command->add_flag("--detect", options->detect, "Find balls that the file does not place in the pictures' mean");
  command->add_option("--out", options->out, "Folder for lights.lp, lights.dome, lights.csv and lights.png");
  command->callback([options, &context] { run_lights(*options, context); });
}

}  // namespace lightstage::cli
