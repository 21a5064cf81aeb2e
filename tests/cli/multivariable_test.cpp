// servotwin multivariable, as a user runs it, on tables of two axes in closed form.
#include <gmock/gmock.h>

#include <algorithm>
#include <cmath>
#include <complex>
#include <nlohmann/json.hpp>
#include <vector>

#include "program.h"
#include "recordings.h"
#include "twin/two_pi.h"

namespace servotwin {
namespace {

using nlohmann::json;
using testing::HasSubstr;

constexpr double kHz = 22.0, kDamping = 0.15, kPole = 60.0, kPush = 0.1, kFriction = 2e-3;

struct Axes {
  std::vector<double> x, x_actual, y, y_actual;  // [mm]
};

/// Steady motion. X lags by a pair of poles; Y by a real one, pushes X by a tenth of its lag, and
/// its friction, which slides this far after it turned, moves X by 2 um.
Axes both(int rows, double break_mm = 5e-3) {
  const auto lag = [](double w) { return 1.0 / (std::complex<double>(0.0, w) + kPole); };
  const auto vibrates = [](double w) {
    const double omega = kTwoPi * kHz;
    const std::complex<double> s(0.0, w);
    return (s + 0.5 * omega) / (s * s + 2.0 * kDamping * omega * s + omega * omega);
  };
  // Of a command sin(w t) the velocity is w cos(w t).
  const auto answer = [](std::complex<double> g, double w, double t) {
    return std::abs(g) * w * std::cos(w * t + std::arg(g));
  };
  Axes out;
  double element = 0.0;
  for (int k = 0; k < rows; ++k) {
    const double t = 1e-3 * k;
    double x = 0.0, y = 0.0, x_error = 0.0, y_error = 0.0;
    for (const double w : {3.0, 17.0, 71.0, 150.0}) {
      x += std::sin(w * t) / w;
      x_error += answer(vibrates(w), w, t) / w;
    }
    for (const double w : {2.0, 23.0, 90.0}) {
      y += std::sin(w * t) / w;
      y_error += answer(lag(w), w, t) / w;
    }
    out.y.push_back(y);
    out.y_actual.push_back(y - y_error);
    if (k > 0) {
      const double way =
          out.y_actual[out.y_actual.size() - 1] - out.y_actual[out.y_actual.size() - 2];
      element = std::clamp(element + way / break_mm, -1.0, 1.0);
    }
    out.x.push_back(x);
    out.x_actual.push_back(x - x_error - kPush * y_error - kFriction * element);
  }
  return out;
}

std::string table(const Axes& axes) {
  std::string out = "time[s],X.command[mm],X.actual[mm],Y.command[mm],Y.actual[mm]\n";
  for (std::size_t k = 0; k < axes.x.size(); ++k)
    out += cell(1e-3 * static_cast<double>(k)) + "," + cell(axes.x[k]) + "," +
           cell(axes.x_actual[k]) + "," + cell(axes.y[k]) + "," + cell(axes.y_actual[k]) + "\n";
  return out;
}

TEST(MultivariableTool, SaysWhichAxisMakesWhatOfWhichError) {
  const Folder folder;
  const std::string file = folder.write("rec.csv", table(both(8000)));
  const Answer answer =
      servotwin_says({"multivariable", file, "--break-distance", "5", "--json", folder / "r.json"});
  ASSERT_EQ(answer.status, 0) << answer;
  EXPECT_THAT(answer.out, HasSubstr("inputs      X.command (its velocity), X.friction of 5 um, "
                                    "Y.command (its velocity), Y.friction of 5 um"));
  EXPECT_THAT(answer.out, HasSubstr("mode        22"));
  EXPECT_THAT(answer.out, HasSubstr("output      X.error: "));
  EXPECT_THAT(answer.out, HasSubstr("  parts     X.command "));
  const json result = json::parse(content_of(folder / "r.json"));
  EXPECT_EQ(result["schema"], "servotwin.multivariable/1");
  const json& modes = result["poles"];
  EXPECT_TRUE(std::any_of(modes.begin(), modes.end(), [](const json& pole) {
    return pole.contains("damping") && std::abs(pole["frequency_hz"].get<double>() - kHz) < 0.05 &&
           std::abs(pole["damping"].get<double>() - kDamping) < 0.003;
  })) << modes;
  const json &x = result["outputs"][0], &y = result["outputs"][1];
  EXPECT_EQ(x["name"], "X.error");
  EXPECT_EQ(x["unit"], "m");
  EXPECT_LT(x["holdout_rms"].get<double>(), 0.01 * x["rms"].get<double>());
  EXPECT_LT(y["holdout_rms"].get<double>(), 0.01 * y["rms"].get<double>());
  // The friction slides nearly always; Y's command makes a tenth of Y's error on X.
  const double of_y = y["parts_rms"]["Y.command"];
  EXPECT_NEAR(x["parts_rms"]["Y.friction"].get<double>(), 1e-3 * kFriction, 0.1e-3 * kFriction);
  EXPECT_NEAR(x["parts_rms"]["Y.command"].get<double>(), kPush * of_y, 0.03 * kPush * of_y);
  EXPECT_LT(x["parts_rms"]["X.friction"].get<double>(), 0.1e-3 * kFriction);
  EXPECT_LT(y["parts_rms"]["X.command"].get<double>(), 0.01 * of_y);
  // c of every real pole, c1 and c0 of every pair, d: for each of the four inputs.
  ASSERT_EQ(x["coefficients"].size(), 4U);
  EXPECT_EQ(x["coefficients"][0].size(), result["order"].get<std::size_t>() + 1);
  EXPECT_EQ(result["inputs"][3],
            (json{{"name", "Y.friction"}, {"unit", "1"}, {"break_distance", 5e-6}}));
}

TEST(MultivariableTool, SeeksWhereFrictionBreaksAwayAndWritesMatricesAndPlot) {
  const Folder folder;
  const std::string file = folder.write("rec.csv", table(both(8000, 3.3e-3)));
  const Answer answer = servotwin_says(
      {"multivariable", file, "--input", "X.command,Y.command,Y.friction", "--order", "3", "--json",
       folder / "r.json", "--mat", folder / "m.mat", "--plot", folder / "p.svg"});
  ASSERT_EQ(answer.status, 0) << answer;
  EXPECT_THAT(answer.out, HasSubstr("Y.friction (break distances searched for from 1, 2, "));
  EXPECT_THAT(answer.out, HasSubstr("friction    residual share "));
  EXPECT_THAT(answer.out, HasSubstr(": accepted"));
  EXPECT_THAT(answer.out, HasSubstr("  Y.friction breaks away after "));
  const json result = json::parse(content_of(folder / "r.json"));
  EXPECT_TRUE(result["break_distances"]["taken"]);
  EXPECT_LT(result["break_distances"]["left_found"], result["break_distances"]["left_given"]);
  EXPECT_EQ(result["inputs"].size(), 8u);
  EXPECT_TRUE(result["inputs"][2].contains("break_distance_sd"));
  EXPECT_EQ(content_of(folder / "m.mat").substr(0, 6), "MATLAB");
  const std::string plot = content_of(folder / "p.svg");
  for (const char* part : {"to X.error", "to Y.error", "X.command, fit", "Y.command, fit",
                           "magnitude [m per unit of the input]"})
    EXPECT_THAT(plot, HasSubstr(part));
}

TEST(MultivariableTool, LeavesOutElementsThatWouldNotSlide) {
  const Folder folder;
  Axes axes = both(8000);
  for (auto* values : {&axes.y, &axes.y_actual}) {
    for (double& value : *values) value *= 0.1;  // some 100 um in all
  }
  const std::string file = folder.write("rec.csv", table(axes));
  const std::vector<std::string> named{
      "multivariable", file,      "--input", "Y.command,Y.friction",
      "--output",      "Y.error", "--order", "1"};
  const Answer answer = servotwin_says(named);
  ASSERT_EQ(answer.status, 0) << answer;
  EXPECT_THAT(answer.out,
              HasSubstr("note: Y.friction: the element with break distance 50 um is left out: it "
                        "would be proportional to the position, because the axis travels only"));
  auto far = named;
  far.insert(far.end(), {"--break-distance", "400,500"});
  const Answer refused = servotwin_says(far);
  EXPECT_EQ(refused.status, 1) << refused;
  EXPECT_THAT(refused.err, HasSubstr("Y.friction: the axis travels too little"));
}

TEST(MultivariableTool, TakesTheSignalsThatAreNamed) {
  const Folder folder;
  const std::string file = folder.write("rec.csv", table(both(8000)));
  const Answer answer = servotwin_says({"multivariable", file, "--input", "Y.command", "--output",
                                        "Y.error,Y.velocity", "--order", "1", "--json", "-"});
  ASSERT_EQ(answer.status, 0) << answer;
  const json result = json::parse(answer.out);
  ASSERT_EQ(result["inputs"].size(), 1U);
  EXPECT_EQ(result["outputs"][1]["unit"], "m/s");
  EXPECT_TRUE(result["trials"].empty());
  ASSERT_EQ(result["poles"].size(), 1U);
  EXPECT_NEAR(result["poles"][0]["frequency_hz"], kPole / kTwoPi, 1e-3 * kPole / kTwoPi);
  // The error is v/(s + p), the velocity of the axis p v/(s + p).
  EXPECT_NEAR(result["outputs"][0]["coefficients"][0][0], 1.0, 1e-3);
  EXPECT_NEAR(result["outputs"][1]["coefficients"][0][0], kPole, 0.01 * kPole);
  EXPECT_NEAR(result["outputs"][1]["coefficients"][0][1], 0.0, 0.01);
}

TEST(MultivariableTool, AnAxisAtRestIsLeftOut) {
  const Folder folder;
  Axes axes = both(8000);
  std::fill(axes.x.begin(), axes.x.end(), 1.0);
  std::fill(axes.x_actual.begin(), axes.x_actual.end(), 1.0);
  const std::string file = folder.write("rec.csv", table(axes));
  const Answer answer = servotwin_says({"multivariable", file, "--order", "1"});
  ASSERT_EQ(answer.status, 0) << answer;
  EXPECT_THAT(answer.out, HasSubstr("note: X stands still and is left out"));
  EXPECT_THAT(answer.out, HasSubstr("output      Y.error"));
}

TEST(MultivariableTool, NoticesAWrongUnitAndWhatItSaysNothingOf) {
  const Folder folder;
  Axes axes = both(8000);
  for (double& value : axes.y_actual) value *= 1e-3;
  const Answer refused = servotwin_says({"multivariable", folder.write("unit.csv", table(axes))});
  EXPECT_EQ(refused.status, 1) << refused;
  EXPECT_THAT(refused.err, HasSubstr("Y: the encoder moves 0.00"));
  EXPECT_THAT(refused.err, HasSubstr("check the units and signs of both columns"));
  // X's error from Y's command alone, which makes a tenth of it at most.
  const std::string file = folder.write("rec.csv", table(both(8000)));
  const Answer answer = servotwin_says(
      {"multivariable", file, "--input", "Y.command", "--output", "X.error", "--order", "1"});
  ASSERT_EQ(answer.status, 0) << answer;
  EXPECT_THAT(answer.out, HasSubstr("the fit predicts almost nothing of X.error"));
}

TEST(MultivariableTool, RefusesWhatItCannotUse) {
  const Folder folder;
  const std::string file = folder.write("rec.csv", table(both(1000)));
  const auto refused = [&](const std::vector<std::string>& more, int status,
                           const std::vector<std::string>& says) {
    std::vector<std::string> arguments{"multivariable", file};
    arguments.insert(arguments.end(), more.begin(), more.end());
    const Answer answer = servotwin_says(arguments);
    EXPECT_EQ(answer.status, status) << answer;
    ASSERT_EQ(answer.complaints().size(), 1U) << answer;
    for (const std::string& part : says) EXPECT_THAT(answer.err, HasSubstr(part));
  };
  refused({"--input", "X.comand"}, 2, {"'X.comand' is none of", "did you mean 'command'?"});
  refused({"--input", "command"}, 2, {"AXIS.channel"});
  refused({"--output", "X.position"}, 2, {"X.error"});
  refused({"--input", "X.torque", "--output", "X.torque"}, 2, {"both have 'X.torque'"});
  refused({"--break-distance", "1,nan"}, 2, {"--break-distance", "'nan'", "above 0"});
  refused({"--input", "Z.command"}, 1, {"no axis 'Z'", "X, Y"});
  refused({"--output", "X.torque"}, 1, {"X has no torque"});
  refused({"--order", "16"}, 1, {"too short"});
  refused({"--input", "X.friction", "--plot", folder / "p.svg"}, 2, {"--plot", "frictions alone"});
  refused({"--input", "command"}, 2, {"of which axis?"});
  refused({"--input", "X.command,X.command"}, 2, {"'X.command' twice"});
  refused({"--break-distance", "5,5"}, 2, {"--break-distance", "'5' is given twice"});
  refused({"--mat", "-"}, 2, {"MATLAB", "standard output"});
}

}  // namespace
}  // namespace servotwin
