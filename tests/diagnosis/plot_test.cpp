// Plots: positions and elements of the SVG.
#include "diagnosis/report/plot.h"

#include <gmock/gmock.h>

#include <cmath>
#include <regex>
#include <string>

namespace servotwin {
namespace {

using testing::HasSubstr;
using testing::Not;

int count(const std::string& text, const std::string& pattern) {
  const std::regex regex(pattern);
  return static_cast<int>(
      std::distance(std::sregex_iterator(text.begin(), text.end(), regex), std::sregex_iterator()));
}

PlotPanel panel() {
  return {"a < b", "x [mm]", "y [N]", false, {{"points", {0.0, 10.0}, {1.0, 3.0}, false, ""}}};
}

TEST(Plot, PutsPointsWhereTheirValuesAre) {
  const std::string svg = plot_svg({panel()});
  // 5 % of margin on each side of the area from 64 to 544.
  EXPECT_THAT(svg, HasSubstr("cx='85.8'"));
  EXPECT_THAT(svg, HasSubstr("cx='522.2'"));
  EXPECT_THAT(svg, HasSubstr("a &lt; b"));
  EXPECT_EQ(count(svg, "<circle"), 2);
}

TEST(Plot, AGapBreaksALineAndALogarithmicAxisHasNoPlaceForZero) {
  PlotPanel p = panel();
  p.logarithmic_x = true;
  p.series = {{"line",
               {0.0, 1.0, 10.0, 20.0, 30.0, 100.0},
               {9.0, 1.0, 2.0, std::nan(""), 3.0, 4.0},
               true,
               ""}};
  const std::string svg = plot_svg({p, p});
  EXPECT_EQ(count(svg, "<polyline"), 4);  // two parts in each of two panels
  EXPECT_THAT(svg, HasSubstr(">10</text>"));
  EXPECT_THAT(svg, Not(HasSubstr("nan")));
  EXPECT_THAT(svg, Not(HasSubstr("inf")));
}

TEST(Plot, ALineHasItsErrorAsABandThatAGapBreaks) {
  PlotPanel p = panel();
  p.series = {{"line",
               {0.0, 5.0, 10.0, 15.0, 20.0},
               {1.0, 2.0, std::nan(""), 2.0, 1.0},
               true,
               "",
               {0.5, 0.5, 0.5, 1.0, std::nan("")}}};
  const std::string svg = plot_svg({p});
  EXPECT_EQ(count(svg, "<polygon"), 2);
  // From 0.5 to 3: 1 + 0.5 and 1 - 0.5 at the first point, 5 % of margin below.
  std::smatch found;
  ASSERT_TRUE(std::regex_search(svg, found,
                                std::regex("points='85.8,([0-9.]+) [0-9., ]+ 85.8,([0-9.]+) '")));
  const double high = std::stod(found[1]), low = std::stod(found[2]);
  EXPECT_NEAR(low, 332.0 - (332.0 - 50.0) * 0.125 / 2.75, 0.1);
  EXPECT_NEAR((low - high) / (332.0 - 50.0), 1.0 / 2.75, 1e-3);
}

TEST(Plot, ALongLineKeepsItsExtremesInAFewPointsPerPixel) {
  PlotPanel p = panel();
  PlotSeries line{"line", {}, {}, true, ""};
  for (int k = 0; k <= 100000; ++k) {
    line.x.push_back(k);
    line.y.push_back(k == 40001 ? 1000.0 : k == 40002 ? -1000.0 : std::sin(k));
  }
  p.series = {line};
  const std::string svg = plot_svg({p});
  EXPECT_LT(count(svg, "[0-9.]+,[0-9.]+ "), 4 * 480);
  // 5 % of margin above and below the area from 50 to 332.
  EXPECT_EQ(count(svg, ",62\\.8 "), 1);
  EXPECT_EQ(count(svg, ",319\\.2 "), 1);
}

TEST(Plot, RowsAreOneBelowTheOther) {
  PlotPanel p = panel();
  p.title.clear();
  const std::string svg = plot_rows_svg({p, p});
  EXPECT_THAT(svg, HasSubstr("viewBox='0 0 860 380'"));
  // Each 190 high, with its area from 32 to 142 in it and 5 % of margin.
  for (const char* y : {"cy='137.0'", "cy='37.0'", "cy='327.0'", "cy='227.0'"})
    EXPECT_THAT(svg, HasSubstr(y));
}

TEST(Plot, AFlatLineStillHasAnAxis) {
  PlotPanel p = panel();
  p.series = {{"", {1.0, 1.0}, {0.0, 0.0}, true, ""}};
  const std::string svg = plot_svg({p});
  EXPECT_THAT(svg, Not(HasSubstr("nan")));
  EXPECT_THAT(svg, Not(HasSubstr("<rect")));  // no name, no legend
}

TEST(Plot, RefusesAPanelWithoutPoints) {
  PlotPanel p = panel();
  p.series = {{"line", {std::nan("")}, {1.0}, true, ""}};
  EXPECT_THROW((void)plot_svg({p}), std::invalid_argument);
}

}  // namespace
}  // namespace servotwin
