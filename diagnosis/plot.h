// Plots as SVG: panels side by side, each with points and lines over one pair of axes with ticks at
// round numbers, a grid and a legend. One self-contained file, readable on light and dark pages.
// Values that are not finite leave a gap. Any thread. Errors: std::invalid_argument for a panel
// without a finite point.
#pragma once

#include <string>
#include <vector>

namespace servotwin {

struct PlotSeries {
  std::string name;  ///< in the legend; empty: not there
  std::vector<double> x, y;
  bool line = true;    ///< false: points
  std::string colour;  ///< empty: the next of the palette
  /// Half the length of a bar at each point, or half the height of a band about a line; empty:
  /// none.
  std::vector<double> error = {};
  bool dashed = false;  ///< a line of dashes
};

struct PlotPanel {
  std::string title, x_label, y_label;  ///< labels with their units
  bool logarithmic_x = false;           ///< then only x > 0 is shown
  std::vector<PlotSeries> series;
  std::vector<double> marks = {};  ///< places in x that a vertical line shows
  bool logarithmic_y = false;      ///< then only y > 0 is shown
};

/// The palette, from its first colour on and over again.
[[nodiscard]] const char* plot_colour(std::size_t place);

[[nodiscard]] std::string plot_svg(const std::vector<PlotPanel>& panels);

}  // namespace servotwin
