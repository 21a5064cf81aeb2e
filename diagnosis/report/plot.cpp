#include "diagnosis/report/plot.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <limits>
#include <stdexcept>

#include "diagnosis/statistics/text.h"

namespace servotwin {

namespace {

// All in px.
constexpr double kWidth = 560.0, kHeight = 380.0;              // of a panel side by side
constexpr double kRowWidth = 860.0, kRowHeight = 190.0;        // of a panel in a row of its own
constexpr double kLeft = 64.0, kRight = 16.0, kBottom = 48.0;  // margins of a panel
constexpr double kTickLabels = 24.0;    // bottom margin of a panel without a label of x
constexpr double kTickDistance = 96.0;  // least distance of ticks where there are more than six
constexpr double kTitle = 20.0;         // y of the baseline of the title
constexpr double kLine = 18.0;          // distance between lines of text
constexpr double kLetter = 7.4;         // about the width of a letter
constexpr std::array<const char*, 6> kPalette = {"#3b7dd8", "#d9542b", "#2f9e58",
                                                 "#9b59b6", "#c79a1b", "#6b7785"};

/// One axis of a panel: converts a value to a coordinate [px].
struct Scale {
  double low = 0.0, high = 1.0;  // range of values; of log10(value) where logarithmic
  double begin = 0.0, end = 1.0;
  bool logarithmic = false;

  [[nodiscard]] double at(double value) const {
    const double v = logarithmic ? std::log10(value) : value;
    return begin + (v - low) / (high - low) * (end - begin);
  }
  [[nodiscard]] std::vector<double> ticks() const {
    std::vector<double> out;
    if (logarithmic) {
      const bool fine = high - low < 2.0;
      for (double e = std::floor(low); e <= high + 1e-9; e += 1.0) {
        for (const double factor : {1.0, 2.0, 5.0}) {
          const double place = e + std::log10(factor);
          if (place < low - 1e-9 || place > high + 1e-9 || (factor > 1.0 && !fine)) continue;
          out.push_back(factor * std::pow(10.0, e));
        }
      }
      return out;
    }
    const double intervals = std::max(5.0, std::abs(end - begin) / kTickDistance);
    const double rough = (high - low) / intervals;
    const double decade = std::pow(10.0, std::floor(std::log10(rough)));
    double step = 10.0 * decade;
    for (const double factor : {5.0, 2.0, 1.0}) {
      if (factor * decade >= rough) step = factor * decade;
    }
    const double first = std::ceil(low / step);
    for (int i = 0; i < 20 && (first + i) * step <= high + 1e-9 * step; ++i)
      out.push_back((first + i) * step);
    return out;
  }
};

bool shown(const PlotPanel& panel, double x, double y) {
  return std::isfinite(x) && std::isfinite(y) && (!panel.logarithmic_x || x > 0.0) &&
         (!panel.logarithmic_y || y > 0.0);
}

struct Place {
  double x = 0.0, y = 0.0;
};

/// The part of the picture that a panel fills.
struct Frame {
  double left = 0.0, top = 0.0, width = 0.0, height = 0.0;
};

/// Positions of the legend entries: line by line under the title.
std::vector<Place> legend_of(const PlotPanel& panel, const Frame& frame) {
  std::vector<Place> places;
  const double left = frame.left + kLeft, right = frame.left + frame.width - kRight;
  Place next{left, frame.top + kTitle + (panel.title.empty() ? 0.0 : kLine)};
  for (const PlotSeries& s : panel.series) {
    if (s.name.empty()) continue;
    const double width = 26.0 + kLetter * static_cast<double>(s.name.size());
    if (next.x > left && next.x + width > right) next = {left, next.y + kLine};
    places.push_back(next);
    next.x += width;
  }
  return places;
}

/// The points of a series that are drawn. Of the points of a line that follow each other within one
/// column of pixels only the first, lowest, highest and last are visible; the others would make the
/// file of a long recording large.
std::vector<std::size_t> drawn_points(const PlotPanel& panel, const PlotSeries& s, const Scale& x) {
  std::vector<std::size_t> out;
  const std::size_t size = std::min(s.x.size(), s.y.size());
  for (std::size_t i = 0, next = 0; i < size; i = next) {
    std::size_t low = i, high = i;
    next = i + 1;
    if (s.line && s.error.empty() && shown(panel, s.x[i], s.y[i])) {
      for (const double column = std::floor(x.at(s.x[i]));
           next < size && shown(panel, s.x[next], s.y[next]) &&
           std::floor(x.at(s.x[next])) == column;
           ++next) {
        if (s.y[next] < s.y[low]) low = next;
        if (s.y[next] > s.y[high]) high = next;
      }
    }
    for (const std::size_t k : {i, std::min(low, high), std::max(low, high), next - 1}) {
      if (out.empty() || k > out.back()) out.push_back(k);
    }
  }
  return out;
}

std::string panel_svg(const PlotPanel& panel, const Frame& frame) {
  const std::vector<Place> legend = legend_of(panel, frame);
  Scale x, y;
  x.logarithmic = panel.logarithmic_x;
  y.logarithmic = panel.logarithmic_y;
  x.low = y.low = std::numeric_limits<double>::infinity();
  x.high = y.high = -x.low;
  for (const PlotSeries& s : panel.series) {
    for (std::size_t i = 0; i < std::min(s.x.size(), s.y.size()); ++i) {
      if (!shown(panel, s.x[i], s.y[i])) continue;
      const double place = x.logarithmic ? std::log10(s.x[i]) : s.x[i];
      x.low = std::min(x.low, place);
      x.high = std::max(x.high, place);
      const double bar = i < s.error.size() && std::isfinite(s.error[i]) ? s.error[i] : 0.0;
      const double low = s.y[i] - bar > 0.0 ? s.y[i] - bar : s.y[i];
      y.low = std::min(y.low, y.logarithmic ? std::log10(low) : s.y[i] - bar);
      y.high = std::max(y.high, y.logarithmic ? std::log10(s.y[i] + bar) : s.y[i] + bar);
    }
  }
  if (!(x.low <= x.high)) throw std::invalid_argument("plot '" + panel.title + "' has no points");
  for (Scale* scale : {&x, &y}) {
    // A range as small as the rounding of its values would have no ticks: it is widened.
    const double size = std::max(std::abs(scale->low), std::abs(scale->high));
    const double margin = scale->high - scale->low > 1e-9 * size
                              ? 0.05 * (scale->high - scale->low)
                              : 0.5 * std::max(1e-12, std::abs(scale->low));
    scale->low -= margin;
    scale->high += margin;
  }
  const double bottom = frame.top + frame.height;
  x.begin = frame.left + kLeft;
  x.end = frame.left + frame.width - kRight;
  y.begin = bottom - (panel.x_label.empty() ? kTickLabels : kBottom);
  y.end = (!legend.empty()       ? legend.back().y
           : panel.title.empty() ? frame.top
                                 : frame.top + kTitle) +
          12.0;

  std::string out;
  const auto label = [&](double px, double py, const char* anchor, const std::string& words,
                         const char* more = "") {
    out += text("<text x='%.1f' y='%.1f' text-anchor='%s' %s>", px, py, anchor, more) +
           escaped(words) + "</text>\n";
  };
  const auto rule = [&](double x1, double y1, double x2, double y2) {
    out += text("<line class='grid' x1='%.1f' y1='%.1f' x2='%.1f' y2='%.1f'/>\n", x1, y1, x2, y2);
  };
  label(frame.left + frame.width / 2.0, frame.top + kTitle, "middle", panel.title, "class='title'");
  for (const double v : x.ticks()) {
    rule(x.at(v), y.begin, x.at(v), y.end);
    label(x.at(v), y.begin + 16.0, "middle", text("%.4g", v));
  }
  for (const double v : y.ticks()) {
    rule(x.begin, y.at(v), x.end, y.at(v));
    label(x.begin - 6.0, y.at(v) + 4.0, "end", text("%.4g", v));
  }
  label((x.begin + x.end) / 2.0, bottom - 10.0, "middle", panel.x_label);
  const double middle = (y.begin + y.end) / 2.0;
  label(frame.left + 16.0, middle, "middle", panel.y_label,
        text("transform='rotate(-90 %.1f %.1f)'", frame.left + 16.0, middle).c_str());

  for (const double v : panel.marks) {
    if (const double place = x.at(v); place >= x.begin && place <= x.end)
      out += text("<line class='mark' x1='%.1f' y1='%.1f' x2='%.1f' y2='%.1f'/>\n", place, y.begin,
                  place, y.end);
  }

  std::size_t next = 0, entry = 0;
  for (const PlotSeries& s : panel.series) {
    const std::string colour = s.colour.empty() ? plot_colour(next++) : s.colour;
    std::string points, above, below;  // of a line up to its next gap, and of its error band
    const auto end_line = [&] {
      if (!above.empty()) {
        out +=
            "<polygon fill='" + colour + "' fill-opacity='.2' points='" + above + below + "'/>\n";
      }
      above.clear();
      below.clear();
      if (!points.empty()) {
        out += "<polyline fill='none' stroke='" + colour + "' stroke-width='" +
               (s.dashed ? "2' stroke-dasharray='6 4" : "1.5") + "' points='" + points + "'/>\n";
      }
      points.clear();
    };
    for (const std::size_t i : drawn_points(panel, s, x)) {
      if (!shown(panel, s.x[i], s.y[i])) {
        end_line();
      } else if (s.line) {
        points += text("%.1f,%.1f ", x.at(s.x[i]), y.at(s.y[i]));
        if (i < s.error.size() && std::isfinite(s.error[i])) {
          const double low = s.y[i] - s.error[i];
          const double foot = y.logarithmic && low <= 0.0 ? y.begin : y.at(low);
          above += text("%.1f,%.1f ", x.at(s.x[i]), y.at(s.y[i] + s.error[i]));
          below.insert(0, text("%.1f,%.1f ", x.at(s.x[i]), std::min(foot, y.begin)));
        }
      } else {
        if (i < s.error.size() && s.error[i] > 0.0)
          out += text("<line x1='%.1f' y1='%.1f' x2='%.1f' y2='%.1f' ", x.at(s.x[i]),
                      y.at(s.y[i] - s.error[i]), x.at(s.x[i]), y.at(s.y[i] + s.error[i])) +
                 "stroke='" + colour + "' stroke-opacity='.6'/>\n";
        out += text("<circle r='2.6' cx='%.1f' cy='%.1f' ", x.at(s.x[i]), y.at(s.y[i])) + "fill='" +
               colour + "'/>\n";
      }
    }
    end_line();
    if (s.name.empty()) continue;
    const Place& at = legend[entry++];
    out += text("<rect x='%.1f' y='%.1f' width='10' height='10' ", at.x, at.y - 9.0) + "fill='" +
           colour + "'/>\n";
    label(at.x + 14.0, at.y, "start", s.name);
  }
  return out;
}

/// An SVG element of this size around the panels.
std::string svg_of(double width, double height, const std::string& panels) {
  return text(
             "<svg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 %.0f %.0f' width='%.0f' "
             "height='%.0f'>\n",
             width, height, width, height) +
         "<style>svg{background:#fff}text{font:12px sans-serif;fill:#222}.title{font-weight:bold;"
         "font-size:13px}.grid{stroke:#888;stroke-opacity:.25}.mark{"
         "stroke:#888;stroke-dasharray:2 3}@media(prefers-color-scheme:dark){svg{"
         "background:#16181c}text{fill:#ddd}}</style>\n" +
         panels + "</svg>\n";
}

}  // namespace

const char* plot_colour(std::size_t place) { return kPalette[place % kPalette.size()]; }

std::string plot_svg(const std::vector<PlotPanel>& panels) {
  std::string out;
  double left = 0.0;
  for (const PlotPanel& panel : panels) {
    out += panel_svg(panel, {left, 0.0, kWidth, kHeight});
    left += kWidth;
  }
  return svg_of(left, kHeight, out);
}

std::string plot_rows_svg(const std::vector<PlotPanel>& panels) {
  std::string out;
  double top = 0.0;
  for (const PlotPanel& panel : panels) {
    out += panel_svg(panel, {0.0, top, kRowWidth, kRowHeight});
    top += kRowHeight;
  }
  return svg_of(kRowWidth, top, out);
}

}  // namespace servotwin
