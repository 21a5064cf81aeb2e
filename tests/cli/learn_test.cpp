// servotwin learn: from a table of commands to a corrected one with a smaller error on the twin.
#include <gmock/gmock.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <complex>
#include <nlohmann/json.hpp>
#include <sstream>
#include <tuple>

#include "drivers/recordings/recording_file.h"
#include "program.h"
#include "recordings.h"

namespace servotwin {
namespace {

using nlohmann::json;
using testing::HasSubstr;
using testing::Not;

/// Two axes on circles of 8 mm, at rest at both ends.
double angle_at(double t) {
  const double part = std::clamp((t - 0.3) / 2.4, 0.0, 1.0);
  return 4.0 * M_PI * part * part * part * (10.0 - part * (15.0 - 6.0 * part));
}
std::string circles() {
  std::string out = "time[s],X.command[mm],Y.command[mm]\n";
  for (int k = 0; k <= 3000; ++k) {
    const double t = 0.001 * k;
    out += cell(t) + "," + cell(8.0 * std::cos(angle_at(t)) - 8.0) + "," +
           cell(8.0 * std::sin(angle_at(t))) + "\n";
  }
  return out;
}

/// A model with standard deviations of its parameters.
ModelRecord stated(ModelRecord record) {
  record.pole_deviation = {0.0, 8.0, 0.01};
  record.numerator_deviation = {0.01, 12.0, 0.0};
  record.loop_covariance = LoopCovariance::Zero();
  record.loop_covariance->diagonal() << 0.0, 64.0, 1e-4, 1e-4, 144.0, 0.0, 0.0;
  (*record.loop_covariance)(1, 4) = (*record.loop_covariance)(4, 1) = 95.0;
  record.training = {1e-6, 4e-6};
  record.holdout = {1e-6, 4e-6};
  return record;
}

class Learn : public testing::Test {
 protected:
  void SetUp() override {
    write_model(x_, known_axis("X"));
    ModelRecord y = known_axis("Y");
    y.model.loop.denominator = {80.0, 9000.0, 0.0};
    y.model.loop.numerator = {1.0, 80.0, 0.0};
    write_model(y_, y);
  }
  Answer learn(std::vector<std::string> options) {
    std::vector<std::string> words{"learn", table_, "--model", x_, "--model", y_};
    words.insert(words.end(), options.begin(), options.end());
    return servotwin_says(words);
  }
  json learned(std::vector<std::string> options = {}) {
    options.insert(options.end(), {"--json", "-"});
    const Answer answer = learn(options);
    EXPECT_EQ(answer.status, 0) << answer;
    return json::parse(answer.out);
  }

  Folder folder_;
  std::string x_ = folder_ / "x.json", y_ = folder_ / "y.json";
  std::string table_ = folder_.write("path.csv", circles());
};

// `simulate` with the corrected table gives the error that `learn` reports.
TEST_F(Learn, WhatItWritesDoesOnTheTwinWhatItSays) {
  const std::string corrected = folder_ / "corrected.csv";
  const json result = learned({"--out", corrected});
  EXPECT_EQ(result["schema"], "servotwin.correction/1");
  const Answer simulated = servotwin_says(
      {"simulate", corrected, "--model", x_, "--model", y_, "--out", folder_ / "sim.csv"});
  ASSERT_EQ(simulated.status, 0) << simulated;
  const Recording wanted = read_recording(table_), got = read_recording(folder_ / "sim.csv");
  for (std::size_t i = 0; i < 2; ++i) {
    double sum = 0.0;
    for (std::size_t k = 0; k < wanted.time.size(); ++k)
      sum += std::pow(wanted.axes[i].command[k] - got.axes[i].actual[k], 2.0);
    const double rms = std::sqrt(sum / static_cast<double>(wanted.time.size()));
    const json& axis = result["axes"][i];
    EXPECT_NEAR(rms, axis["after"]["rms_m"].get<double>(), 1e-9);
    EXPECT_LT(rms, 0.01 * axis["before"]["rms_m"].get<double>());
    EXPECT_LT(axis["contraction"].get<double>(), 1.0);
    const std::vector<double> offset = axis["offset_m"];
    ASSERT_EQ(offset.size(), wanted.time.size());
    EXPECT_EQ(offset.front(), 0.0);
    EXPECT_EQ(offset.back(), 0.0);
    const Recording table = read_recording(corrected);
    for (std::size_t k = 0; k < offset.size(); k += 100)
      EXPECT_NEAR(table.axes[i].command[k], wanted.axes[i].command[k] + offset[k], 1e-12);
  }
  const json& trials = result["trials"];
  const std::size_t best = result["best_trial"];
  EXPECT_LT(trials[best]["contour"]["rms_m"], 0.05 * trials[0]["contour"]["rms_m"].get<double>());
}

// Limits just below the unlimited correction: they bind, and the error still decreases.
TEST_F(Learn, EveryMethodMakesItBetterAndObeysTheLimits) {
  const json free = learned()["axes"];
  const double peak = 0.95 *
                      std::min(free[0]["peak_m"].get<double>(), free[1]["peak_m"].get<double>()),
               rate = 0.95 * std::max(free[0]["rate_m_per_s"].get<double>(),
                                      free[1]["rate_m_per_s"].get<double>());
  for (const char* method : {"inverse", "norm-optimal", "p", "pd", "feedforward"}) {
    const json result = learned(
        {"--method", method, "--limits-peak", cell(1e6 * peak), "--limits-rate", cell(1e3 * rate)});
    EXPECT_EQ(result["method"], method);
    bool bound = false;
    for (const json& axis : result["axes"]) {
      EXPECT_LT(axis["after"]["rms_m"], 0.9 * axis["before"]["rms_m"].get<double>()) << method;
      EXPECT_LE(axis["peak_m"].get<double>(), peak * (1.0 + 1e-9)) << method;
      EXPECT_LE(axis["rate_m_per_s"].get<double>(), rate * (1.0 + 1e-9)) << method;
      bound = bound || axis["limited_by"].get<std::string>().starts_with("the limits");
    }
    EXPECT_TRUE(bound) << method;
  }
}

// Corrections of single axes would increase the contour error.
TEST_F(Learn, TightLimitsLeaveThePathAsItIsAndSaySo) {
  const Answer answer = learn({"--limits-peak", "60", "--limits-rate", "5"});
  EXPECT_EQ(answer.status, 0) << answer;
  EXPECT_THAT(answer.out, HasSubstr("the path is unchanged"));
  EXPECT_THAT(answer.out, HasSubstr("the axes' errors fell, but the distance from the path grew"));
  EXPECT_THAT(answer.out, HasSubstr("X at its peak of 60 um or rate of 5 mm/s in"));
  EXPECT_THAT(answer.out, HasSubstr("--aim contour"));
  EXPECT_THAT(answer.out, Not(HasSubstr("limited by")));
  const json result = learned({"--limits-peak", "60", "--limits-rate", "5"});
  EXPECT_EQ(result["best_trial"], 0);
  for (const json& axis : result["axes"]) {
    EXPECT_THAT(axis["limited_by"].get<std::string>(), HasSubstr("no correction is kept"));
    EXPECT_TRUE(axis["expected_rms_m"].is_null()) << "of no correction";
  }
  EXPECT_THAT(learn({"--limits-rate", "5"}).out, Not(HasSubstr(" peak of")));
}

TEST_F(Learn, TheFeedForwardIsJudgedByWhatItIs) {
  const Answer answer = learn({"--method", "feedforward"});
  ASSERT_EQ(answer.status, 0) << answer;
  EXPECT_THAT(answer.out, HasSubstr("|1 - Q L T| at most 1.02"));
  const json result = learned({"--method", "feedforward"});
  for (const json& axis : result["axes"]) {
    EXPECT_THAT(axis["limited_by"].get<std::string>(), Not(HasSubstr("number of trials")));
    EXPECT_EQ(axis["bandwidth_hz"], axis["feedforward_bandwidth_hz"]);
    EXPECT_LE(axis["contraction"].get<double>(), 1.02 * (1.0 + 1e-9));
  }
  const std::vector<std::vector<std::string>> useless{
      {"--aim", "tracking"}, {"--aim", "contour"}, {"--bandwidth", "20"}, {"--trials", "3"}};
  for (std::vector<std::string> options : useless) {
    const std::string option = options[0];
    options.insert(options.end(), {"--method", "feedforward"});
    const Answer refused = learn(options);
    EXPECT_EQ(refused.status, 2) << option;
    EXPECT_THAT(refused.err, HasSubstr(option));
  }
}

// Ten trials or a hundred: the error that the learning filter blocks does not depend on their
// number.
TEST_F(Learn, WhereMoreTrialsChangeNothingItIsTheBandwidth) {
  for (const auto& [file, name] : {std::pair{x_, "X"}, std::pair{y_, "Y"}}) {
    ModelRecord record = known_axis(name);  // without the force that it holds at both ends
    record.model.effects.pop_back();
    record.effect_deviations.pop_back();
    write_model(file, record);
  }
  const auto limits = [&](const std::string& trials) {
    const json result = learned({"--uncertainty", "10", "--trials", trials});
    return std::array{result["axes"][0]["limited_by"].get<std::string>(),
                      result["axes"][1]["limited_by"].get<std::string>()};
  };
  for (const std::string& by : limits("100")) EXPECT_THAT(by, HasSubstr("the bandwidth: more"));
  for (const std::string& by : limits("2")) EXPECT_EQ(by, "the number of trials");
}

TEST_F(Learn, APathThatDoesNotRestIsLimitedByItsEnds) {
  std::string table = "time[s],X.command[mm],Y.command[mm]\n";
  for (int k = 0; k <= 3000; ++k)
    table += cell(0.001 * k) + "," + cell(8.0 * std::cos(0.002 * M_PI * k)) + "," +
             cell(8.0 * std::sin(0.002 * M_PI * k)) + "\n";
  table_ = folder_.write("endless.csv", table);
  const json result = learned();
  for (const json& axis : result["axes"])
    EXPECT_THAT(axis["limited_by"].get<std::string>(),
                HasSubstr("the ends of the path: 100 % of the remaining squared error"));
}

// --bandwidth 5 also limits the feed-forward beneath learning, so that a resonance above 5 Hz is
// not excited.
TEST_F(Learn, TheBandwidthThatIsAskedForIsOfTheWholeCorrection) {
  const json result = learned({"--bandwidth", "5"});
  for (const json& axis : result["axes"]) {
    EXPECT_EQ(axis["feedforward_bandwidth_hz"], 5.0);
    const std::vector<double> u = axis["offset_m"];
    const auto n = static_cast<double>(u.size());
    double below = 0.0, above = 0.0;
    for (int k = 1; k < 300; ++k) {  // of 3 s: up to 100 Hz
      std::complex<double> sum;
      for (std::size_t i = 0; i < u.size(); ++i)
        sum += u[i] * std::polar(1.0, -2.0 * M_PI * k * static_cast<double>(i) / n);
      (k > 75 ? above : below) += std::norm(sum);
    }
    EXPECT_LT(above, 1e-8 * below);
  }
  EXPECT_THAT(learn({"--bandwidth", "5"}).out, HasSubstr("bandwidth 5.0 Hz (feed-forward 5.0 Hz)"));
}

/// X and Y move between these times of three seconds [s].
std::string moving(double from, double to) {
  std::string out = "time[s],X.command[mm],Y.command[mm]\n";
  for (int k = 0; k <= 3000; ++k) {
    const double part = std::clamp((0.001 * k - from) / (to - from), 0.0, 1.0);
    const double way = 8.0 * part * part * part * (10.0 - part * (15.0 - 6.0 * part));
    out += cell(0.001 * k) + "," + cell(way) + "," + cell(0.5 * way) + "\n";
  }
  return out;
}

TEST_F(Learn, SaysWhereThePathLeavesItNoRoom) {
  for (const auto& [from, to, words] : {std::tuple{0.05, 2.5, "at the start of the path"},
                                        std::tuple{0.3, 2.95, "at the end of the path"}}) {
    table_ = folder_.write("ends.csv", moving(from, to));
    const Answer answer = learn({});
    EXPECT_EQ(answer.status, 0) << answer;
    EXPECT_THAT(answer.out, HasSubstr(words));
    EXPECT_EQ(answer.out.find("warning:"), answer.out.rfind("warning:")) << answer;
  }
  table_ = folder_.write("ends.csv", moving(0.1, 2.9));
  EXPECT_THAT(learn({}).out, Not(HasSubstr("warning:")));
}

// The circle of 8 mm is fastest at its half, along Y: 4 pi 15/8 / 2.4 s times the radius is
// 78.5 mm/s, of which 5 ms are 393 um.
TEST_F(Learn, WarnsOfADelayThatOnlyTheRecordingMayHave) {
  EXPECT_THAT(learn({}).out, Not(HasSubstr("delay")));
  ModelRecord late = known_axis("Y");
  Effect delay = make_effect<TimeDelay>();
  delay.shape[0] = 5e-3;
  late.model.effects.push_back(delay);
  write_model(y_, late);
  const Answer answer = learn({});
  EXPECT_EQ(answer.status, 0) << answer;
  EXPECT_THAT(answer.out, HasSubstr("warning: Y: the model has a delay of 5 ms"));
  EXPECT_THAT(answer.out, HasSubstr("leads by up to 393 um"));
}

TEST_F(Learn, APathThatNeverMovesIsRefused) {
  std::string table = "time[s],X.command[mm],Y.command[mm]\n";
  for (int k = 0; k < 1000; ++k) table += cell(0.001 * k) + ",3,4\n";
  table_ = folder_.write("still.csv", table);
  const Answer answer = learn({"--report", folder_ / "still.html"});
  EXPECT_EQ(answer.status, 1);
  EXPECT_THAT(answer.err, HasSubstr("still.csv: no axis with a model moves"));
  EXPECT_THAT(answer.err, HasSubstr("nothing to correct"));
}

// Bridged or resampled rows differ from those of the table.
TEST_F(Learn, SaysWhereItsRowsAreNotThoseOfTheTable) {
  EXPECT_THAT(learn({"--trials", "1"}).out, Not(HasSubstr("rows of the table")));
  const auto without_rows = [&](int gap) {
    std::istringstream all(circles());
    std::string out, line;
    for (int row = -1; std::getline(all, line); ++row) {
      if (row < 1000 || row >= 1000 + gap) out += line + "\n";
    }
    return out;
  };
  table_ = folder_.write("gap.csv", without_rows(2));
  EXPECT_THAT(learn({"--trials", "1"}).out,
              HasSubstr("the result has 3001 rows every 1 ms, not the 2999 rows of the table"));
  std::string uneven = "time[s],X.command[mm],Y.command[mm]\n";
  for (int k = 0; k <= 3000; ++k) {
    const double t = 0.001 * k + (k % 2 == 0 ? 0.0 : 0.0003);
    uneven += cell(t) + "," + cell(8.0 * std::cos(angle_at(t)) - 8.0) + "," +
              cell(8.0 * std::sin(angle_at(t))) + "\n";
  }
  table_ = folder_.write("uneven.csv", uneven);
  EXPECT_THAT(learn({"--trials", "1"}).out, HasSubstr("not the 3001 rows of the table"));
}

TEST_F(Learn, ADwellIsWrittenWithAllItsTime) {
  std::string table = "time[s],X.command[mm]\n";
  for (int k = 0; k <= 16'000; ++k) {
    const double part = std::clamp((k - 8001) / 4000.0, 0.0, 1.0);
    table += cell(k / 8000.0) + "," +
             cell(8.0 * part * part * part * (10.0 - part * (15.0 - 6.0 * part))) + "\n";
  }
  const std::string file = folder_ / "dwell.nc";
  const Answer answer =
      servotwin_says({"learn", folder_.write("dwell.csv", table), "--model", x_, "--trials", "1",
                      "--gcode", file, "--chord-tolerance", "200"});
  ASSERT_EQ(answer.status, 0) << answer;
  EXPECT_THAT(content_of(file), HasSubstr("G4 P1.000125\n"));
  EXPECT_THAT(answer.out, testing::EndsWith("\nwritten     " + file + "\n"));
}

TEST_F(Learn, ARotaryAxisHasItsUnitAndNoPartInTheContour) {
  ModelRecord turn = known_axis("A");
  turn.rotary = true;
  const std::string a = folder_ / "a.json";
  write_model(a, turn);
  std::istringstream all(circles());
  std::string table, line;
  for (int row = -1; std::getline(all, line); ++row)
    table += line + (row < 0 ? ",A.command[deg]" : "," + cell(10.0 * angle_at(0.001 * row))) + "\n";
  table_ = folder_.write("turning.csv", table);
  const Answer answer = learn({"--model", a, "--aim", "contour"});
  ASSERT_EQ(answer.status, 0) << answer;
  EXPECT_THAT(answer.out, HasSubstr("[um]      [um]    [urad]      [um]"));
  EXPECT_THAT(answer.out, HasSubstr("A is a rotary axis and does not contribute to the distance"));
  EXPECT_THAT(answer.out, Not(HasSubstr("A: limited by its aim")));
}

TEST_F(Learn, TheAimOfTheContourLeavesTheLag) {
  const json by_axis = learned({"--limits-peak", "60"}),
             contour = learned({"--limits-peak", "60", "--aim", "contour"});
  const auto left = [](const json& result) {
    return result["trials"][result["best_trial"].get<std::size_t>()]["contour"]["rms_m"]
        .get<double>();
  };
  EXPECT_EQ(contour["aim"], "contour");
  EXPECT_LT(left(contour), 0.5 * left(by_axis));
}

// Half of the squared error of the axes is perpendicular to a path in the plane.
TEST_F(Learn, WhatIsExpectedAcrossThePathIsSaid) {
  ModelRecord x = stated(known_axis("X")), y = stated(known_axis("Y"));
  x.holdout = {3e-6, 9e-6};
  y.holdout = {4e-6, 9e-6};
  write_model(x_, x);
  write_model(y_, y);
  const json result = learned({"--aim", "contour"});
  const double left =
      result["trials"][result["best_trial"].get<std::size_t>()]["contour"]["rms_m"].get<double>();
  const double expected = std::sqrt(left * left + (9.0 + 16.0) / 2.0 * 1e-12);
  EXPECT_NEAR(result["expected_contour_rms_m"].get<double>(), expected, 1e-12);
  const std::string page = folder_ / "page.html";
  const Answer answer = learn({"--aim", "contour", "--report", page});
  const std::string words = answer.out.substr(answer.out.find("contour: expect at least "));
  EXPECT_THAT(words, testing::StartsWith("contour: expect at least 3.5"));
  EXPECT_THAT(content_of(page),
              testing::ContainsRegex("<td>contour</td>.*<td>3\\.5[0-9]</td><td></td></tr>"));
}

TEST_F(Learn, AToleranceOfMovesThatNobodyAskedForIsRefused) {
  const Answer answer = learn({"--chord-tolerance", "2"});
  EXPECT_NE(answer.status, 0);
  EXPECT_THAT(answer.err, HasSubstr("--chord-tolerance needs --gcode: it applies to the G1 moves"));
}

TEST_F(Learn, SaysWhatItDidOnOneScreen) {
  const Answer answer = learn({});
  ASSERT_EQ(answer.status, 0) << answer;
  for (const char* words :
       {"|Q (1 - L T)| at most", "tracking error, on the twin:", "contour error", "times smaller",
        "trial", "* kept", "correction up to", "limited by", "made of: "})
    EXPECT_THAT(answer.out, HasSubstr(words));
  EXPECT_LT(std::count(answer.out.begin(), answer.out.end(), '\n'), 45);
}

TEST_F(Learn, RefusesABandwidthThatNeedNotConverge) {
  const Answer answer = learn({"--method", "p", "--bandwidth", "200"});
  EXPECT_EQ(answer.status, 1);
  ASSERT_EQ(answer.complaints().size(), 1U) << answer;
  EXPECT_THAT(answer.err, HasSubstr("|Q (1 - L T)| reaches"));
  EXPECT_THAT(answer.err, HasSubstr("take a bandwidth of at most"));
}

TEST_F(Learn, RefusesWhatCannotBeMeant) {
  EXPECT_EQ(learn({"--method", "magic"}).status, 2);
  EXPECT_EQ(learn({"--limits-peak", "-1"}).status, 2);
  EXPECT_EQ(learn({"--trials", "0"}).status, 2);
  const Answer alone = servotwin_says({"learn", table_, "--model", x_, "--aim", "contour"});
  EXPECT_NE(alone.status, 0);
  EXPECT_THAT(alone.err, HasSubstr("two to five linear axes"));
  write_model(folder_ / "long.json", known_axis("AXIS"));
  std::string table = "time[s],AXIS.command[mm]\n";
  for (int k = 0; k < 500; ++k) table += cell(0.001 * k) + "," + cell(0.01 * k) + "\n";
  const Answer letter = servotwin_says({"learn", folder_.write("long.csv", table), "--model",
                                        folder_ / "long.json", "--gcode", folder_ / "out.nc"});
  EXPECT_EQ(letter.status, 2);
  EXPECT_THAT(letter.err, HasSubstr("one letter"));
}

/// The position of a control that runs these moves at their feeds: corners of position over time.
struct Moves {
  std::vector<double> time{0.0};
  std::vector<std::array<double, 2>> at;  // [mm]

  explicit Moves(const std::string& gcode) {
    std::istringstream lines(gcode);
    for (std::string line; std::getline(lines, line);) {
      double rest = 0.0, x = 0.0, y = 0.0, feed = 0.0;
      if (std::sscanf(line.c_str(), "G1 F%lf X%lf Y%lf", &feed, &x, &y) == 3) {
        at.push_back({x, y});
      } else if (std::sscanf(line.c_str(), "G4 P%lf", &rest) == 1) {
        time.push_back(time.back() + rest);
        at.push_back(at.back());
      } else if (std::sscanf(line.c_str(), "G1 X%lf Y%lf F%lf", &x, &y, &feed) == 3) {
        time.push_back(time.back() + 60.0 * std::hypot(x - at.back()[0], y - at.back()[1]) / feed);
        at.push_back({x, y});
      }
    }
  }
  [[nodiscard]] double apart(double t, double x, double y) const {
    std::size_t i = 1;
    while (i + 1 < time.size() && time[i] < t) ++i;
    const double way = std::clamp((t - time[i - 1]) / (time[i] - time[i - 1]), 0.0, 1.0);
    return std::hypot(x - at[i - 1][0] - way * (at[i][0] - at[i - 1][0]),
                      y - at[i - 1][1] - way * (at[i][1] - at[i - 1][1]));
  }
};

// Run as a control would: at every time it is within the tolerance of the corrected command.
TEST_F(Learn, TheGcodeStaysWithinItsToleranceAtEveryTime) {
  const std::string file = folder_ / "out.nc", corrected = folder_ / "corrected.csv";
  const Answer answer = learn({"--gcode", file, "--chord-tolerance", "2", "--out", corrected});
  ASSERT_EQ(answer.status, 0) << answer;
  EXPECT_THAT(content_of(file), HasSubstr("G90 G94 G21"));
  const Moves moves(content_of(file));
  ASSERT_GT(moves.at.size(), 20U);
  EXPECT_NEAR(moves.time.back(), 3.0, 0.005);
  const Recording path = read_recording(corrected);
  double furthest = 0.0;
  for (std::size_t k = 0; k < path.time.size(); ++k) {
    furthest = std::max(furthest, moves.apart(path.time[k], 1e3 * path.axes[0].command[k],
                                              1e3 * path.axes[1].command[k]));
  }
  EXPECT_LT(furthest, 2e-3 + 1e-4) << "mm; the rest is of the digits of feeds and words";
  EXPECT_GT(furthest, 0.5e-3) << "chords are not shorter than they must be";
}

// A motion back along the same line lies on the chord, but must not be merged into it; the other
// axis has no error and needs no correction.
TEST_F(Learn, AWayThereAndBackAlongALineIsKept) {
  std::string table = "time[s],X.command[mm],Y.command[mm]\n";
  for (int k = 0; k < 1500; ++k) {
    const double t = std::clamp(0.001 * k - 0.2, 0.0, 1.0);
    table += cell(0.001 * k) + "," + cell(5.0 * (1.0 - std::cos(4.0 * M_PI * t))) + ",0\n";
  }
  const std::string path = folder_.write("back.csv", table), file = folder_ / "back.nc",
                    corrected = folder_ / "back_out.csv";
  const Answer answer = servotwin_says({"learn", path, "--model", folder_ / "x.json", "--model",
                                        folder_ / "y.json", "--gcode", file, "--out", corrected});
  ASSERT_EQ(answer.status, 0) << answer;
  const Moves moves(content_of(file));
  const Recording read = read_recording(corrected);
  double furthest = 0.0, corrects = 0.0;
  for (std::size_t k = 0; k < read.time.size(); ++k) {
    furthest = std::max(furthest, moves.apart(read.time[k], 1e3 * read.axes[0].command[k],
                                              1e3 * read.axes[1].command[k]));
    const double t = std::clamp(read.time[k] - 0.2, 0.0, 1.0);
    corrects = std::max(
        corrects, std::abs(1e3 * read.axes[0].command[k] - 5.0 * (1.0 - std::cos(4.0 * M_PI * t))));
  }
  EXPECT_LT(furthest, 1e-3 + 1e-4) << "mm";
  EXPECT_GT(corrects, 0.01) << "mm; it was taken back for a contour error of nothing";
}

TEST_F(Learn, ThePageStandsAlone) {
  const std::string file = folder_ / "out.html";
  ASSERT_EQ(learn({"--report", file}).status, 0);
  const std::string page = content_of(file);
  for (const char* words : {"<!doctype html>", "Contour error", "learning curve", "|Q (1 - L T)|",
                            "deviation, ", "X: correction added"})
    EXPECT_THAT(page, HasSubstr(words));
  for (const char* words : {"<script", "src=", "href=", "@import", "nan", "inf"})
    EXPECT_THAT(page, Not(HasSubstr(words)));
}

TEST_F(Learn, AModelWithoutDeviationsSaysWhatIsTakenInstead) {
  EXPECT_THAT(learn({}).out, HasSubstr("the model states no deviations"));
  EXPECT_THAT(learn({"--uncertainty", "10"}).out, HasSubstr("10 % of every pole"));
  const double narrow = learned({"--uncertainty", "20"})["axes"][0]["bandwidth_hz"],
               wide = learned({"--uncertainty", "2"})["axes"][0]["bandwidth_hz"];
  EXPECT_LT(narrow, wide);
}

// The reach of a model is the motion that it was identified from, not the path to be corrected.
TEST_F(Learn, APathOfTenTimesTheSizeMakesAModelNoSurer) {
  write_model(x_, stated(known_axis("X")));
  const auto bandwidth_of = [&](double size) {
    std::string table = "time[s],X.command[mm]\n";
    for (int k = 0; k <= 3000; ++k)
      table += cell(0.001 * k) + "," + cell(size * (std::cos(angle_at(0.001 * k)) - 1.0)) + "\n";
    const Answer answer = servotwin_says({"learn", folder_.write("sized.csv", table), "--model", x_,
                                          "--trials", "1", "--json", "-"});
    EXPECT_EQ(answer.status, 0) << answer;
    return json::parse(answer.out)["axes"][0]["bandwidth_hz"].get<double>();
  };
  EXPECT_EQ(bandwidth_of(0.8), bandwidth_of(8.0));
}

TEST_F(Learn, AModelsUncertaintyIsOfItsOwnFile) {
  const auto bandwidth_of = [&](const ModelRecord& record, const std::string& words) {
    write_model(x_, record);
    const Answer answer =
        servotwin_says({"learn", table_, "--model", x_, "--trials", "1", "--json", "-"});
    EXPECT_EQ(answer.status, 0) << answer;
    EXPECT_THAT(answer.err, HasSubstr(words));
    return json::parse(answer.out)["axes"][0]["bandwidth_hz"].get<double>();
  };
  ModelRecord record = stated(known_axis("X"));
  const double together =
      bandwidth_of(record, "two standard deviations of the model and a timing error");
  record.holdout.rms = 1.5e-6;
  EXPECT_LT(bandwidth_of(record, "1.5 times as large"), together);
  record.holdout.rms = 1e-6;
  record.loop_covariance.reset();
  EXPECT_LT(bandwidth_of(record, "its file has no covariance"), together);
}

/// Y of the circles goes through 0 at 8 mm x 4 pi x 1.875 / 2.4 s.
constexpr double kFastest = 8e-3 * 4.0 * M_PI * 1.875 / 2.4;

TEST_F(Learn, PromisesNothingBeyondTheMotionOfItsModel) {
  const auto with_speed = [&](double speed) {
    ModelRecord y = stated(known_axis("Y"));
    y.motion = {speed, 5.0};
    write_model(y_, y);
    return learn({"--json", folder_ / "result.json"});
  };
  const auto expected = [&] {
    return json::parse(content_of(folder_ / "result.json"))["axes"][1]["expected_rms_m"];
  };
  const Answer within = with_speed(kFastest);
  ASSERT_EQ(within.status, 0) << within;
  EXPECT_THAT(within.out, Not(HasSubstr("warning:")));
  EXPECT_TRUE(expected().is_number());

  const Answer beyond = with_speed(kFastest / 3.9);
  ASSERT_EQ(beyond.status, 0) << beyond;
  EXPECT_THAT(beyond.out, HasSubstr("warning: Y: the command reaches 3.9 times the speed (0.079 "
                                    "m/s) and"));
  EXPECT_THAT(beyond.out,
              HasSubstr("Y: limited by the model: it was identified on slower motion\n"));
  EXPECT_TRUE(expected().is_null());
}

// A table in mm whose header says m.
TEST_F(Learn, AWrongUnitIsRefused) {
  std::string table = circles();
  table.replace(0, table.find('\n'), "time[s],X.command[m],Y.command[mm]");
  table_ = folder_.write("unit.csv", table);
  const Answer answer = learn({"--out", folder_ / "out.csv"});
  EXPECT_EQ(answer.status, 1) << answer;
  EXPECT_THAT(answer.err, HasSubstr("unit.csv: X: the command reaches"));
  EXPECT_THAT(answer.err, HasSubstr("a unit in the table is wrong"));
  EXPECT_EQ(answer.complaints().size(), 1U) << answer;
}

TEST_F(Learn, AJumpInTheCommandIsRefusedWithItsRow) {
  std::string out = "time[s],X.command[mm],Y.command[mm]\n";
  for (int k = 0; k <= 3000; ++k) {
    const double t = 0.001 * k, y = 8.0 * std::sin(angle_at(t));
    out += cell(t) + "," + cell(8.0 * std::cos(angle_at(t)) - 8.0) + "," +
           cell(k < 1500 ? y : y + 50.0) + "\n";
  }
  table_ = folder_.write("jump.csv", out);
  const Answer answer = learn({});
  EXPECT_EQ(answer.status, 1) << answer;
  EXPECT_THAT(answer.err, HasSubstr("jump.csv: Y.command jumps by 50 mm within one cycle, into row "
                                    "1501 (at 1.5 s)"));
}

TEST_F(Learn, AMissingCommandIsNotGuessed) {
  std::string table = circles();
  std::size_t at = 0;
  for (int line = 0; line < 1200; ++line) at = table.find('\n', at) + 1;
  table.replace(table.find(',', at) + 1,
                table.find(',', table.find(',', at) + 1) - table.find(',', at) - 1, "");
  table_ = folder_.write("hole.csv", table);
  const Answer answer = learn({});
  EXPECT_EQ(answer.status, 1) << answer;
  EXPECT_THAT(answer.err, HasSubstr("hole.csv: X.command has no value in row 1200 (at 1.199 s)"));
}

// Neither a corner at full speed nor the rounding of a table is a jump.
TEST_F(Learn, ACornerIsNoJump) {
  std::string out = "time[s],X.command[mm],Y.command[mm]\n";
  for (int k = 0; k <= 3000; ++k) {
    const double t = 0.001 * k, way = std::clamp(t - 0.5, 0.0, 2.0);
    const double x = 190.0 * std::min(way, 2.0 - way);
    out += cell(t) + "," + cell(std::round(20.0 * x) / 20.0) + "," + cell(0.05 * x) + "\n";
  }
  table_ = folder_.write("corner.csv", out);
  EXPECT_THAT(learn({"--trials", "1"}).err, Not(HasSubstr("jumps")));
}

TEST_F(Learn, AFileThatDoesNotSayItsMotionIsNamed) {
  ModelRecord old = known_axis("X");
  old.motion = {};
  write_model(x_, old);
  const Answer answer = learn({"--trials", "1"});
  EXPECT_EQ(answer.status, 0) << answer;
  EXPECT_THAT(answer.out,
              HasSubstr("the model of X does not say which speeds it was identified on"));
  EXPECT_THAT(answer.out, Not(HasSubstr("the model of Y")));
}

}  // namespace
}  // namespace servotwin
