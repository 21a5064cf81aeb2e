#include "daemon/record/residual_watch.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <sstream>

#include "tests/daemon/support.h"

namespace servotwin::daemon {
namespace {

using testing::AllOf;
using testing::HasSubstr;
using testing::IsEmpty;

/// A machine with a cycle of one second, so that every cycle in motion is a block.
class ResidualWatchTest : public testing::Test {
 protected:
  ResidualWatchTest() { config_.reference_s = 60.0; }

  /// X moves with this residual; B, rotary, stands still except for its first two cycles.
  void run(ResidualWatch& watch, int cycles, double residual) {
    for (int i = 0; i < cycles; ++i) {
      CycleRow row;
      row.after_gap = false;
      row.axis_count = 2;
      row.axes[0].command = static_cast<double>(++cycle_);
      row.axes[1].command = 1.0;
      row.residuals[0] = {i % 2 == 0 ? residual : -residual, 1e-6, version_};
      row.residuals[1] = {1.0, 1e-6, 1};
      watch.append(row);
    }
  }
  [[nodiscard]] std::vector<std::string> events(const std::string& kind) const {
    std::vector<std::string> out;
    for (const Event& event : store_.events(1000)) {
      if (event.kind == kind) out.push_back(event.axis + ": " + event.text);
    }
    return out;
  }

  TemporaryDirectory directory_;
  MachineDescription machine_{1.0, {{"X", false, ""}, {"B", true, ""}}};
  DiagnoseConfig config_;
  std::ostringstream said_;
  Store store_{directory_.path(), "mill"};
  EventLog events_{store_, said_};
  int cycle_ = 0, version_ = 1;
};

TEST_F(ResidualWatchTest, AnAlarmIsAnEventWithItsFiguresAndIsTakenOnce) {
  ResidualWatch watch(machine_, config_, events_);
  run(watch, 61, 1e-6);
  EXPECT_FALSE(watch.take_alarm(0));
  EXPECT_THAT(events("alarm_reference"),
              testing::ElementsAre(
                  "X: the residual is monitored: 1 um RMS is normal, learned from 60 s of motion"));
  run(watch, 30, 3e-6);
  // y grows by 2 ln 3 = 2.2, which is 6 times the minimum deviation and is limited to 3; minus the
  // drift, six blocks raise the sum from 0 to 15, above 12.9.
  EXPECT_THAT(
      events("alarm_raised"),
      testing::ElementsAre("X: alarm: the residual has grown: 3 um RMS over the last 6 s of "
                           "motion, normal is 1 um (CUSUM above 12.9; on average one false "
                           "alarm in 30 days of motion)"));
  EXPECT_EQ(watch.take_alarm(0),
            "the residual has grown: 3 um RMS over the last 6 s of motion, normal is 1 um");
  EXPECT_FALSE(watch.take_alarm(0));
  EXPECT_FALSE(watch.take_alarm(1)) << "whatever a standing axis leaves";

  run(watch, 60, 1e-6);
  EXPECT_THAT(events("alarm_cleared"),
              testing::ElementsAre(AllOf(HasSubstr("X: alarm over: the residual is back at its "
                                                   "normal 1 um; it was "),
                                         HasSubstr("s of motion"))));
  EXPECT_FALSE(watch.take_alarm(0));
}

TEST_F(ResidualWatchTest, ANewModelsReferenceEndsTheAlarmAndIsSaid) {
  ResidualWatch watch(machine_, config_, events_);
  run(watch, 61, 1e-6);
  version_ = 2;
  run(watch, 60, 1.8e-6);
  EXPECT_THAT(events("alarm_raised"), testing::SizeIs(1));
  EXPECT_THAT(events("alarm_cleared"),
              testing::ElementsAre("X: alarm over: the model in force has a reference of its own"));
  EXPECT_THAT(events("alarm_reference"),
              testing::Contains("X: the residual is monitored: 1.8 um RMS is normal, learned "
                                "from 60 s of motion"));
}

TEST_F(ResidualWatchTest, OnlyWhatFollowsACycleBeforeIsMotion) {
  ResidualWatch watch(machine_, config_, events_);
  run(watch, 61, 1e-6);
  CycleRow row;
  row.axis_count = 2;
  row.residuals[0] = {1e-3, 1e-6, 1};
  for (int i = 0; i < 200; ++i) {
    row.after_gap = i % 2 == 0;
    row.axes[0].command = i % 2 == 0 ? i : (i % 4 == 1 ? kAbsent : row.axes[0].command);
    watch.append(row);
  }
  EXPECT_THAT(events("alarm_raised"), IsEmpty());
}

TEST_F(ResidualWatchTest, NoneWhereNoneIsWanted) {
  config_.false_alarm_days = 0.0;
  ResidualWatch watch(machine_, config_, events_);
  run(watch, 61, 1e-6);
  run(watch, 100, 3e-3);
  EXPECT_THAT(events("alarm_raised"), IsEmpty());
  EXPECT_FALSE(watch.take_alarm(0));
}

}  // namespace
}  // namespace servotwin::daemon
