// Plots as SVG files: points and lines over linear or logarithmic axes, with ticks and a legend.
#pragma once

#include <string>
#include <vector>

namespace lightstage::cli {

struct PlotAxis {
  std::string label;
  bool logarithmic =
      false;  // values that are not > 0 are left out; otherwise the axis begins at 0 unless a value is negative
};

struct PlotPoint {
  double x = 0, y = 0;
  std::string label;  // shown where the pointer rests on the point
};

struct PlotSeries {
  std::string name;  // in the legend; series of one name, in any panel, share colour and shape
  std::vector<PlotPoint> points;
  bool line = true;       // points joined in the order given
  bool markers = true;    // a mark at each point
  bool backdrop = false;  // drawn dashed and grey below the others: a front, a reference
};

struct PlotPanel {
  std::string title;
  PlotAxis x, y;
  std::vector<PlotSeries> series;
};

// The panels in rows of `columns`, with one legend for all. Points that are not finite are left out; a panel without points says so. Every text is
// escaped. The same plot for the same values.
std::string svg_plots(const std::vector<PlotPanel>& panels, int columns);

}  // namespace lightstage::cli
