#include "cli/bench/relight_bench.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "cli/jobs/environments.h"
#include "core/interrupt.h"
#include "core/parallel.h"
#include "core/progress.h"
#include "core/sphere.h"
#include "core/stopwatch.h"
#include "model/evaluation.h"
#include "model/methods.h"
#include "model/metrics.h"
#include "model/picture_sum.h"
#include "model/shipped_model.h"
#include "relight/environment_analysis.h"
#include "relight/harmonics.h"
#include "relight/picture.h"
#include "relight/relight.h"
#include "relight/sky.h"

namespace lightstage::cli {

namespace {

using core::Direction;
using core::Image;
using core::Vec3;
using relight::Environment;

Image even(int height, float value) {
  Image map(height, 2 * height, 3);
  std::fill(map.values().begin(), map.values().end(), value);
  return map;
}

// A dim room with two windows and a lamp.
Environment room() {
  Image map = even(128, 0.05F);
  const auto paint = [&](int top, int bottom, int left, int right, float value) {
    for (int y = top; y < bottom; ++y)
      for (int x = left; x < right; ++x)
        for (int c = 0; c < 3; ++c) map(y, x, c) = value * (1 - 0.1F * float(c));
  };
  paint(40, 64, 48, 68, 6);
  paint(36, 60, 160, 172, 9);
  paint(26, 29, 112, 115, 150);
  return Environment(map);
}

// CIE standard overcast sky: three times as bright at the zenith as at the horizon; a darker ground.
Environment overcast() {
  Image map = even(128, 0);
  const Environment places(even(128, 1));
  for (int y = 0; y < map.height(); ++y)
    for (int x = 0; x < map.width(); ++x) {
      const double up = places.direction(y, x).y();
      for (int c = 0; c < 3; ++c) map(y, x, c) = float(up > 0 ? (1 + 2 * up) / 3 : 0.1);
    }
  return Environment(map);
}

Environment smooth_noise(int degree) {
  Image map = even(128, 0);
  std::uint32_t state = 7;
  for (float& v : map.values()) {
    state = state * 1664525u + 1013904223u;
    v = float(state >> 8) / float(1 << 24);
  }
  Image smooth = relight::filtered(map, relight::cutoff_weights(degree, degree + 1));
  const auto [least, most] = std::minmax_element(smooth.values().begin(), smooth.values().end());
  const float low = *least, range = *most - *least;
  for (float& v : smooth.values()) v = (v - low) / range;
  return Environment(smooth);
}

Environment blurred(const Environment& map, double sigma_degrees) {
  Environment small = map.resized(256, 128);
  if (sigma_degrees == 0) return small;
  const std::vector<double> weights = relight::blur_weights(core::radians_from_degrees(sigma_degrees));
  return Environment(relight::filtered(small.radiance(), weights));
}

double exposure_of(const Image& picture, const Image& mask) {
  return std::exp2(-relight::auto_exposure_stops(picture, mask));
}

// As both are shown with the exposure of the second.
double dssim_of(const Image& picture, const Image& truth, const Image& mask) {
  const double exposure = exposure_of(truth, mask);
  return model::dssim(model::judged(picture, exposure, false), model::judged(truth, exposure, false), mask);
}

double rmse_of(const Image& picture, const Image& truth, const Image& mask) {
  const double exposure = exposure_of(truth, mask);
  return std::sqrt(
      model::mean_squared_error(model::judged(picture, exposure, false), model::judged(truth, exposure, false), mask));
}

double relative_rms(const Image& picture, const Image& truth, const Image& mask) {
  Image difference = picture;
  for (std::size_t i = 0; i < difference.values().size(); ++i) difference.values()[i] -= truth.values()[i];
  const double of_truth = relight::masked_rms(truth, mask);
  return of_truth > 0 ? relight::masked_rms(difference, mask) / of_truth : 0;
}

std::unique_ptr<model::LightInterpolator> linear_blending(const core::OlatScan& scan) {
  model::MethodOptions options;
  options.domain = model::Domain::kLinear;
  return model::make_interpolator("linear", scan, options);
}

std::unique_ptr<model::LightInterpolator> shipped_network(const core::OlatScan& scan) {
  model::MethodOptions options;
  options.model_file = model::shipped_blend();
  return model::make_interpolator("blend", scan, options);
}

core::ImageSize rgb_size(const core::OlatScan& scan) {
  return {scan.image_size().height, scan.image_size().width, 3};
}

struct Exhaustive {
  std::vector<Image> pictures;  // by environment
  double seconds_per_picture = 0, seconds_per_sum = 0;
};

// All maps are of one size, so that their pixels stand in the same directions.
Exhaustive exhaustive_pictures(const model::LightInterpolator& method, const std::vector<Environment>& maps) {
  std::vector<model::PictureSum> sums(maps.size(), model::PictureSum(rgb_size(method.scan())));
  std::vector<Direction> directions;
  for (int y = 0; y < maps.front().height(); ++y)
    for (int x = 0; x < maps.front().width(); ++x) directions.push_back(maps.front().direction(y, x));
  core::Progress progress("exhaustive synthesis", directions.size());
  Exhaustive result;
  std::size_t summed = 0;
  for (const std::size_t i : core::neighbouring_order(directions)) {
    core::throw_if_interrupted();
    const int y = int(i) / maps.front().width(), x = int(i) % maps.front().width();
    const core::Stopwatch rendering;
    const Image picture = method.render(directions[i]);
    result.seconds_per_picture += rendering.seconds() / double(directions.size());
    const core::Stopwatch summing;
    for (std::size_t m = 0; m < maps.size(); ++m) {
      const float* radiance = maps[m].radiance().pixel(y, x);
      const Vec3 colour = (maps[m].solid_angle(y) / std::numbers::pi) * Vec3{radiance[0], radiance[1], radiance[2]};
      if (colour == Vec3{}) continue;
      sums[m].add(picture.channels() == 3 ? picture : core::to_rgb(picture), colour);
      ++summed;
    }
    result.seconds_per_sum += summing.seconds();
    progress.advance();
  }
  result.seconds_per_sum /= double(std::max<std::size_t>(1, summed));
  for (const model::PictureSum& sum : sums) result.pictures.push_back(sum.result());
  return result;
}

// Where the stage has lights.
std::vector<Direction> covered_directions(const std::vector<Direction>& lights, std::size_t count) {
  const double reach = core::median_spacing_radians(lights);
  std::vector<Direction> covered;
  for (const Direction& direction : core::fibonacci_directions(count)) {
    const Direction& light = lights[core::nearest_indices(lights, direction, 1).front()];
    if (core::angle_radians(light, direction) <= reach) covered.push_back(direction);
  }
  return covered;
}

// By environment: the sum of the pictures times the light that is gathered onto their directions.
std::vector<Image> sums_of(const std::vector<Image>& pictures, const std::vector<std::vector<Vec3>>& colours) {
  std::vector<Image> result;
  for (const std::vector<Vec3>& of_environment : colours) {
    model::PictureSum sum(pictures.front().size());
    for (std::size_t i = 0; i < pictures.size(); ++i) sum.add(pictures[i], of_environment[i]);
    result.push_back(sum.result());
  }
  return result;
}

}  // namespace

std::vector<NamedEnvironment> bench_environments(const std::vector<std::filesystem::path>& files) {
  std::vector<NamedEnvironment> all{{"clear sky", relight::clear_sky({})},
                                    {"room", room()},
                                    {"overcast sky", overcast()},
                                    {"noise to degree 12", smooth_noise(12)}};
  for (const std::filesystem::path& file : files) all.push_back({file.stem().string(), read_environment(file)});
  return all;
}

MatchedTable matched_errors(const model::LightInterpolator& method, const std::vector<NamedEnvironment>& environments,
                            int width, int height, const std::vector<double>& asked) {
  std::vector<Environment> maps;
  for (const NamedEnvironment& environment : environments) maps.push_back(environment.map.resized(width, height));
  const Exhaustive exhaustive = exhaustive_pictures(method, maps);
  const relight::EnvironmentRelighter relighter(method);
  const core::Image& mask = method.scan().mask();
  MatchedTable table;
  table.seconds_per_picture = exhaustive.seconds_per_picture;
  core::Progress progress("relighting by plan", maps.size() * asked.size());
  for (std::size_t m = 0; m < maps.size(); ++m) {
    const Environment full = environments[m].map.resized(256, 128);
    const int degree_90 = relight::analyse(full).degree_90;
    for (const double error : asked) {
      const relight::EnvironmentReport report = relighter.relight(maps[m], relight::ErrorGoal{error});
      const relight::EnvironmentReport of_full = relighter.relight(full, relight::ErrorGoal{error});
      MatchedRow row;
      row.environment = environments[m].name;
      row.degree_90 = degree_90;
      row.asked = error;
      row.exhaustive = report.directions_exhaustive;
      row.synthesised = report.directions_synthesised;
      row.exhaustive_s = double(row.exhaustive) * (exhaustive.seconds_per_picture + exhaustive.seconds_per_sum);
      row.planned_s = report.seconds;
      row.dssim = dssim_of(report.image, exhaustive.pictures[m], mask);
      row.dssim_estimate = report.dssim_estimate;
      row.relative_rms = relative_rms(report.image, exhaustive.pictures[m], mask);
      row.synthesised_of_full = of_full.directions_synthesised;
      row.lit_of_full = of_full.directions_exhaustive;
      row.planned_of_full_s = of_full.seconds;
      table.rows.push_back(row);
      progress.advance();
    }
  }
  return table;
}

std::vector<GainRow> gains(const SimulatedStageOptions& options, const std::vector<std::size_t>& lights,
                           const std::vector<NamedEnvironment>& environments, std::size_t directions) {
  constexpr double kBlurs[] = {0, 1, 2, 3, 4, 5, 6, 8, 10, 14};  // degrees
  std::vector<NamedEnvironment> maps;
  std::vector<int> degrees;
  for (const NamedEnvironment& environment : environments)
    for (const double blur : kBlurs) {
      maps.push_back({environment.name + (blur > 0 ? ", blurred " + std::to_string(int(blur)) : ""),
                      blurred(environment.map, blur)});
      degrees.push_back(relight::analyse(maps.back().map).degree_90);
    }
  std::vector<GainRow> rows;
  core::Progress progress("gain of super-resolution", lights.size() * directions);
  for (const std::size_t count : lights) {
    SimulatedStageOptions of_count = options;
    of_count.lights = count;
    const SimulatedStage stage(of_count);
    const core::OlatScan& scan = stage.scan();
    const std::vector<Direction> places = covered_directions(scan.directions(), directions);
    std::vector<std::vector<Vec3>> colours;
    std::vector<std::vector<model::DistantLight>> gathered;
    for (const NamedEnvironment& map : maps) {
      std::vector<Vec3> of_map;
      std::vector<model::DistantLight> lights_of_map;
      const std::vector<model::DistantLight> onto = map.map.gather(places);
      for (std::size_t i = 0; i < places.size(); ++i) {
        of_map.push_back(onto[i].irradiance);
        lights_of_map.push_back({places[i], onto[i].irradiance});
      }
      colours.push_back(std::move(of_map));
      gathered.push_back(std::move(lights_of_map));
    }
    const auto network = shipped_network(scan), linear = linear_blending(scan);
    std::vector<Image> synthesised(places.size());
    for (const std::size_t i : core::neighbouring_order(places)) {
      core::throw_if_interrupted();
      synthesised[i] = network->render(places[i]);
      progress.advance();
    }
    progress.advance(directions - places.size());
    const std::vector<Image> of_network = sums_of(synthesised, colours);
    const std::vector<Image> truth = sums_of(stage.truth(places), colours);
    for (std::size_t m = 0; m < maps.size(); ++m) {
      model::PictureSum sum(rgb_size(scan));
      sum.add(scan, linear->captured_colours(gathered[m]));
      const Image blended = sum.result();
      rows.push_back({maps[m].name, count, degrees[m], dssim_of(blended, of_network[m], scan.mask()),
                      dssim_of(of_network[m], truth[m], scan.mask()), dssim_of(blended, truth[m], scan.mask())});
    }
  }
  return rows;
}

std::vector<ShadowRow> soft_shadows(const SimulatedStage& stage, const model::LightInterpolator& network,
                                    const std::vector<double>& radii) {
  const Direction light = Direction::from_longitude_latitude_degrees(48, 37);
  const core::OlatScan& scan = stage.scan();
  const auto linear = linear_blending(scan);
  std::vector<ShadowRow> rows;
  for (const double radius : radii) {
    core::throw_if_interrupted();
    // Samples of the disc half a degree apart: hard shadows move less than a pixel from one to the next.
    const int samples = std::clamp(int(std::ceil(4 * radius * radius)), 1, 1500);
    model::PictureSum sum(rgb_size(scan));
    const double share = 1 / double(samples);
    for (const Image& picture : stage.truth(relight::cap_directions(light, radius, samples)))
      sum.add(picture, {share, share, share});
    const Image truth = sum.result();
    const relight::RelightReport by_network = relight::relight_area(network, light, radius);
    const Image by_linear = relight::relight_area(*linear, light, radius).image;
    const core::Image& mask = scan.mask();
    rows.push_back({radius, rmse_of(by_network.image, truth, mask), rmse_of(by_linear, truth, mask),
                    dssim_of(by_network.image, truth, mask), dssim_of(by_linear, truth, mask),
                    by_network.directions_synthesised});
  }
  return rows;
}

}  // namespace lightstage::cli
