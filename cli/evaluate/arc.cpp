#include "cli/evaluate/arc.h"

#include <algorithm>
#include <cmath>

#include "cli/evaluate/report.h"
#include "cli/format.h"
#include "cli/options.h"
#include "cli/report/html.h"
#include "cli/report/plot.h"
#include "core/error.h"
#include "core/file.h"
#include "core/image_file.h"
#include "core/interrupt.h"
#include "core/progress.h"
#include "core/sphere.h"
#include "model/metrics.h"

namespace lightstage::cli {

namespace {

using nlohmann::ordered_json;

constexpr double kReach = 12;  // pixels
constexpr const char* kTruth = "truth";

// The second direction made perpendicular to the first.
core::Vec3 tangent(const core::Direction& from, const core::Direction& to) {
  const double along = from.x() * to.x() + from.y() * to.y() + from.z() * to.z();
  return core::Direction::from_vector({to.x() - along * from.x(), to.y() - along * from.y(), to.z() - along * from.z()})
      .vec();
}

core::Direction turned(const core::Direction& from, const core::Vec3& towards, double radians) {
  const double c = std::cos(radians), s = std::sin(radians);
  return core::Direction::from_vector(
      {c * from.x() + s * towards.x, c * from.y() + s * towards.y, c * from.z() + s * towards.z});
}

// From the first to the last pixel of a row inside the mask, with some around; all of them where none is inside.
struct Columns {
  int first = 0, last = 0;
};

Columns columns_inside(const core::Image& mask, int row) {
  constexpr int kAround = 6;
  Columns columns{mask.width(), -1};
  for (int x = 0; x < mask.width(); ++x) {
    if (mask(row, x) <= 0.5f) continue;
    columns.first = std::min(columns.first, x);
    columns.last = x;
  }
  if (columns.last < 0) return {0, mask.width() - 1};
  return {std::max(0, columns.first - kAround), std::min(mask.width() - 1, columns.last + kAround)};
}

// The row with the most pixels inside the mask.
int widest_row(const core::Image& mask) {
  int best = 0, widest = -1;
  for (int y = 0; y < mask.height(); ++y) {
    int inside = 0;
    for (int x = 0; x < mask.width(); ++x) inside += mask(y, x) > 0.5f ? 1 : 0;
    if (inside > widest) {
      widest = inside;
      best = y;
    }
  }
  return best;
}

// Gathers frames, in their order.
class Recorder {
 public:
  Recorder(std::string name, const core::OlatScan& scan, const std::optional<model::ShadowEdge>& edge, int row,
           int frames)
      : scan_(scan), edge_(edge), row_(row), shown_(columns_inside(scan.mask(), row)) {
    score_.name = std::move(name);
    score_.strip = core::Image(frames, shown_.last - shown_.first + 1, 3);
  }

  void add(const core::Image& shown, const core::Image* truth) {
    const core::ImageView line = shown.view().crop(row_, 0, 1, shown.width());
    const core::Image rgb = core::to_rgb(line.crop(0, shown_.first, 1, score_.strip.width()));
    std::copy(rgb.values().begin(), rgb.values().end(), score_.strip.pixel(int(frame_), 0));
    if (edge_) score_.edge.push_back(model::edge_near(line, *edge_, frame_, kReach));
    if (truth != nullptr)
      squares_ += model::mean_squared_error(core::to_rgb(shown), core::to_rgb(*truth), scan_.mask());
    differences_.add(shown, scan_.mask());
    ++frame_;
  }

  ArcScore score(bool against_truth) {
    score_.largest_difference = differences_.largest();
    score_.mean_difference = differences_.mean();
    if (against_truth) score_.rmse = std::sqrt(squares_ / double(frame_));
    score_.fit = model::fit_line(score_.edge);
    return std::move(score_);
  }

 private:
  const core::OlatScan& scan_;
  const std::optional<model::ShadowEdge>& edge_;
  int row_;
  Columns shown_;
  ArcScore score_;
  model::SecondDifferences differences_;
  double squares_ = 0;
  std::size_t frame_ = 0;
};

double frames_a_degree(const Arc& arc) {
  return arc.steps / arc.degrees();
}

// How much steeper or flatter the method's edge runs than the true one, pixels a degree.
std::optional<double> slope_error(const ArcScore& method, const ArcResult& result) {
  if (!method.fit || !result.truth || !result.truth->fit) return std::nullopt;
  return (method.fit->slope - result.truth->fit->slope) * frames_a_degree(result.arc);
}

// The root of the mean squared distance of the method's edge from the true one, over the frames in which it has one.
std::optional<double> off_truth(const ArcScore& method, const ArcResult& result) {
  if (!method.fit || !result.truth) return std::nullopt;
  double squares = 0;
  for (std::size_t t = 0; t < method.edge.size(); ++t) {
    if (method.edge[t]) squares += std::pow(*method.edge[t] - result.truth->edge[t].value(), 2);
  }
  return std::sqrt(squares / double(method.fit->frames));
}

ordered_json direction_json(const core::Direction& direction) {
  return {direction.longitude_degrees(), direction.latitude_degrees()};
}

std::string strip_file(const std::string& name) {
  return "strip_" + name + ".png";
}

// Time downwards, pixels and frames so large that they can be seen.
core::Image enlarged(const core::Image& strip) {
  constexpr int kWidth = 500, kDown = 4;
  const int across = std::max(1, kWidth / strip.width());
  core::Image result(strip.height() * kDown, strip.width() * across, 3);
  for (int y = 0; y < result.height(); ++y) {
    for (int x = 0; x < result.width(); ++x) std::copy_n(strip.pixel(y / kDown, x / across), 3, result.pixel(y, x));
  }
  return result;
}

std::vector<const ArcScore*> shown_scores(const ArcResult& result) {
  std::vector<const ArcScore*> all;
  if (result.truth) all.push_back(&*result.truth);
  for (const ArcScore& method : result.methods) all.push_back(&method);
  return all;
}

std::vector<std::vector<std::string>> arc_rows(const ArcResult& result) {
  const auto number = [](const std::optional<double>& value, int digits) {
    return value ? fixed(*value, digits) : std::string("-");
  };
  std::vector<std::vector<std::string>> rows{{"method", "RMSE", "2nd difference: mean", "largest",
                                              "edge: slope error px/deg", "residual px", "off truth px", "frames"}};
  for (const ArcScore* score : shown_scores(result)) {
    rows.push_back({score->name, number(score->rmse, 4), fixed(score->mean_difference, 4),
                    fixed(score->largest_difference, 4), number(slope_error(*score, result), 3),
                    score->fit ? fixed(score->fit->residual, 2) : "-", number(off_truth(*score, result), 2),
                    score->fit ? std::to_string(score->fit->frames) : "-"});
  }
  return rows;
}

std::string edge_svg(const ArcResult& result) {
  PlotPanel panel{.title = "The shadow's edge in row " + std::to_string(result.row),
                  .x = {.label = "degrees along the arc"},
                  .y = {.label = "pixels from the line through the true edge"},
                  .series = {}};
  const model::LineFit& line = result.truth->fit.value();
  for (const ArcScore* score : shown_scores(result)) {
    PlotSeries series{.name = score->name, .points = {}, .line = true, .markers = false};
    for (std::size_t t = 0; t < score->edge.size(); ++t) {
      if (!score->edge[t]) continue;
      series.points.push_back(
          {double(t) / frames_a_degree(result.arc), *score->edge[t] - line.offset - line.slope * double(t), {}});
    }
    panel.series.push_back(std::move(series));
  }
  return svg_plots({panel}, 1);
}

}  // namespace

double Arc::degrees() const {
  return core::degrees_from_radians(core::angle_radians(from, to));
}

std::vector<core::Direction> Arc::directions() const {
  const core::Vec3 towards = tangent(from, to);
  std::vector<core::Direction> all;
  for (int i = 0; i <= steps; ++i)
    all.push_back(turned(from, towards, core::angle_radians(from, to) * double(i) / steps));
  return all;
}

Arc arc_between_lights(std::span<const core::Direction> lights) {
  constexpr double kSamePlace = 1e-6;
  const core::Direction wanted = core::Direction::from_longitude_latitude_degrees(30, 30);
  const core::Direction first = lights[core::nearest_indices(lights, wanted, 1).front()];
  for (const std::size_t i : core::nearest_indices(lights, first, lights.size())) {
    const double apart = core::angle_radians(first, lights[i]);
    if (apart < kSamePlace) continue;
    return {.from = first, .to = turned(first, tangent(first, lights[i]), std::min(2 * apart, 3.0))};
  }
  throw core::UsageError("an arc between lights needs lights in two places");
}

ArcResult judge_along_arc(const core::OlatScan& scan, const std::vector<MethodChoice>& choices, const Arc& arc,
                          std::vector<core::Image> truth, bool linear_values) {
  const std::vector<core::Direction> directions = arc.directions();
  const auto shown = [&](const core::Image& linear) { return model::judged(linear, scan.exposure(), linear_values); };
  for (core::Image& image : truth) image = shown(image);
  const std::optional<model::ShadowEdge> edge = model::find_moving_edge(truth, scan.mask());
  ArcResult result{.arc = arc, .row = edge ? edge->row : widest_row(scan.mask()), .truth = {}, .methods = {}};
  const int frames = int(directions.size());
  if (!truth.empty()) {
    Recorder recorder(kTruth, scan, edge, result.row, frames);
    for (const core::Image& image : truth) recorder.add(image, nullptr);
    result.truth = recorder.score(false);
  }
  core::Progress progress("along the arc", directions.size() * choices.size());
  for (const MethodChoice& choice : choices) {
    const auto method = model::make_interpolator(choice.method, scan, choice.options);
    Recorder recorder(std::string(method->name()), scan, edge, result.row, frames);
    for (std::size_t t = 0; t < directions.size(); ++t) {
      core::throw_if_interrupted();
      const core::Image picture = method->render(directions[t]);
      core::require_finite(picture, "the picture that " + choice.method + " makes of scan '" + scan.name() + "'");
      recorder.add(shown(picture), truth.empty() ? nullptr : &truth[t]);
      progress.advance();
    }
    result.methods.push_back(recorder.score(!truth.empty()));
  }
  return result;
}

ordered_json arc_json(const std::string& scan, const ArcResult& result) {
  ordered_json object{{"scan", scan},
                      {"protocol", "arc"},
                      {"from", direction_json(result.arc.from)},
                      {"to", direction_json(result.arc.to)},
                      {"degrees", result.arc.degrees()},
                      {"steps", result.arc.steps},
                      {"row", result.row},
                      {"truth", nullptr},
                      {"methods", ordered_json::array()}};
  for (const ArcScore* score : shown_scores(result)) {
    ordered_json one{{"name", score->name},
                     {"second_difference_mean", score->mean_difference},
                     {"second_difference_largest", score->largest_difference}};
    if (score->name != kTruth) one["rmse"] = or_null(score->rmse);
    one["edge"] = nullptr;
    if (score->fit) {
      one["edge"] = {{"slope_px_per_deg", score->fit->slope * frames_a_degree(result.arc)},
                     {"slope_error_px_per_deg", or_null(slope_error(*score, result))},
                     {"residual_px", score->fit->residual},
                     {"off_truth_px", or_null(off_truth(*score, result))},
                     {"frames", score->fit->frames}};
    }
    one["strip"] = strip_file(score->name);
    if (score->name == kTruth) {
      object["truth"] = std::move(one);
    } else {
      object["methods"].push_back(std::move(one));
    }
  }
  return object;
}

std::string arc_text(const ArcResult& result) {
  std::string text = table(arc_rows(result));
  if (!result.truth) text += "this scan has no simulated truth: no shadow edge was looked for\n";
  if (result.truth && !result.truth->fit) text += "no shadow edge moves clearly along this arc\n";
  return text;
}

void write_arc(const std::filesystem::path& folder, const std::string& scan, const ArcResult& result) {
  core::write_file_atomically(folder / "arc.json", json_text(arc_json(scan, result)) + "\n");
  HtmlPage page("'" + scan + "', the light moving along an arc of " + fixed(result.arc.degrees(), 1) + " degrees");
  page.paragraph("From longitude " + fixed(result.arc.from.longitude_degrees(), 1) + ", latitude " +
                 fixed(result.arc.from.latitude_degrees(), 1) + " to " + fixed(result.arc.to.longitude_degrees(), 1) +
                 ", " + fixed(result.arc.to.latitude_degrees(), 1) + " in " + std::to_string(result.arc.steps) +
                 " steps. Second differences are those of frames that follow each other, over the mask: 0 where the "
                 "picture changes evenly.");
  page.table(arc_rows(result));
  if (result.truth && result.truth->fit) {
    core::write_file_atomically(folder / "edge.svg", edge_svg(result));
    page.figures({{"edge.svg", "How far the shadow's edge is from the line through the true one"}});
  }
  page.heading("Row " + std::to_string(result.row) + " of the picture over time");
  std::vector<HtmlPage::Figure> figures;
  for (const ArcScore* score : shown_scores(result)) {
    const std::string file = strip_file(score->name);
    core::write_image(folder / file, enlarged(score->strip), {.encoding = core::Encoding::kLinear});
    figures.push_back({file, score->name});
  }
  page.figures(figures);
  core::write_file_atomically(folder / "index.html", page.finish());
}

}  // namespace lightstage::cli
