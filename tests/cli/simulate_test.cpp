// servotwin simulate, and predict as its inverse: the residual is the noise that was added.
#include <gmock/gmock.h>

#include <cmath>
#include <nlohmann/json.hpp>

#include "drivers/recordings/recording_file.h"
#include "program.h"
#include "recordings.h"
#include "twin/twin.h"

namespace servotwin {
namespace {

using nlohmann::json;
using testing::HasSubstr;
using testing::Not;

class Simulate : public testing::Test {
 protected:
  void SetUp() override { write_model(model_, known_axis()); }

  /// Simulates the table with these options, then predicts it with the same model: RMS and MAX left
  /// [m].
  json left(const std::vector<std::string>& options) {
    std::vector<std::string> words{"simulate", table_,  "--model",
                                   model_,     "--out", folder_ / "sim.csv"};
    words.insert(words.end(), options.begin(), options.end());
    const Answer simulated = servotwin_says(words);
    EXPECT_EQ(simulated.status, 0) << simulated;
    const Answer predicted = servotwin_says(
        {"predict", folder_ / "sim.csv", "--axis", "X", "--model", model_, "--json", "-"});
    EXPECT_EQ(predicted.status, 0) << predicted;
    return json::parse(predicted.out);
  }

  Folder folder_;
  std::string model_ = folder_ / "model.json";
  std::string table_ = folder_.write("path.csv", command_table());
};

TEST_F(Simulate, PredictsItsOwnMachineExactly) {
  const json exact = left({});
  EXPECT_LT(exact["max_m"].get<double>(),
            1e-9);  // the starting state is found from numbers of 1e-16 m
}

TEST_F(Simulate, AnEncoderOfOneMicrometreLeavesItsQuantisation) {
  const json quantised = left({"--noise", "1"});
  EXPECT_NEAR(quantised["rms_m"].get<double>(), 1e-6 / std::sqrt(12.0), 0.02e-6);
  EXPECT_LT(quantised["max_m"].get<double>(), 0.6e-6);
}

TEST_F(Simulate, NoiseHasTheDeviationItWasGiven) {
  const json noisy = left({"--noise", "0:2"});
  EXPECT_NEAR(noisy["rms_m"].get<double>(), 2e-6,
              0.06e-6);  // 3 % for 12,000 numbers is over four deviations
}

TEST_F(Simulate, GivesTheTorqueOfAModelThatHasOne) {
  // Of known_axis(): friction and constant force per moved mass.
  constexpr double kFriction = 0.25, kConstant = -0.04, kSliding_mps = 0.01;
  constexpr double kMass = 30.0, kViscous = 500.0, kOffset = -2.0;
  json file = json::parse(content_of(model_));
  file["torque"] = {{"unit", "N"},
                    {"per_acceleration", kMass},
                    {"per_velocity", kViscous},
                    {"offset", kOffset},
                    {"lag_s", 0.0}};
  folder_.write("model.json", file.dump());
  const json exact = left({});
  EXPECT_LT(exact["torque"]["rms"].get<double>(), 1e-6);
  const Recording made = read_recording(folder_ / "sim.csv");
  const AxisRecord& axis = made.axes.front();
  ASSERT_EQ(axis.torque_unit, "N");
  double largest = 0.0, squares = 0.0, count = 0.0;
  for (std::size_t k = 1; k + 1 < made.time.size(); ++k) {
    largest = std::max(largest, std::abs(axis.torque[k]));
    const double h = made.time[k + 1] - made.time[k],
                 velocity = (axis.actual[k + 1] - axis.actual[k - 1]) / (2.0 * h),
                 acceleration =
                     (axis.actual[k + 1] - 2.0 * axis.actual[k] + axis.actual[k - 1]) / (h * h);
    if (std::abs(velocity) < kSliding_mps) continue;
    const double force = acceleration + std::copysign(kFriction, velocity) + kConstant;
    squares += std::pow(axis.torque[k] - kMass * force - kViscous * velocity - kOffset, 2);
    count += 1.0;
  }
  EXPECT_GT(count, 1000.0);
  EXPECT_LT(std::sqrt(squares / count), 0.005 * largest);
  EXPECT_GT(largest, 10.0);  // or it shows nothing
  EXPECT_NEAR(std::max(exact["torque"]["highest_predicted"].get<double>(),
                       -exact["torque"]["lowest_predicted"].get<double>()),
              largest, 1e-6 * largest);
  const Answer table = servotwin_says({"predict", folder_ / "sim.csv", "--axis", "X", "--model",
                                       model_, "--out", folder_ / "pred.csv"});
  EXPECT_THAT(table.out, HasSubstr(" N predicted, "));
  EXPECT_THAT(content_of(folder_ / "pred.csv"), HasSubstr("X.torque[N],X.predicted_torque[N]"));
}

TEST_F(Simulate, WritesWhatTheTwinSays) {
  const Answer answer = servotwin_says({"simulate", table_, "--model", model_, "--out", "-"});
  ASSERT_EQ(answer.status, 0) << answer;
  const Recording written = read_recording(folder_.write("sim.csv", answer.out));
  const Recording table = read_recording(table_);
  ASSERT_EQ(written.axes.size(), 1U);
  EXPECT_EQ(written.axes[0].command, table.axes[0].command);
  Segment segment;
  segment.sample_time_s = 0.001;
  segment.command = Eigen::Map<const Eigen::ArrayXd>(table.axes[0].command.data(),
                                                     static_cast<Eigen::Index>(table.time.size()));
  const Eigen::ArrayXd error = simulate(known_axis().model, segment);
  for (Eigen::Index i = 0; i < error.size(); i += 500) {
    EXPECT_NEAR(written.axes[0].actual[static_cast<std::size_t>(i)], segment.command(i) - error(i),
                1e-12)
        << i;
  }
}

TEST_F(Simulate, TheSeedDecidesTheNoise) {
  const auto with_seed = [&](const std::string& seed) {
    return servotwin_says({"simulate", table_, "--model", model_, "--noise", "0.1:1", "--seed",
                           seed, "--out", "-"})
        .out;
  };
  const std::string first = with_seed("1");
  EXPECT_EQ(first, with_seed("1"));
  EXPECT_NE(first, with_seed("2"));
}

// X and Y push each other: predict finds again what simulate has made of both, from the commands.
TEST_F(Simulate, MovesAxesTogetherThatPushEachOther) {
  const std::string of_y = folder_ / "y.json";
  for (const std::string name : {"X", "Y"}) {
    ModelRecord record = known_axis(name);
    record.neighbour = name == "X" ? "Y" : "X";
    record.model.effects.push_back(make_effect<CrossCouplingByMotion>());
    record.model.effects.back().coefficient[0] = -0.1;
    record.effect_deviations.resize(record.model.effects.size());
    write_model(name == "X" ? model_ : of_y, record);
  }
  std::string rows = "time[s],X.command[mm],Y.command[mm]\n";
  for (int k = 0; k < 12'000; ++k) {
    const double t = 1e-3 * k;
    rows += cell(t) + "," + cell(1e3 * rich_motion(t)) + "," +
            cell(1e3 * rich_motion(std::max(0.0, t - 0.7))) + "\n";
  }
  const std::string both = folder_.write("both.csv", rows), made = folder_ / "made.csv";
  const Answer simulated =
      servotwin_says({"simulate", both, "--model", model_, "--model", of_y, "--out", made});
  ASSERT_EQ(simulated.status, 0) << simulated;
  EXPECT_THAT(simulated.out + simulated.err, Not(HasSubstr("stands in")));
  const Answer together = servotwin_says({"predict", made, "--axis", "X", "--model", model_,
                                          "--axis", "Y", "--model", of_y, "--json", "-"});
  ASSERT_EQ(together.status, 0) << together;
  const json of_both = json::parse(together.out);
  for (const json& axis : of_both.at("axes")) {
    EXPECT_LT(axis.at("max_m").get<double>(), 2e-9);
    EXPECT_THAT(axis.at("predicted_from").get<std::string>(), HasSubstr("the commands of"));
  }
  const Answer alone =
      servotwin_says({"predict", made, "--axis", "X", "--model", model_, "--json", "-"});
  EXPECT_THAT(json::parse(alone.out).at("predicted_from").get<std::string>(),
              HasSubstr("the recorded motion of Y"));
  const Answer blind = servotwin_says({"simulate", both, "--model", model_, "--out", made});
  EXPECT_THAT(blind.out, HasSubstr("the motion of axis Y, which has no --model here: its command "
                                   "stands in"));
}

TEST_F(Simulate, AnAxisDoesNotDependOnItsNeighbour) {
  std::string two = "time[s],X.command[mm],Y.command[mm]\n";
  for (int k = 0; k < 2000; ++k) {
    const std::string x = cell(1e3 * rich_motion(k / 1000.0));
    two += cell(k / 1000.0) + "," + x + "," + x + "\n";
  }
  const std::string table = folder_.write("two.csv", two), other = folder_ / "y.json";
  write_model(other, known_axis("Y"));
  const auto simulated = [&](const std::vector<std::string>& models) {
    std::vector<std::string> words{"simulate", table,   "--noise",
                                   "0:1",      "--out", folder_ / "sim.csv"};
    for (const std::string& model : models) words.insert(words.end(), {"--model", model});
    const Answer answer = servotwin_says(words);
    EXPECT_EQ(answer.status, 0) << answer;
    return read_recording(folder_ / "sim.csv");
  };
  const Recording both = simulated({model_, other}), alone = simulated({other});
  ASSERT_EQ(both.axes.size(), 2U);
  EXPECT_EQ(both.axes[1].name, "Y");
  EXPECT_EQ(both.axes[1].actual, alone.axes[0].actual);
  EXPECT_NE(both.axes[0].actual, both.axes[1].actual);  // noise of their own
}

TEST_F(Simulate, WhatEncodersRecordedDoesNotCount) {
  const auto simulated = [&](const std::string& table) {
    return servotwin_says({"simulate", table, "--model", model_, "--out", "-"}).out;
  };
  const auto command = [](int k) { return cell(1e3 * rich_motion(k / 1000.0)); };
  const std::string recorded =
      folder_.write("rec.csv", recording(3000, command, [](int k) { return cell(0.01 * k); }));
  const std::string commanded =
      folder_.write("cmd.csv", recording(3000, command, [](int) { return std::string(); }));
  EXPECT_EQ(simulated(recorded), simulated(commanded));
  EXPECT_THAT(simulated(recorded), HasSubstr("X.actual[m]"));
}

TEST_F(Simulate, SaysWhatItRead) {
  const Answer answer = servotwin_says({"simulate", table_, "--model", model_});
  EXPECT_EQ(answer.status, 0) << answer;
  EXPECT_THAT(answer.out, HasSubstr("axis X: 12001 rows over 12 s"));
  EXPECT_THAT(answer.out, HasSubstr("X: tracking error"));
  EXPECT_THAT(answer.out, Not(HasSubstr("note:")));
}

TEST_F(Simulate, SaysWhatItRepairedAndWhatItLeavesOut) {
  std::string table = "time[s],X.command[mm],X.torque[Nm],Y.command[mm],Y.torque[Nm]\n";
  for (int k = 0; k < 2000; ++k) {
    if (k == 700 || k == 900) continue;
    const std::string x = cell(1e3 * rich_motion(k / 1000.0));
    table += cell(k / 1000.0) + "," + x + ",1," + x + ",1\n";
  }
  const Answer answer = servotwin_says({"simulate", folder_.write("rec.csv", table), "--model",
                                        model_, "--out", folder_ / "sim.csv"});
  EXPECT_EQ(answer.status, 0) << answer;
  EXPECT_THAT(answer.out, HasSubstr("bridged 2 gaps"));
  EXPECT_THAT(answer.out, HasSubstr("note: not simulated: X.torque, axis Y (no --model of it)"));
}

// The encoder's channel is not used, so gaps in it are no gaps in the command.
TEST_F(Simulate, AHoleInTheEncoderIsNoneInTheCommand) {
  const auto command = [](int k) { return cell(k == 1000 ? 1.0 : 1e3 * rich_motion(k / 1000.0)); };
  const auto hole = [](int k) { return k == 1000 ? std::string() : std::string("0"); };
  const Answer answer =
      servotwin_says({"simulate", folder_.write("rec.csv", recording(3000, command, hole)),
                      "--model", model_, "--out", folder_ / "sim.csv"});
  EXPECT_EQ(answer.status, 0) << answer;
  EXPECT_THAT(answer.out, Not(HasSubstr("bridged")));
  EXPECT_EQ(read_recording(folder_ / "sim.csv").axes.at(0).command.at(1000), 0.001);
}

TEST_F(Simulate, RefusesATableWithoutTheAxis) {
  write_model(folder_ / "z.json", known_axis("Z"));
  const Answer answer = servotwin_says(
      {"simulate", table_, "--model", folder_ / "z.json", "--out", folder_ / "sim.csv"});
  EXPECT_EQ(answer.status, 1);
  ASSERT_EQ(answer.complaints().size(), 1U) << answer;
  EXPECT_THAT(answer.err, HasSubstr("has no axis 'Z'"));
  EXPECT_THAT(answer.err, HasSubstr("it has X"));
  EXPECT_THAT(folder_.list(), testing::Not(testing::Contains("sim.csv")));
}

TEST_F(Simulate, RefusesTwoModelsOfOneAxis) {
  const Answer answer = servotwin_says({"simulate", table_, "--model", model_, "--model", model_});
  EXPECT_EQ(answer.status, 2);
  EXPECT_THAT(answer.err, HasSubstr("second model of axis 'X'"));
  EXPECT_EQ(answer.out, "");  // found before any work
}

TEST_F(Simulate, RefusesAPathThatBreaksOff) {
  std::string table = "time[s],X.command[mm]\n";
  for (int k = 0; k < 2000; ++k)
    table += cell((k < 1000 ? k : k + 500) / 1000.0) + "," + cell(k * 0.001) + "\n";
  const Answer answer =
      servotwin_says({"simulate", folder_.write("gap.csv", table), "--model", model_});
  EXPECT_EQ(answer.status, 1);
  ASSERT_EQ(answer.complaints().size(), 1U) << answer;
  EXPECT_THAT(answer.err, HasSubstr("X.command is interrupted at 0.999 s"));
}

class PredictTwoAxes : public Simulate {
 protected:
  void SetUp() override {
    Simulate::SetUp();
    write_model(second_, known_axis("Y"));
  }
  json predicted(const std::string& recording) {
    const Answer answer =
        servotwin_says({"predict", recording, "--axis", "X", "--axis", "Y", "--model", model_,
                        "--model", second_, "--json", "-", "--out", folder_ / "rows.csv"});
    EXPECT_EQ(answer.status, 0) << answer;
    return json::parse(answer.out);
  }
  std::string second_ = folder_ / "second.json";
};

// A circle run counter-clockwise, and encoders on one that is wider by 3 um and lags.
TEST_F(PredictTwoAxes, TheMeasuredContourErrorOfACircleIsTheDifferenceOfTheRadii) {
  constexpr double kRadius_mm = 8.0, kWider_mm = 3e-3, kOmega = 2.0, kLag = 0.01;
  std::string table = "time[s],X.command[mm],X.actual[mm],Y.command[mm],Y.actual[mm]\n";
  for (int k = 0; k < 4000; ++k) {
    const double t = 0.001 * k, angle = kOmega * t;
    table += cell(t) + "," + cell(kRadius_mm * std::cos(angle)) + "," +
             cell((kRadius_mm + kWider_mm) * std::cos(angle - kLag)) + "," +
             cell(kRadius_mm * std::sin(angle)) + "," +
             cell((kRadius_mm + kWider_mm) * std::sin(angle - kLag)) + "\n";
  }
  const json result = predicted(folder_.write("circle.csv", table));
  ASSERT_EQ(result["axes"].size(), 2U);
  EXPECT_EQ(result["axes"][1]["axis"], "Y");
  const json& measured = result["contour"]["measured"];
  EXPECT_NEAR(measured["rms_m"].get<double>(), 3e-6, 0.01e-6);
  EXPECT_NEAR(measured["max_m"].get<double>(), 3e-6, 0.01e-6);
  EXPECT_TRUE(result["contour"]["predicted"]["rms_m"].is_number());
  const Recording rows = read_recording(folder_ / "rows.csv");
  ASSERT_EQ(rows.axes.size(), 2U);
  EXPECT_EQ(rows.time.size(), 4000U);
}

TEST_F(PredictTwoAxes, AMachineThatIsTheModelHasTheContourErrorThatIsPredicted) {
  std::string table = "time[s],X.command[mm],Y.command[mm]\n";
  for (int k = 0; k < 4000; ++k) {
    const double t = 0.001 * k;
    table += cell(t) + "," + cell(1e3 * rich_motion(t)) + "," + cell(700.0 * rich_motion(0.8 * t)) +
             "\n";
  }
  const Answer simulated =
      servotwin_says({"simulate", folder_.write("paths.csv", table), "--model", model_, "--model",
                      second_, "--out", folder_ / "sim.csv"});
  ASSERT_EQ(simulated.status, 0) << simulated;
  const json contour = predicted(folder_ / "sim.csv")["contour"];
  EXPECT_GT(contour["measured"]["rms_m"].get<double>(), 1e-6);
  EXPECT_NEAR(contour["predicted"]["rms_m"].get<double>(),
              contour["measured"]["rms_m"].get<double>(), 1e-9);
  EXPECT_LT(contour["residual"]["rms_m"].get<double>(), 1e-9);
}

TEST_F(PredictTwoAxes, NeedsAModelForEach) {
  for (const std::vector<std::string>& words :
       {std::vector<std::string>{"--axis", "X", "--axis", "Y", "--model", model_},
        {"--axis", "X", "--axis", "Y", "--model", second_, "--model", model_},
        {"--axis", "X", "--axis", "X", "--model", model_, "--model", model_}}) {
    std::vector<std::string> all{"predict", table_};
    all.insert(all.end(), words.begin(), words.end());
    const Answer answer = servotwin_says(all);
    EXPECT_EQ(answer.status, 2) << answer;
    EXPECT_EQ(answer.complaints().size(), 1U) << answer;
  }
}

}  // namespace
}  // namespace servotwin
