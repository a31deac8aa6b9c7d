#include "cli/report/plot.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "cli/format.h"
#include "cli/report/html.h"
#include "core/text.h"

namespace lightstage::cli {

namespace {

constexpr double kPanelWidth = 460, kPanelHeight = 330;
constexpr double kLeft = 70, kRight = 16, kTop = 34, kBottom = 52;  // margins around a panel's axes
constexpr double kLegendEntry = 150, kLegendLine = 22;              // an entry is wider where a name is long
constexpr const char* kGrey = "#999999";
constexpr std::array<const char*, 10> kColours{"#1f77b4", "#d62728", "#2ca02c", "#ff7f0e", "#9467bd",
                                               "#8c564b", "#e377c2", "#17becf", "#bcbd22", "#333333"};

std::string number(double value) {
  std::string text = fixed(value, 1);
  return text == "-0.0" ? "0.0" : text;
}

std::string text_at(double x, double y, const std::string& anchor, const std::string& words,
                    const std::string& more = {}) {
  return "<text x=\"" + number(x) + "\" y=\"" + number(y) + "\" text-anchor=\"" + anchor + "\"" + more + ">" +
         html_escaped(words) + "</text>\n";
}

constexpr const char* kDashes = " stroke-dasharray=\"6 4\"";

std::string line(double x1, double y1, double x2, double y2, const std::string& colour, const std::string& more = {}) {
  return "<line x1=\"" + number(x1) + "\" y1=\"" + number(y1) + "\" x2=\"" + number(x2) + "\" y2=\"" + number(y2) +
         "\" stroke=\"" + colour + "\"" + more + "/>\n";
}

// Where values of an axis lie between 0 and 1.
class Scale {
 public:
  Scale(const PlotAxis& axis, const std::vector<double>& values) : logarithmic_(axis.logarithmic) {
    double lowest = std::numeric_limits<double>::infinity(), highest = -lowest;
    for (const double value : values) {
      if (!drawable(value)) continue;
      lowest = std::min(lowest, value);
      highest = std::max(highest, value);
    }
    empty_ = lowest > highest;
    if (empty_) lowest = highest = 1;
    if (logarithmic_) {
      const double air = std::max(0.05, 0.06 * std::log10(highest / lowest));
      low_ = std::log10(lowest) - air;
      high_ = std::log10(highest) + air;
    } else {
      low_ = std::min(0.0, lowest);
      high_ = highest > low_ ? highest + 0.05 * (highest - low_) : low_ + 1;
    }
  }

  bool empty() const { return empty_; }
  bool drawable(double value) const { return std::isfinite(value) && (!logarithmic_ || value > 0); }
  double at(double value) const { return ((logarithmic_ ? std::log10(value) : value) - low_) / (high_ - low_); }

  std::vector<double> ticks() const { return logarithmic_ ? logarithmic_ticks() : even_ticks(low_, high_); }

 private:
  // Multiples of 1, 2 or 5 times a power of ten, about six of them.
  static std::vector<double> even_ticks(double low, double high) {
    const double rough = (high - low) / 6, power = std::pow(10, std::floor(std::log10(rough)));
    double step = 10 * power;
    for (const double factor : {5.0, 2.0, 1.0}) {
      if (factor * power >= rough) step = factor * power;
    }
    std::vector<double> ticks;
    for (double i = std::ceil(low / step - 1e-9); i * step <= high * (1 + 1e-12); ++i)
      ticks.push_back(i * step + 0.0);  // no -0
    return ticks;
  }

  std::vector<double> logarithmic_ticks() const {
    constexpr double kDecadesForDigits = 2.5, kDecadesForPowers = 0.7;
    if (high_ - low_ < kDecadesForPowers) return even_ticks(std::pow(10, low_), std::pow(10, high_));
    std::vector<double> ticks;
    for (double power = std::floor(low_); power <= high_; ++power) {
      for (const double digit : {1.0, 2.0, 5.0}) {
        const double exponent = power + std::log10(digit);
        if (digit > 1 && high_ - low_ > kDecadesForDigits) continue;
        if (exponent >= low_ && exponent <= high_) ticks.push_back(digit * std::pow(10, power));
      }
    }
    return ticks;
  }

  bool logarithmic_, empty_ = false;
  double low_ = 0, high_ = 1;  // of logarithms where it is logarithmic
};

// How series of a name look.
struct Look {
  std::string colour;
  std::size_t shape = 0;
};

std::string marker(const Look& look, double x, double y, const std::string& label) {
  constexpr double kSize = 4.5;
  const auto point = [&](double dx, double dy) { return number(x + dx * kSize) + "," + number(y + dy * kSize) + " "; };
  const std::string style = " fill=\"" + look.colour + "\" stroke=\"#ffffff\" stroke-width=\"0.8\"";
  const std::string title = label.empty() ? "" : "<title>" + html_escaped(label) + "</title>";
  if (look.shape == 0) {
    return "<circle cx=\"" + number(x) + "\" cy=\"" + number(y) + "\" r=\"" + number(kSize) + "\"" + style + ">" +
           title + "</circle>\n";
  }
  std::string corners;
  if (look.shape == 1) corners = point(-1, -1) + point(1, -1) + point(1, 1) + point(-1, 1);
  if (look.shape == 2) corners = point(0, -1.2) + point(1.1, 0.9) + point(-1.1, 0.9);
  if (look.shape == 3) corners = point(0, -1.3) + point(1.3, 0) + point(0, 1.3) + point(-1.3, 0);
  corners.pop_back();
  return "<polygon points=\"" + corners + "\"" + style + ">" + title + "</polygon>\n";
}

// Of a column of the legend: the width of the longest name, as wide as letters of 12 pixels are, and its mark.
double legend_entry(const std::vector<std::string>& names) {
  constexpr double kLetter = 6.8, kMark = 40;
  double width = kLegendEntry;
  for (const std::string& name : names) width = std::max(width, kMark + kLetter * double(name.size()));
  return width;
}

// Names in the order of their first series.
std::vector<std::string> legend_names(const std::vector<PlotPanel>& panels) {
  std::vector<std::string> names;
  for (const PlotPanel& panel : panels) {
    for (const PlotSeries& series : panel.series) {
      if (std::find(names.begin(), names.end(), series.name) == names.end()) names.push_back(series.name);
    }
  }
  return names;
}

Look look_of(const PlotSeries& series, const std::vector<std::string>& names) {
  if (series.backdrop) return {.colour = kGrey};
  const std::size_t i = std::size_t(std::find(names.begin(), names.end(), series.name) - names.begin());
  return {.colour = kColours[i % kColours.size()], .shape = i % 4};
}

class Panel {
 public:
  Panel(const PlotPanel& panel, double left, double top)
      : panel_(panel), left_(left), top_(top), x_(panel.x, all(&PlotPoint::x)), y_(panel.y, all(&PlotPoint::y)) {}

  std::string svg(const std::vector<std::string>& names) const {
    std::string svg = axes();
    if (x_.empty() || y_.empty()) svg += text_at((x0() + x1()) / 2, (y0() + y1()) / 2, "middle", "no values");
    for (const bool backdrop : {true, false}) {
      for (const PlotSeries& series : panel_.series) {
        if (series.backdrop == backdrop) svg += curve(series, look_of(series, names));
      }
    }
    return svg;
  }

 private:
  double x0() const { return left_ + kLeft; }
  double x1() const { return left_ + kPanelWidth - kRight; }
  double y0() const { return top_ + kTop; }
  double y1() const { return top_ + kPanelHeight - kBottom; }
  double x(double value) const { return x0() + x_.at(value) * (x1() - x0()); }
  double y(double value) const { return y1() - y_.at(value) * (y1() - y0()); }

  std::vector<double> all(double PlotPoint::*coordinate) const {
    std::vector<double> values;
    for (const PlotSeries& series : panel_.series) {
      for (const PlotPoint& point : series.points) values.push_back(point.*coordinate);
    }
    return values;
  }

  std::string axes() const {
    constexpr const char *kGrid = "#e4e4e4", *kFrame = "#444444";
    std::string svg = text_at((x0() + x1()) / 2, top_ + 20, "middle", panel_.title, " font-weight=\"600\"");
    for (const double tick : x_.ticks()) {
      svg +=
          line(x(tick), y0(), x(tick), y1(), kGrid) + text_at(x(tick), y1() + 17, "middle", core::number_text(tick, 4));
    }
    for (const double tick : y_.ticks()) {
      svg +=
          line(x0(), y(tick), x1(), y(tick), kGrid) + text_at(x0() - 7, y(tick) + 4, "end", core::number_text(tick, 4));
    }
    svg += line(x0(), y1(), x1(), y1(), kFrame) + line(x0(), y0(), x0(), y1(), kFrame);
    svg += text_at((x0() + x1()) / 2, y1() + 38, "middle", panel_.x.label);
    const double middle = (y0() + y1()) / 2, side = left_ + 16;
    return svg + text_at(side, middle, "middle", panel_.y.label,
                         " transform=\"rotate(-90 " + number(side) + " " + number(middle) + ")\"");
  }

  std::string curve(const PlotSeries& series, const Look& look) const {
    std::string corners, markers;
    for (const PlotPoint& point : series.points) {
      if (!x_.drawable(point.x) || !y_.drawable(point.y)) continue;
      corners += (corners.empty() ? "" : " ") + number(x(point.x)) + "," + number(y(point.y));
      if (series.markers) markers += marker(look, x(point.x), y(point.y), point.label);
    }
    if (!series.line || corners.empty()) return markers;
    return "<polyline points=\"" + corners + "\" fill=\"none\" stroke=\"" + look.colour + "\" stroke-width=\"1.8\"" +
           (series.backdrop ? kDashes : "") + "/>\n" + markers;
  }

  const PlotPanel& panel_;
  double left_, top_;
  Scale x_, y_;
};

}  // namespace

std::string svg_plots(const std::vector<PlotPanel>& panels, int columns) {
  const std::size_t per_row = std::size_t(std::max(1, columns));
  const std::size_t rows = (panels.size() + per_row - 1) / per_row;
  const double width = kPanelWidth * double(std::min(per_row, std::max<std::size_t>(1, panels.size())));
  const std::vector<std::string> names = legend_names(panels);
  const double entry = legend_entry(names);
  const std::size_t a_line = std::max<std::size_t>(1, std::size_t((width - kLeft) / entry));
  const double legend_height = kLegendLine * double((names.size() + a_line - 1) / a_line) + 12;
  const double height = kPanelHeight * double(rows) + legend_height;

  std::string svg = "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"" + number(width) + "\" height=\"" +
                    number(height) + "\" viewBox=\"0 0 " + number(width) + " " + number(height) +
                    "\" font-family=\"system-ui,sans-serif\" font-size=\"12\" fill=\"#222222\">\n"
                    "<rect width=\"100%\" height=\"100%\" fill=\"#ffffff\"/>\n";
  for (std::size_t i = 0; i < panels.size(); ++i) {
    svg += Panel(panels[i], kPanelWidth * double(i % per_row), kPanelHeight * double(i / per_row)).svg(names);
  }
  for (std::size_t i = 0; i < names.size(); ++i) {
    const double x = kLeft + entry * double(i % a_line);
    const double y = kPanelHeight * double(rows) + kLegendLine * (double(i / a_line) + 0.5);
    for (const PlotPanel& panel : panels) {
      const auto series = std::find_if(panel.series.begin(), panel.series.end(),
                                       [&](const PlotSeries& candidate) { return candidate.name == names[i]; });
      if (series == panel.series.end()) continue;
      const Look look = look_of(*series, names);
      if (series->line) svg += line(x - 10, y, x + 10, y, look.colour, series->backdrop ? kDashes : "");
      if (series->markers) svg += marker(look, x, y, {});
      break;
    }
    svg += text_at(x + 16, y + 4, "start", names[i]);
  }
  return svg + "</svg>\n";
}

}  // namespace lightstage::cli
