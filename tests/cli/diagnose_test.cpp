// servotwin diagnose: the test motion that it writes is a path that the other commands read.
#include <gmock/gmock.h>

#include <cmath>
#include <nlohmann/json.hpp>
#include <numbers>

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

}  // namespace
}  // namespace servotwin
