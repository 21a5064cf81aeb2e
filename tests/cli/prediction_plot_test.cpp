// The plots of servotwin predict and identify: what they draw, in the units of their axes.
#include <gmock/gmock.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>
#include <regex>
#include <sstream>
#include <string>
#include <vector>

#include "tests/cli/program.h"
#include "tests/cli/recordings.h"

namespace servotwin {
namespace {

using nlohmann::json;
using testing::ElementsAre;
using testing::HasSubstr;

constexpr double kRow_px = 190.0;  // height of a panel
constexpr const char *kMeasured = "#3b7dd8", *kPredicted = "#d9542b", *kResidual = "#2f9e58";

/// The parts of `text` that match, as their groups. For short matches: std::regex recurses for
/// every letter of one.
std::vector<std::smatch> matches(const std::string& text, const char* pattern) {
  const std::regex regex(pattern);
  return {std::sregex_iterator(text.begin(), text.end(), regex), std::sregex_iterator()};
}

/// The elements of an SVG without their content: "rect x='1' /".
std::vector<std::string> tags(const std::string& svg) {
  std::vector<std::string> out;
  for (std::size_t at = svg.find('<'); at != std::string::npos; at = svg.find('<', at + 1))
    out.push_back(svg.substr(at + 1, svg.find('>', at) - at - 1));
  return out;
}

/// Whether every element is closed in its order, and every attribute and entity is complete.
bool well_formed(const std::string& svg) {
  std::vector<std::string> open;
  for (const std::string& tag : tags(svg)) {
    const std::string name = tag.substr(0, tag.find(' '));
    if (std::count(tag.begin(), tag.end(), '\'') % 2 != 0) return false;
    if (tag.find('<') != std::string::npos || tag.empty()) return false;
    if (name.front() == '/') {
      if (open.empty() || "/" + open.back() != name) return false;
      open.pop_back();
    } else if (tag.back() != '/') {
      open.push_back(name);
    }
  }
  return open.empty() &&
         std::count(svg.begin(), svg.end(), '<') == std::count(svg.begin(), svg.end(), '>') &&
         matches(svg, "&").size() == matches(svg, "&(amp|lt|gt);").size();
}

struct Drawn {
  double x = 0.0, y = 0.0;  // as the ticks of its panel say
};

/// The points of the lines of this colour in a panel.
std::vector<Drawn> drawn(const std::string& svg, int panel, const std::string& colour) {
  const double top = kRow_px * panel;
  const auto here = [&](double y) { return y >= top && y < top + kRow_px; };
  // From px to a value: through the outermost ticks.
  const auto scale = [&](const char* anchor, std::size_t along, double shift) {
    std::map<double, double> ticks;
    for (const std::smatch& label : matches(
             svg,
             "<text x='([0-9.]+)' y='([0-9.]+)' text-anchor='([a-z]+)' >(-?[0-9.e+-]+)</text>")) {
      if (label[3] == anchor && here(std::stod(label[2])))
        ticks[std::stod(label[along]) - shift] = std::stod(label[4]);
    }
    EXPECT_GE(ticks.size(), 2U);
    const auto [first, first_value] = *ticks.begin();
    const auto [last, last_value] = *ticks.rbegin();
    return std::pair(first_value, std::pair(first, (last_value - first_value) / (last - first)));
  };
  const auto x = scale("middle", 1, 0.0), y = scale("end", 2, 4.0);
  std::vector<Drawn> out;
  for (const std::string& line : tags(svg)) {
    if (line.rfind("polyline fill='none' stroke='" + colour + "'", 0) != 0) continue;
    std::istringstream points(line.substr(line.find("points='") + 8));
    char comma = 0;
    for (double px = 0.0, py = 0.0; points >> px >> comma >> py;) {
      if (here(py))
        out.push_back({x.first + (px - x.second.first) * x.second.second,
                       y.first + (py - y.second.first) * y.second.second});
    }
  }
  return out;
}

double highest(const std::vector<Drawn>& points) {
  double out = -1e300;
  for (const Drawn& p : points) out = std::max(out, p.y);
  return out;
}
double lowest(const std::vector<Drawn>& points) {
  double out = 1e300;
  for (const Drawn& p : points) out = std::min(out, p.y);
  return out;
}
double largest(const std::vector<Drawn>& points) {
  return std::max(highest(points), -lowest(points));
}

class PredictionPlot : public testing::Test {
 protected:
  static constexpr int kRows = 12001, kPeak = 6206,
                       kPeakRows = 8;  // 1 kHz; 8 ms, within a pixel of 17 ms
  static constexpr double kPeak_mm = 2.0;

  void SetUp() override { write_model(model_, known_axis()); }

  /// An axis that follows 5 ms late, and once swings for 8 ms.
  static double command_mm(int k) { return 1e3 * rich_motion(k / 1000.0); }
  static double actual_mm(int k) {
    const double swing = k > kPeak && k < kPeak + kPeakRows
                             ? kPeak_mm * std::sin(M_PI * (k - kPeak) / kPeakRows)
                             : 0.0;
    return command_mm(std::max(0, k - 5)) - swing;
  }
  static double error_um(int k) { return 1e3 * (command_mm(k) - actual_mm(k)); }

  Folder folder_;
  std::string model_ = folder_ / "model.json", plot_ = folder_ / "plot.svg";
  std::string recording_ =
      folder_.write("rec.csv", recording(
                                   kRows, [](int k) { return cell(command_mm(k)); },
                                   [](int k) { return cell(actual_mm(k)); }));
};

TEST_F(PredictionPlot, DrawsMeasuredAndPredictedWithTheirExtremes) {
  const Answer answer =
      servotwin_says({"predict", recording_, "--model", model_, "--out", folder_ / "pred.csv",
                      "--json", folder_ / "pred.json", "--plot", plot_});
  ASSERT_EQ(answer.status, 0) << answer;
  const std::string svg = content_of(plot_);
  EXPECT_TRUE(well_formed(svg));
  EXPECT_LT(svg.size(), 250000U);  // of 12001 rows in four lines
  for (const char* label : {">axis X<", ">tracking error [um]<", ">residual [um]<",
                            ">command [mm]<", ">time [s]<", ">noise floor: "})
    EXPECT_THAT(svg, HasSubstr(label));

  std::vector<double> errors;
  for (int k = 0; k < kRows; ++k) errors.push_back(error_um(k));
  const auto most = std::max_element(errors.begin(), errors.end());
  const std::vector<Drawn> measured = drawn(svg, 0, kMeasured);
  constexpr double kRounding = 0.003;  // of the range of a panel: 0.1 px at each of three places
  const double range = *most - *std::min_element(errors.begin(), errors.end());
  EXPECT_NEAR(highest(measured), *most, kRounding * range);
  EXPECT_NEAR(lowest(measured), *most - range, kRounding * range);
  const auto peak = std::max_element(measured.begin(), measured.end(),
                                     [](const Drawn& l, const Drawn& r) { return l.y < r.y; });
  EXPECT_NEAR(peak->x, 1e-3 * static_cast<double>(most - errors.begin()), 0.02);
  EXPECT_NEAR(measured.back().x, 12.0, 0.02);

  // The table has a row per sample; the first quarter of a second may be left out of the plot.
  std::istringstream rows(content_of(folder_ / "pred.csv"));
  std::string row;
  std::getline(rows, row);
  ASSERT_THAT(row, testing::EndsWith("X.predicted_error[m],X.residual[m]"));
  double up = -1e300, down = 1e300;
  while (std::getline(rows, row)) {
    const std::size_t last = row.rfind(','), before = row.rfind(',', last - 1);
    up = std::max(up, 1e6 * std::stod(row.substr(before + 1)));
    down = std::min(down, 1e6 * std::stod(row.substr(before + 1)));
  }
  const std::vector<Drawn> predicted = drawn(svg, 0, kPredicted);
  EXPECT_NEAR(highest(predicted), up, kRounding * range);
  EXPECT_NEAR(lowest(predicted), down, kRounding * range);

  const double left = 1e6 * json::parse(content_of(folder_ / "pred.json"))["max_m"].get<double>();
  EXPECT_GT(left, 1e3);  // the swing, which no model predicts
  EXPECT_NEAR(largest(drawn(svg, 1, kResidual)), left, kRounding * 2.0 * left);
}

TEST_F(PredictionPlot, ShowsThePartThatWasChosen) {
  const Answer answer = servotwin_says(
      {"predict", recording_, "--model", model_, "--from", "4", "--to", "9", "--plot", plot_});
  ASSERT_EQ(answer.status, 0) << answer;
  const std::string svg = content_of(plot_);
  const std::vector<Drawn> measured = drawn(svg, 0, kMeasured);
  EXPECT_NEAR(measured.front().x, 4.0, 0.01);
  EXPECT_NEAR(measured.back().x, 9.0, 0.01);
}

TEST_F(PredictionPlot, HasThePanelsOfEveryAxisInItsUnits) {
  ModelRecord rotary = known_axis("C");
  rotary.rotary = true;
  write_model(folder_ / "c.json", rotary);
  std::string both = "time[s],X.command[mm],X.actual[mm],C.command[rad],C.actual[rad]\n";
  for (int k = 0; k < 6000; ++k) {
    const std::string one = "," + cell(command_mm(k)) + "," + cell(actual_mm(k));
    both += cell(k / 1000.0) + one + one + "\n";
  }
  const Answer answer =
      servotwin_says({"predict", folder_.write("both.csv", both), "--axis", "X", "--model", model_,
                      "--axis", "C", "--model", folder_ / "c.json", "--plot", plot_});
  ASSERT_EQ(answer.status, 0) << answer;
  const std::string svg = content_of(plot_);
  EXPECT_TRUE(well_formed(svg));
  std::vector<std::string> labels;
  for (const std::smatch& label :
       matches(svg, ">(axis [A-Z]|tracking error.*|residual.*|command \\[.*)</text>"))
    labels.push_back(label[1]);
  EXPECT_THAT(labels,
              ElementsAre("axis X", "tracking error [um]", "residual [um]", "command [mm]",
                          "axis C", "tracking error [mrad]", "residual [mrad]", "command [rad]"));
}

TEST_F(PredictionPlot, OfIdentifyIsThatOfItsHoldOut) {
  const Answer answer = servotwin_says({"identify", recording_, "--method", "pole-search", "--to",
                                        "6", "--json", "-", "--plot", plot_});
  ASSERT_EQ(answer.status, 0) << answer;
  const json result = json::parse(answer.out);
  const std::string svg = content_of(plot_);
  const double left = 1e6 * result["fit"]["holdout"]["max_m"].get<double>();
  EXPECT_NEAR(largest(drawn(svg, 1, kResidual)), left, 0.02 * left);
  EXPECT_NEAR(drawn(svg, 0, kMeasured).front().x, result["data"]["training_to"].get<double>(),
              0.01);
}

}  // namespace
}  // namespace servotwin
