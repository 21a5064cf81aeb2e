// servotwin diagnose: the test motion that it writes is a path that the other commands read.
#include <gmock/gmock.h>

#include <cmath>
#include <nlohmann/json.hpp>
#include <numbers>

#include "drivers/recordings/recording_file.h"
#include "program.h"
#include "recordings.h"

namespace servotwin {
namespace {

using nlohmann::json;
using testing::ElementsAre;
using testing::HasSubstr;

class Diagnose : public testing::Test {
 protected:
  void SetUp() override { write_model(model_, known_axis()); }

  /// The answer for a recording of the known axis along this motion, with --suggested-test.
  Answer diagnosed(const std::function<double(double)>& motion) {
    const std::string path = folder_.write("path.csv", command_table(8.0, motion));
    const Answer simulated = servotwin_says(
        {"simulate", path, "--model", model_, "--noise", "0.01:0.02", "--out", recording_});
    EXPECT_EQ(simulated.status, 0) << simulated;
    return servotwin_says({"diagnose", recording_, "--axis", "X", "--suggested-test",
                           folder_ / "test", "--json", folder_ / "diagnosis.json", "--report",
                           folder_ / "report.html"});
  }

  Folder folder_;
  std::string model_ = folder_ / "model.json";
  std::string recording_ = folder_ / "recording.csv";
};

TEST_F(Diagnose, WritesTheTestMotionWhereSomethingIsInDoubt) {
  // In one direction only, friction is not observable.
  const Answer answer = diagnosed([](double t) {
    const double turns = 2.0 * std::numbers::pi * t / 2.0;
    return 0.02 * (turns - std::sin(turns)) / std::numbers::pi;
  });
  ASSERT_EQ(answer.status, 0) << answer;
  EXPECT_THAT(answer.out, HasSubstr("test        Run "));
  EXPECT_THAT(answer.out, HasSubstr("move there and back at least twice"));
  const json diagnosis = json::parse(content_of(folder_ / "diagnosis.json"));
  EXPECT_THAT(diagnosis["suggested_test"].get<std::string>(), HasSubstr("Run "));
  EXPECT_THAT(diagnosis["suggested_test_files"],
              ElementsAre(folder_ / "test.csv", folder_ / "test.nc"));
  EXPECT_THAT(content_of(folder_ / "test.nc"), HasSubstr("G1 X"));
  const Answer simulated = servotwin_says({"simulate", folder_ / "test.csv", "--model", model_});
  EXPECT_EQ(simulated.status, 0) << simulated;
  EXPECT_THAT(simulated.out, HasSubstr("1 segment"));
}

TEST_F(Diagnose, RefusesARecordingWithoutAnEncoder) {
  const std::string path = folder_.write("commands.csv", command_table(8.0, rich_motion));
  for (const std::vector<std::string>& arguments :
       {std::vector<std::string>{"diagnose", path}, {"diagnose", path, "--model", model_}}) {
    const Answer answer = servotwin_says(arguments);
    EXPECT_EQ(answer.status, 1) << answer;
    EXPECT_THAT(answer.err, HasSubstr("X.actual has no values; the encoder is needed"));
  }
}

TEST_F(Diagnose, SaysThatNoneIsNeeded) {
  const Answer answer = diagnosed(rich_motion);
  ASSERT_EQ(answer.status, 0) << answer;
  EXPECT_THAT(
      answer.out,
      HasSubstr("test        none is needed: no cause found in the position loop is in doubt"));
  const json diagnosis = json::parse(content_of(folder_ / "diagnosis.json"));
  EXPECT_TRUE(diagnosis["suggested_test"].is_null());
  EXPECT_FALSE(diagnosis.contains("suggested_test_files"));
  EXPECT_EQ(diagnosis["residual"]["by_regressor"].size(), 8U);
  EXPECT_TRUE(diagnosis["residual"]["by_regressor"]["velocity"].contains("chance"));
  EXPECT_TRUE(diagnosis["residual"]["spectrum_peaks"].is_array());
}

// A load that stands 5 um behind its motor, on either side by the direction of the command.
TEST_F(Diagnose, SaysWhatTwoEncodersShow) {
  const auto motion = [](double t) {
    return 0.02 * std::sin(2.0 * std::numbers::pi * 0.6 * t) - 0.006 * std::sin(5.0 * t);
  };
  ASSERT_EQ(diagnosed(motion).status, 0);
  const Recording load = read_recording(recording_);
  const AxisRecord& x = load.axes.at(0);
  std::string table = "time[s],X.command[mm],X.actual[mm],X.actual_motor[mm]\n";
  for (std::size_t k = 0; k + 1 < load.time.size(); ++k) {
    const double behind = x.command[k + 1] > x.command[k] ? 5e-6 : -5e-6;
    table += cell(load.time[k]) + ',' + cell(1e3 * x.command[k]) + ',' + cell(1e3 * x.actual[k]) +
             ',' + cell(1e3 * (x.actual[k] + behind)) + '\n';
  }
  const Answer answer = servotwin_says({"diagnose", folder_.write("both.csv", table), "--json",
                                        folder_ / "both.json", "--report", folder_ / "both.html"});
  ASSERT_EQ(answer.status, 0) << answer;
  EXPECT_THAT(answer.out, HasSubstr("two encoders, following error "));
  EXPECT_THAT(answer.out, HasSubstr("encoders    Between the encoders: play of "));
  const json shown = json::parse(content_of(folder_ / "both.json"))["encoder_difference"];
  EXPECT_TRUE(shown["play_m"]["shown"].get<bool>());
  EXPECT_NEAR(shown["play_m"]["value"].get<double>(), 10e-6, 0.05e-6);
  EXPECT_THAT(content_of(folder_ / "both.html"), HasSubstr("Between the encoders: play of "));
}

}  // namespace
}  // namespace servotwin
