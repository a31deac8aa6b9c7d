#include "cli/evaluate/report.h"

#include <cmath>

#include "cli/evaluate/crops.h"
#include "cli/evaluate/scores.h"
#include "cli/format.h"
#include "cli/options.h"
#include "cli/report/html.h"
#include "cli/report/plot.h"
#include "core/error.h"
#include "core/file.h"
#include "core/image_file.h"
#include "core/progress.h"
#include "core/text.h"

namespace lightstage::cli {

namespace {

namespace fs = std::filesystem;
using model::MethodScore;

constexpr std::size_t kCropSheets = 4;

std::string values_named(const Report& report) {
  return report.linear_values ? "Linear values over the mask" : "Display-encoded values over the mask";
}

// The two measures of plots.
std::vector<Measure> plotted(const std::vector<MethodScore>& scores) {
  std::vector<Measure> all = measures(scores, {});
  std::erase_if(all, [](const Measure& measure) { return measure.key != "rmse" && measure.key != "dssim"; });
  return all;
}

// Error against the angle to the nearest light: a point a bin, at the mean angle of its images.
std::string angle_plot(const std::vector<MethodScore>& scores) {
  std::vector<PlotPanel> panels;
  for (const bool structural : {false, true}) {
    const std::string title = structural ? "DSSIM" : "RMSE";
    PlotPanel panel{.title = title + " against the angle to the nearest light",
                    .x = {.label = "degrees to the nearest light"},
                    .y = {.label = title},
                    .series = {}};
    for (const MethodScore& score : scores) {
      PlotSeries series{.name = score.name, .points = {}};
      for (const model::AngleBin& bin : score.by_angle) {
        if (bin.images == 0) continue;
        double degrees = 0;
        for (const model::ImageScore& image : score.each) {
          if (image.degrees_to_light >= bin.from_deg && image.degrees_to_light < bin.to_deg)
            degrees += image.degrees_to_light / double(bin.images);
        }
        series.points.push_back(
            {degrees, structural ? *bin.dssim : *bin.rmse, score.name + ", " + std::to_string(bin.images) + " images"});
      }
      panel.series.push_back(std::move(series));
    }
    panels.push_back(std::move(panel));
  }
  return svg_plots(panels, 2);
}

std::string time_plot(const std::vector<MethodScore>& scores) {
  std::vector<PlotPanel> panels;
  for (const Measure& measure : plotted(scores)) {
    PlotPanel panel{.title = measure.title + " against time",
                    .x = {.label = "seconds an image", .logarithmic = true},
                    .y = {.label = measure.title},
                    .series = {}};
    for (const MethodScore& score : scores) {
      panel.series.push_back(
          {.name = score.name, .points = {{score.seconds_per_image, *measure.of(score), score.name}}, .line = false});
    }
    panels.push_back(std::move(panel));
  }
  return svg_plots(panels, 2);
}

std::string lights_plot(const std::vector<JudgedStage>& stages) {
  std::vector<PlotPanel> panels;
  for (const Measure& measure : plotted(stages.front().scores)) {
    PlotPanel panel{.title = measure.title + " against the number of lights",
                    .x = {.label = "lights", .logarithmic = true},
                    .y = {.label = measure.title},
                    .series = {}};
    for (std::size_t m = 0; m < stages.front().scores.size(); ++m) {
      PlotSeries series{.name = stages.front().scores[m].name, .points = {}};
      for (const JudgedStage& stage : stages)
        series.points.push_back({double(stage.lights), *measure.of(stage.scores[m]), series.name});
      panel.series.push_back(std::move(series));
    }
    panels.push_back(std::move(panel));
  }
  return svg_plots(panels, 2);
}

std::string scores_csv(const Report& report) {
  const std::vector<Measure> columns = measures(report.stages.front().scores, report.own_metric);
  std::string csv = "lights,method,images";
  for (const Measure& column : columns)
    csv += "," + csv_field(column.key == "metric_model" ? report.own_metric : column.key);
  csv += ",seconds_per_image,peak_rss_bytes\n";
  for (const JudgedStage& stage : report.stages) {
    for (const MethodScore& score : stage.scores) {
      csv += std::to_string(stage.lights) + "," + csv_field(score.name) + "," + std::to_string(score.images);
      for (const Measure& column : columns) csv += "," + core::number_text(*column.of(score));
      csv += "," + core::number_text(score.seconds_per_image) + "," +
             (score.peak_rss_bytes ? std::to_string(*score.peak_rss_bytes) : "") + "\n";
    }
  }
  return csv;
}

std::string angles_csv(const Report& report) {
  std::string csv = "lights,method,from_deg,to_deg,images,rmse,dssim\n";
  const auto number = [](const std::optional<double>& value) { return value ? core::number_text(*value) : ""; };
  for (const JudgedStage& stage : report.stages) {
    for (const MethodScore& score : stage.scores) {
      for (const model::AngleBin& bin : score.by_angle) {
        csv += std::to_string(stage.lights) + "," + csv_field(score.name) + "," + core::number_text(bin.from_deg) +
               "," + core::number_text(bin.to_deg) + "," + std::to_string(bin.images) + "," + number(bin.rmse) + "," +
               number(bin.dssim) + "\n";
      }
    }
  }
  return csv;
}

// A table's cells may hold no bars.
std::string markdown_row(const std::vector<std::string>& cells) {
  std::string row = "|";
  for (const std::string& cell : cells) {
    row += ' ';
    for (const char c : cell) row += c == '|' ? std::string("\\|") : std::string(1, c);
    row += " |";
  }
  return row + "\n";
}

// Who was best on each stage, in words.
std::vector<std::string> rankings(const Report& report) {
  std::vector<std::string> all;
  for (const JudgedStage& stage : report.stages) {
    const std::string best = best_in_words(best_methods(stage.scores, report.own_metric), report.own_metric);
    const std::string where = report.stages.size() > 1 ? std::to_string(stage.lights) + " lights: " : "";
    if (!best.empty()) all.push_back(where + best);
  }
  return all;
}

std::string markdown(const Report& report) {
  std::string text = "# " + report.scan + ", " + report.protocol + "\n\n" + values_named(report) + ".";
  for (const std::string& note : report.stages.front().protocol.notes) text += " " + note;
  text += "\n\n";
  const auto rows = report_rows(report);
  text += markdown_row(rows.front()) + markdown_row(std::vector<std::string>(rows.front().size(), "---"));
  for (std::size_t r = 1; r < rows.size(); ++r) text += markdown_row(rows[r]);
  for (const std::string& ranking : rankings(report)) text += "\n" + ranking + ".\n";
  return text;
}

}  // namespace

std::string csv_field(const std::string& text) {
  if (text.find_first_of(",\"\n\r") == std::string::npos) return text;
  std::string quoted = "\"";
  for (const char c : text) quoted += c == '"' ? std::string("\"\"") : std::string(1, c);
  return quoted + "\"";
}

std::vector<std::vector<std::string>> report_rows(const Report& report) {
  std::vector<std::vector<std::string>> all;
  for (const JudgedStage& stage : report.stages) {
    auto rows = score_rows(stage.scores, report.own_metric);
    for (std::size_t r = all.empty() ? 0 : 1; r < rows.size(); ++r) {
      if (report.stages.size() > 1)
        rows[r].insert(rows[r].begin() + 1, r == 0 ? "lights" : std::to_string(stage.lights));
      all.push_back(rows[r]);
    }
  }
  return all;
}

void write_report(const fs::path& folder, const Report& report) {
  core::write_file_atomically(folder / "report.json", json_text(report.json) + "\n");
  core::write_file_atomically(folder / "report.csv", scores_csv(report));
  core::write_file_atomically(folder / "by_angle.csv", angles_csv(report));
  core::write_file_atomically(folder / "report.md", markdown(report));

  HtmlPage page("'" + report.scan + "', " + report.protocol);
  page.paragraph(values_named(report) + "; lower is better, but for MS-SSIM.");
  for (const std::string& note : report.stages.front().protocol.notes) page.paragraph(note);
  page.table(report_rows(report));
  for (const std::string& ranking : rankings(report)) page.paragraph(ranking + ".");
  const auto plot = [&](const std::string& file, const std::string& caption, const std::string& svg) {
    core::write_file_atomically(folder / file, svg);
    page.figures({{file, caption}});
  };
  page.heading("Where errors come from");
  const JudgedStage& fewest = report.stages.back();
  if (report.stages.size() > 1) {
    plot("error_by_lights.svg", "Error against the number of lights", lights_plot(report.stages));
  }
  const std::string on_stage = report.stages.size() > 1 ? ", of " + std::to_string(fewest.lights) + " lights" : "";
  plot("error_by_angle.svg", "Error against the angle to the nearest light" + on_stage, angle_plot(fewest.scores));
  plot("error_by_time.svg", "Error against the time an image takes" + on_stage, time_plot(fewest.scores));

  page.heading("Where methods differ most" + on_stage);
  core::note("rendering crops");
  std::vector<HtmlPage::Figure> figures;
  for (const CropSheet& crop : crops_where_methods_differ(fewest, report.linear_values, kCropSheets)) {
    const std::string file = "crops_" + std::to_string(figures.size() + 1) + ".png";
    core::write_image(folder / file, crop.sheet, {.encoding = core::Encoding::kLinear});
    figures.push_back({file, crop.caption});
  }
  page.figures(figures);
  core::write_file_atomically(folder / "index.html", page.finish());
}

}  // namespace lightstage::cli
