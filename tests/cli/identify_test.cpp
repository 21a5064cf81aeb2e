// servotwin identify and predict on machines whose truth is known.
#include <gmock/gmock.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <fstream>
#include <nlohmann/json.hpp>
#include <numbers>
#include <sstream>

#include "identification/model/model_file.h"
#include "program.h"
#include "recordings.h"
#include "twin/twin.h"

namespace servotwin {
namespace {

using nlohmann::json;
using testing::Contains;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::Not;

/// A recording of the known axis with an encoder of 1 um, made once for all tests.
const std::string& known_recording() {
  static const std::string content = [] {
    const Folder folder;
    write_model(folder / "truth.json", known_axis());
    const Answer answer =
        servotwin_says({"simulate", folder.write("path.csv", command_table()), "--model",
                        folder / "truth.json", "--noise", "1", "--out", "-"});
    EXPECT_EQ(answer.status, 0) << answer;
    return answer.out;
  }();
  return content;
}

class Identify : public testing::Test {
 protected:
  /// By the pole search, which is the fastest; the machine has no other friction than it knows.
  Answer identify(const std::vector<std::string>& options) {
    std::vector<std::string> words{"identify", recording_, "--axis", "X"};
    words.insert(words.end(), options.begin(), options.end());
    if (std::find(options.begin(), options.end(), "--method") == options.end())
      words.insert(words.end(), {"--method", "pole-search"});
    return servotwin_says(words);
  }

  Folder folder_;
  std::string recording_ = folder_.write("rec.csv", known_recording());
};

TEST_F(Identify, NeedsNoAxisWhereThereIsOne) {
  const Answer one = servotwin_says({"identify", recording_, "--method", "pole-search", "--json",
                                     folder_ / "one.json"}),
               named = identify({"--json", folder_ / "named.json"});
  EXPECT_EQ(one.status, 0) << one;
  EXPECT_EQ(json::parse(content_of(folder_ / "one.json"))["loop"],
            json::parse(content_of(folder_ / "named.json"))["loop"]);
  const std::string two = folder_.write(
      "two.csv", "time[s],X.command[mm],Y.command[mm]\n0,0,0\n0.001,1,1\n0.002,2,2\n");
  for (const char* command : {"identify", "diagnose"}) {
    const Answer answer = servotwin_says({command, two});
    EXPECT_EQ(answer.status, 1) << answer;
    EXPECT_THAT(answer.err, HasSubstr("has the axes X, Y; choose one with --axis"));
  }
}

TEST_F(Identify, TakesTheBoundsOfTheTrainingShare) {
  for (const char* share : {"0.1", "0.95"}) {
    const Answer answer = identify({"--training-share", share});
    EXPECT_THAT(answer.err, Not(HasSubstr("training share"))) << answer;
  }
}

TEST_F(Identify, FindsTheAxisInAnotherCase) {
  const Answer other = servotwin_says({"identify", recording_, "--axis", "x", "--method",
                                       "pole-search", "--model", folder_ / "other.json"});
  EXPECT_EQ(other.status, 0) << other;
  EXPECT_EQ(json::parse(content_of(folder_ / "other.json"))["axis"], "X");
  EXPECT_THAT(other.out + other.err, Not(HasSubstr("axis x")));
  const Answer predicted =
      servotwin_says({"predict", recording_, "--axis", "x", "--model", folder_ / "other.json"});
  EXPECT_EQ(predicted.status, 0) << predicted;
  EXPECT_THAT(predicted.out, Not(HasSubstr("the recording is of axis")));
}

TEST_F(Identify, DoesNotChooseBetweenAxesThatDifferInCaseAlone) {
  const std::string both = folder_.write(
      "both.csv", "time[s],Xa.command[mm],xA.command[mm]\n0,0,0\n0.001,1,1\n0.002,2,2\n");
  EXPECT_THAT(servotwin_says({"identify", both, "--axis", "xa"}).err,
              HasSubstr("no axis 'xa'; it has Xa, xA"));
  EXPECT_THAT(servotwin_says({"identify", both, "--axis", "xA"}).err, Not(HasSubstr("no axis")));
}

TEST_F(Identify, ReadsStandardInput) {
  const auto from_input = [&](const std::string& file) {
    const std::string command = std::string(SERVOTWIN_BINARY) +
                                " identify - --method pole-search --json - < " + file + " > " +
                                (folder_ / "out") + " 2> " + (folder_ / "err");
    return std::system(command.c_str());
  };
  const Answer named = identify({"--json", "-"});
  EXPECT_EQ(from_input(recording_), 0);
  EXPECT_EQ(json::parse(content_of(folder_ / "out"))["loop"], json::parse(named.out)["loop"]);
  EXPECT_NE(from_input(folder_.write("bad.csv", "time[s],X.command[mm]\n0,x\n")), 0);
  EXPECT_THAT(content_of(folder_ / "err"),
              HasSubstr("servotwin identify: standard input: line 2: column 'X.command[mm]'"));
}

TEST_F(Identify, RecoversTheTruthItWasGiven) {
  const Answer answer = identify({"--json", "-"});
  ASSERT_EQ(answer.status, 0) << answer;
  const json result = json::parse(answer.out);  // and nothing else on standard output
  EXPECT_EQ(result["schema"], "servotwin.model/1");
  EXPECT_EQ(result["axis"], "X");
  EXPECT_EQ(result["loop"]["order"], 2);
  EXPECT_NEAR(result["loop"]["natural_frequency_hz"].get<double>(), 25.0, 0.25);
  EXPECT_NEAR(result["loop"]["damping_ratio"].get<double>(), 0.45, 0.01);
  EXPECT_NEAR(result["loop"]["tracking_error_numerator"][1].get<double>(), 120.0, 1.2);
  EXPECT_EQ(result["effects"][0]["id"], "coulomb_friction");
  EXPECT_NEAR(result["effects"][0]["parameters"]["coulomb"]["value"].get<double>(), 0.25, 0.01);
  EXPECT_EQ(result["effects"][1]["id"], "gravity_offset");
  EXPECT_NEAR(result["effects"][1]["parameters"]["offset_mps2"]["value"].get<double>(), -0.04,
              0.004);
  EXPECT_NEAR(result["fit"]["holdout"]["rms_m"].get<double>(), 1e-6 / std::sqrt(12.0), 0.05e-6);
}

TEST_F(Identify, SeveralRecordingsAreFittedTogether) {
  std::istringstream lines(known_recording());
  std::string line, head, first, second;
  std::getline(lines, head);
  std::vector<std::string> rows;
  while (std::getline(lines, line)) rows.push_back(line);
  for (std::size_t k = 0; k < rows.size(); ++k)
    (k < rows.size() / 2 ? first : second) += rows[k] + "\n";
  const std::string a = folder_.write("a.csv", head + "\n" + first),
                    b = folder_.write("b.csv", head + "\n" + second);
  const Answer both =
      servotwin_says({"identify", a, b, "--axis", "X", "--method", "pole-search", "--json",
                      folder_ / "both.json", "--model", folder_ / "both_model.json"});
  ASSERT_EQ(both.status, 0) << both;
  EXPECT_THAT(both.out, HasSubstr("note: b.csv begins at"));
  const json loop = json::parse(content_of(folder_ / "both.json"))["loop"];
  EXPECT_NEAR(loop["natural_frequency_hz"].get<double>(), 25.0, 0.25);
  EXPECT_NEAR(loop["damping_ratio"].get<double>(), 0.45, 0.01);
  EXPECT_EQ(read_model(folder_ / "both_model.json").source, "a.csv, b.csv");
  const Answer twice = servotwin_says({"identify", a, b, a, "--axis", "X"});
  EXPECT_EQ(twice.status, 1) << twice;
  EXPECT_THAT(twice.err, HasSubstr("is given twice"));
  const Answer again = servotwin_says(
      {"identify", a, folder_.write("c.csv", "time[s],X.command[mm]\n0,1\n"), "--axis", "X"});
  EXPECT_EQ(again.status, 1) << again;
  EXPECT_THAT(again.err, HasSubstr("c.csv"));
}

TEST_F(Identify, TheResultSaysHowItCameAbout) {
  const Answer answer = identify({"--json", "-"});
  ASSERT_EQ(answer.status, 0) << answer;
  const json result = json::parse(answer.out);
  EXPECT_EQ(result["fit"]["method"], "pole-search");
  EXPECT_GT(result["fit"]["time_taken_s"].get<double>(), 0.0);
  EXPECT_GT(result["fit"]["condition_number"].get<double>(), 1.0);
  EXPECT_GT(result["fit"]["training"]["rms_m"].get<double>(), 0.0);
  const double floor = result["fit"]["noise_floor_rms_m"].get<double>();
  EXPECT_GT(floor, 0.0);
  EXPECT_LE(result["fit"]["noise_floor_interval_m"][0].get<double>(), floor);
  EXPECT_GE(result["fit"]["noise_floor_interval_m"][1].get<double>(), floor);
  EXPECT_EQ(result["data"]["source"], "rec.csv");
  EXPECT_EQ(result["data"]["rows"], 12001);
  double fastest = 0.0;  // of the motion it was recorded from
  for (double t = 0.0; t < 12.0; t += 1e-4)
    fastest = std::max(fastest, std::abs(rich_motion(t + 5e-5) - rich_motion(t - 5e-5)) / 1e-4);
  EXPECT_NEAR(result["data"]["motion"]["speed_m_per_s"], fastest, 0.03 * fastest);
  EXPECT_THAT(result["created"].get<std::string>(),
              testing::MatchesRegex("[0-9]{4}-[0-9]{2}-[0-9]{2}T[0-9]{2}:[0-9]{2}:[0-9]{2}Z"));
  EXPECT_EQ(result["refusals"], json::array());
  int chosen = 0;
  double least = 1e300;
  for (const json& trial : result["trials"]) {
    EXPECT_TRUE(trial["order"] == 2 || trial["order"] == 3);
    EXPECT_TRUE(trial["effects"].is_array());
    if (trial["chosen"].get<bool>()) ++chosen;
    if (trial["validation_rms_m"].is_number())
      least = std::min(least, trial["validation_rms_m"].get<double>());
  }
  EXPECT_EQ(chosen, 1);
  EXPECT_LT(least, 1e-6);
  EXPECT_THAT(answer.err, HasSubstr("12001 rows"));  // what was read, beside the result
  EXPECT_THAT(answer.err, HasSubstr("rec.csv: axis X"));
}

TEST_F(Identify, TellsPeopleOnStandardOutput) {
  const Answer answer = identify({});
  ASSERT_EQ(answer.status, 0) << answer;
  // A slow host says from time to time that it is at work.
  EXPECT_THAT(answer.err, testing::MatchesRegex("(identifying X, [0-9]+ s\n)*"));
  for (const char* said :
       {"12001 rows", "1000 Hz", "tried", "->",
        "structure   order 2: coulomb_friction, gravity_offset", "poles       pair 24.9",
        " Hz, damping 0.44", "numerator", "coulomb 0.2", "hold-out", "training", "noise floor",
        "excitation  sufficient", "time taken"}) {
    EXPECT_THAT(answer.out, HasSubstr(said));
  }
}

TEST_F(Identify, ThePredictionOfItsHoldOutIsItsHoldOutError) {
  const std::string model = folder_ / "model.json";
  const Answer identified = identify({"--model", model, "--json", "-"});
  ASSERT_EQ(identified.status, 0) << identified;
  const json result = json::parse(identified.out);
  const double from = result["data"]["training_to"].get<double>() + 0.0005;
  // Of the whole recording: the motion before the hold-out tells how it begins.
  const Answer predicted =
      servotwin_says({"predict", recording_, "--axis", "X", "--model", model, "--out", "-"});
  ASSERT_EQ(predicted.status, 0) << predicted;
  std::istringstream rows(predicted.out);
  std::string row;
  std::getline(rows, row);
  ASSERT_THAT(row, testing::EndsWith("X.residual[m]"));
  double sum = 0.0, most = 0.0, count = 0.0;
  while (std::getline(rows, row)) {
    if (std::stod(row) < from) continue;
    const double residual = std::stod(row.substr(row.rfind(',') + 1));
    sum += residual * residual, most = std::max(most, std::abs(residual)), count += 1.0;
  }
  const json& holdout = result["fit"]["holdout"];
  EXPECT_NEAR(std::sqrt(sum / count), holdout["rms_m"].get<double>(), 1e-12);
  EXPECT_NEAR(most, holdout["max_m"].get<double>(), 1e-12);
}

TEST_F(Identify, TwiceIsTheSame) {
  const auto result = [&] {
    json parsed = json::parse(identify({"--json", "-"}).out);
    parsed.erase("created");
    parsed["fit"].erase("time_taken_s");
    return parsed;
  };
  EXPECT_EQ(result(), result());
}

TEST_F(Identify, TheOrderCanBeGiven) {
  const json result = json::parse(identify({"--order", "3", "--json", "-"}).out);
  EXPECT_EQ(result["loop"]["order"], 3);
  for (const json& trial : result["trials"]) EXPECT_EQ(trial["order"], 3);
}

TEST_F(Identify, TheBoxOfThePolesIsKept) {
  const json result = json::parse(identify({"--order", "2", "--natural-frequency-hz", "30:60",
                                            "--damping", "0.6:0.9", "--json", "-"})
                                      .out);
  EXPECT_GE(result["loop"]["natural_frequency_hz"].get<double>(), 30.0 - 1e-4);
  EXPECT_GE(result["loop"]["damping_ratio"].get<double>(), 0.6 - 1e-6);
}

TEST_F(Identify, FullLeastSquaresSaysSo) {
  const Answer answer = identify({"--method", "full-ls", "--no-pole-constraints", "--json", "-"});
  const json result = json::parse(answer.out);
  EXPECT_EQ(result["fit"]["method"], "full-ls");
  EXPECT_EQ(result["loop"]["order"], 3);
}

TEST_F(Identify, WhatFullLeastSquaresDoesNotKnowIsRefused) {
  for (const std::vector<std::string>& option :
       {std::vector<std::string>{"--modes", "1"}, {"--coupling"}}) {
    std::vector<std::string> words{"--method", "full-ls"};
    words.insert(words.end(), option.begin(), option.end());
    const Answer answer = identify(words);
    EXPECT_NE(answer.status, 0);
    EXPECT_THAT(answer.err, HasSubstr(option.front() + " is not for --method full-ls"));
  }
}

TEST_F(Identify, CouplingNeedsAnotherAxis) {
  const Answer answer = identify({"--coupling"});
  EXPECT_NE(answer.status, 0);
  EXPECT_THAT(answer.err, HasSubstr("no other axis in the recording"));
}

TEST_F(Identify, TheModelMayGoToStandardOutput) {
  const Answer answer = identify({"--model", "-"});
  ASSERT_EQ(answer.status, 0) << answer;
  EXPECT_EQ(model_from_json(json::parse(answer.out)).axis, "X");
}

TEST_F(Identify, AForeignFileIsMapped) {
  std::string foreign = known_recording();
  foreign.replace(0, foreign.find('\n'), "t,soll,ist");
  const Answer answer = servotwin_says(
      {"identify", folder_.write("foreign.csv", foreign), "--axis", "A", "--columns",
       "time=t[s],A.command=soll[m],A.actual=ist[m]", "--method", "pole-search", "--json", "-"});
  ASSERT_EQ(answer.status, 0) << answer;
  const json ours = json::parse(identify({"--json", "-"}).out), theirs = json::parse(answer.out);
  EXPECT_EQ(theirs["axis"], "A");
  EXPECT_EQ(theirs["loop"]["poles"], ours["loop"]["poles"]);
}

TEST_F(Identify, AnEncoderThatCountsBackwardsIsRepairedUnlessItIsToStayAsRecorded) {
  std::string foreign = known_recording();
  foreign.replace(0, foreign.find('\n'), "t,soll,ist");
  std::vector<std::string> words{"identify",  folder_.write("foreign.csv", foreign),
                                 "--axis",    "X",
                                 "--columns", "time=t[s],X.command=soll[m],X.actual=ist[m*-1]",
                                 "--method",  "pole-search",
                                 "--json",    "-"};
  const Answer repaired = servotwin_says(words);
  ASSERT_EQ(repaired.status, 0) << repaired;
  EXPECT_THAT(repaired.err, HasSubstr("note: X: the encoder counts against its command"));
  words.push_back("--as-recorded");
  const Answer as_recorded = servotwin_says(words);
  EXPECT_EQ(as_recorded.status, 1) << as_recorded;
  EXPECT_THAT(as_recorded.err,
              HasSubstr("note: as recorded, so without this: X: the encoder counts against its "
                        "command: its sign is reversed"));
}

TEST(AsRecorded, CommandsThatPlayAFileHaveNoRepairToTurnOff) {
  for (const char* command : {"identify", "diagnose", "predict", "characterize", "sequence",
                              "frequency-response", "multivariable", "fit-axis"})
    EXPECT_THAT(servotwin_says({command, "--help"}).out, HasSubstr("--as-recorded")) << command;
  for (const char* command : {"simulate", "learn", "replay", "preview", "what-if"})
    EXPECT_THAT(servotwin_says({command, "--help"}).out, Not(HasSubstr("--as-recorded")))
        << command;
}

// The drive was tuned where the hold-out begins: it lags before and follows exactly after.
TEST_F(Identify, AModelThatMustNotBeUsedIsNotWritten) {
  const auto lagging = [](int k) {
    return cell(1e3 * rich_motion((k < 3600 ? k - 10 : k) / 1000.0));
  };
  const std::string wild = folder_.write(
      "wild.csv", recording(
                      6000, [](int k) { return cell(1e3 * rich_motion(k / 1000.0)); }, lagging));
  const std::string model = folder_ / "model.json", result = folder_ / "result.json";
  const Answer answer =
      servotwin_says({"identify", wild, "--axis", "X", "--model", model, "--json", result});
  EXPECT_EQ(answer.status, 1) << answer;
  ASSERT_EQ(answer.complaints().size(), 1U) << answer;
  EXPECT_THAT(answer.err, HasSubstr("must not be used"));
  EXPECT_THAT(answer.err, HasSubstr(model + " was not written"));
  EXPECT_THAT(folder_.list(), Not(Contains("model.json")));
  EXPECT_THAT(json::parse(content_of(result))["refusals"], Not(IsEmpty()));
}

class Predict : public Identify {
 protected:
  void SetUp() override { write_model(model_, known_axis()); }
  std::string model_ = folder_ / "model.json";
};

TEST_F(Predict, TheResultIsTheContract) {
  const Answer answer =
      servotwin_says({"predict", recording_, "--axis", "X", "--model", model_, "--json", "-"});
  ASSERT_EQ(answer.status, 0) << answer;
  const json result = json::parse(answer.out);
  EXPECT_EQ(result["schema"], "servotwin.prediction/1");
  EXPECT_EQ(result["axis"], "X");
  EXPECT_NEAR(result["rms_m"].get<double>(), 1e-6 / std::sqrt(12.0), 0.02e-6);
  EXPECT_GE(result["max_m"].get<double>(), result["rms_m"].get<double>());
  EXPECT_TRUE(result["noise_floor_rms_m"].is_number());
  ASSERT_EQ(result["segments"].size(), 1U);
  const json& segment = result["segments"][0];
  EXPECT_EQ(segment["from_s"], 0.0);
  EXPECT_EQ(segment["to_s"], 12.0);
  EXPECT_EQ(segment["rows"], 12001);
  EXPECT_EQ(segment["rms_m"], result["rms_m"]);
  EXPECT_FALSE(result["overlaps_training"].get<bool>());
}

TEST_F(Predict, TheStartingStateIsNotAmongTheRowsThatAreJudged) {
  const Answer answer =
      servotwin_says({"predict", recording_, "--axis", "X", "--model", model_, "--json", "-"});
  ASSERT_EQ(answer.status, 0) << answer;
  Segment whole;
  whole.sample_time_s = 0.001;
  const Eigen::Index used = starting_state_samples(known_axis().model, whole);
  EXPECT_GT(used, 20);
  EXPECT_EQ(json::parse(answer.out)["segments"][0]["rows_judged"], 12001 - used);
}

TEST_F(Predict, SaysWhereTheModelWasFittedToThisRecording) {
  ModelRecord record = known_axis();
  record.source = "rec.csv";
  record.training_to_s = 7.2;
  record.to_s = 12.0;
  const auto predicted = [&](const std::string& from, const std::string& to) {
    write_model(model_, record);
    return servotwin_says({"predict", recording_, "--axis", "X", "--model", model_, "--from", from,
                           "--to", to, "--json", "-"});
  };
  const auto expect = [&](const Answer& answer, bool overlaps) {
    ASSERT_EQ(answer.status, 0) << answer;
    EXPECT_EQ(json::parse(answer.out)["overlaps_training"], overlaps);
    const auto said = HasSubstr(
        "note: the model was fitted to 0.00 to 7.20 s of this recording, so this comparison is no "
        "validation; its held-out data are 7.20 to 12.00 s");
    if (overlaps) {
      EXPECT_THAT(answer.err, said);
    } else {
      EXPECT_THAT(answer.err, Not(HasSubstr("fitted")));
    }
  };
  expect(predicted("0", "12"), true);
  expect(predicted("7", "12"), true);
  expect(predicted("7.2005", "12"), false);
  record.source = "other.csv";
  expect(predicted("0", "12"), false);
}

TEST_F(Predict, ANoiseFloorThatIsNotShownIsNotKnown) {
  // 0.1 s of motion: too few readings to see noise or a step of the encoder, and no lap.
  const Answer answer = servotwin_says({"predict", recording_, "--axis", "X", "--model", model_,
                                        "--from", "3", "--to", "3.08", "--json", "-"});
  ASSERT_EQ(answer.status, 0) << answer;
  EXPECT_THAT(answer.err, HasSubstr("noise floor            not known"));
  EXPECT_TRUE(json::parse(answer.out)["noise_floor_rms_m"].is_null());
}

TEST_F(Predict, EverySegmentIsJudged) {
  std::istringstream lines(known_recording());
  std::string with_gap, line;
  for (int row = -1; std::getline(lines, line); ++row) {
    if (row < 5000 || row >= 6000) with_gap += line + "\n";
  }
  const Answer answer = servotwin_says({"predict", folder_.write("gap.csv", with_gap), "--axis",
                                        "X", "--model", model_, "--json", "-"});
  ASSERT_EQ(answer.status, 0) << answer;
  const json result = json::parse(answer.out);
  ASSERT_EQ(result["segments"].size(), 2U);
  EXPECT_EQ(result["segments"][0]["rows"], 5000);
  EXPECT_EQ(result["segments"][1]["from_s"], 6.0);
  for (const json& segment : result["segments"]) EXPECT_LT(segment["rms_m"].get<double>(), 0.4e-6);
  EXPECT_THAT(answer.err, HasSubstr("gap of 1.001 s"));
}

TEST_F(Predict, TheTableIsMeasuredMinusPredictedRowByRow) {
  const Answer answer =
      servotwin_says({"predict", recording_, "--axis", "X", "--model", model_, "--out", "-"});
  ASSERT_EQ(answer.status, 0) << answer;
  std::istringstream table(answer.out);
  std::string header, line;
  std::getline(table, header);
  EXPECT_EQ(
      header,
      "time[s],X.command[m],X.actual[m],X.measured_error[m],X.predicted_error[m],X.residual[m]");
  int rows = 0;
  while (std::getline(table, line)) {
    double time = 0, command = 0, actual = 0, measured = 0, predicted = 0, residual = 0;
    ASSERT_EQ(std::sscanf(line.c_str(), "%lf,%lf,%lf,%lf,%lf,%lf", &time, &command, &actual,
                          &measured, &predicted, &residual),
              6)
        << line;
    ASSERT_NEAR(time, rows / 1000.0, 1e-9);
    ASSERT_EQ(measured, command - actual);
    ASSERT_EQ(residual, measured - predicted);
    ++rows;
  }
  EXPECT_EQ(rows, 12001);
  EXPECT_THAT(answer.err, HasSubstr("um RMS"));
}

TEST_F(Predict, AnotherRateIsSaidAndDiscretisedAnew) {
  std::istringstream lines(known_recording());
  std::string thinned, line;
  for (int row = -1; std::getline(lines, line); ++row) {
    if (row < 0 || row % 2 == 0) thinned += line + "\n";
  }
  const Answer answer = servotwin_says({"predict", folder_.write("thin.csv", thinned), "--axis",
                                        "X", "--model", model_, "--json", "-"});
  ASSERT_EQ(answer.status, 0) << answer;
  EXPECT_THAT(answer.err, HasSubstr("identified at 1000 Hz and is used at 500 Hz"));
  EXPECT_LT(json::parse(answer.out)["rms_m"].get<double>(), 0.35e-6);
}

}  // namespace
}  // namespace servotwin
