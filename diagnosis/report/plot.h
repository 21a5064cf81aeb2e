// Plots as SVG: panels side by side or in rows. Each panel has points and lines over one pair of
// axes, ticks at round numbers, a grid and a legend. The SVG is self-contained and readable on
// light and dark pages. Values that are not finite leave a gap in a line. A long line is drawn with
// at most four points per column of pixels, its extremes among them. Any thread. Errors:
// std::invalid_argument for a panel without a finite point.
#pragma once

#include <string>
#include <vector>

namespace servotwin {

struct PlotSeries {
  std::string name;  ///< in the legend; empty: not in the legend
  std::vector<double> x, y;
  bool line = true;    ///< false: points
  std::string colour;  ///< empty: the next colour of the palette
  /// Half the length of the error bar at each point, or half the height of the error band at each
  /// point of a line, in units of y; empty: none.
  std::vector<double> error = {};
  bool dashed = false;  ///< draws the line dashed
};

struct PlotPanel {
  std::string title, x_label, y_label;  ///< labels with their units; empty: none
  bool logarithmic_x = false;           ///< logarithmic axis: only x > 0 is shown
  std::vector<PlotSeries> series;
  std::vector<double> marks = {};  ///< values of x marked by a dotted vertical line
  bool logarithmic_y = false;      ///< logarithmic axis: only y > 0 is shown
};

/// The colour of this place in the palette, which repeats from its start.
[[nodiscard]] const char* plot_colour(std::size_t place);

/// The panels as one SVG element, from left to right.
[[nodiscard]] std::string plot_svg(const std::vector<PlotPanel>& panels);
/// The panels as one SVG element, one below the other, as wide as a page and low: for what happens
/// over time.
[[nodiscard]] std::string plot_rows_svg(const std::vector<PlotPanel>& panels);

}  // namespace servotwin
