#include "daemon/input/frame_source.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "daemon/between/clock.h"
#include "tests/daemon/support.h"

namespace servotwin::daemon {
namespace {

using testing::HasSubstr;

Replay recording_at(const std::vector<double>& time, const std::string& axis = "X",
                    double cycle_s = 0.001) {
  Recording recording;
  recording.source = "made";
  recording.time = time;
  AxisRecord x;
  x.name = axis;
  for (std::size_t i = 0; i < time.size(); ++i) {
    x.command.push_back(static_cast<double>(i));
    x.actual.push_back(0.0);
  }
  recording.axes.push_back(x);
  return {recording, cycle_s};
}

template <class... R>
std::vector<Replay> list(R&&... one) {
  std::vector<Replay> out;
  (out.push_back(std::forward<R>(one)), ...);
  return out;
}

TEST(ReplaySource, GivesOneRecordingAfterTheOtherAndThenEnds) {
  ReplaySource source(list(recording_at({0.0, 0.001, 0.002}), recording_at({5.0, 5.001})), 0.0);
  MachineFrame frame;
  std::vector<std::uint64_t> sequence;
  std::vector<double> commands;
  while (source.receive(frame, 1.0) == Received::kFrame) {
    sequence.push_back(frame.sequence);
    commands.push_back(frame.axes[0].command);
  }
  EXPECT_EQ(sequence, (std::vector<std::uint64_t>{0, 1, 2, 0, 1}));
  EXPECT_EQ(commands, (std::vector<double>{0, 1, 2, 0, 1}));
  EXPECT_EQ(source.receive(frame, 1.0), Received::kEnd);
}

TEST(ReplaySource, WaitsNoLongerThanItMayAndLosesNothingByThat) {
  ReplaySource source(list(recording_at({0.0, 0.001, 3600.0})), 1.0);
  MachineFrame frame;
  ASSERT_EQ(source.receive(frame, 60.0), Received::kFrame);
  ASSERT_EQ(source.receive(frame, 60.0), Received::kFrame);
  EXPECT_EQ(frame.axes[0].command, 1.0);
  for (int i = 0; i < 3; ++i)
    EXPECT_EQ(source.receive(frame, 0.001), Received::kNothing) << "an hour too early";
}

TEST(ReplaySource, WaitsForThoseThatAreBehindAndCatchesUpWithNobody) {
  ReplaySource source(list(recording_at({0.0, 0.001, 0.002, 0.050})), 1.0);
  int asked = 0;
  bool behind = false;
  source.wait_while([&] { return ++asked, behind; });
  MachineFrame frame;
  const std::int64_t began_ns = steady_ns();
  ASSERT_EQ(source.receive(frame, 60.0), Received::kFrame);
  behind = true;
  for (int i = 0; i < 3; ++i)
    EXPECT_EQ(source.receive(frame, 0.02), Received::kNothing) << "its time has come, ours has not";
  EXPECT_GT(asked, 10) << "and somebody is looked at again and again";
  behind = false;
  for (const double command : {1.0, 2.0, 3.0}) {
    ASSERT_EQ(source.receive(frame, 60.0), Received::kFrame);
    EXPECT_EQ(frame.axes[0].command, command);
  }
  EXPECT_GE(steady_ns() - began_ns, 108'000'000)
      << "behind three times 20 ms, less what the first of them had to wait anyway, and 50 ms";
}

TEST(ReplaySource, IsNeverEarly) {
  ReplaySource source(list(recording_at({0.0, 0.001, 0.002, 0.003, 0.010})), 2.0);
  MachineFrame frame;
  while (source.receive(frame, 60.0) == Received::kFrame) EXPECT_GE(source.age_ns(), 0);
}

TEST(ReplaySource, RecordingsOfDifferentMachinesAreRefused) {
  EXPECT_THAT(message_of([] { ReplaySource source({}, 1.0); }), HasSubstr("there is no recording"));
  EXPECT_THAT(
      message_of([] {
        ReplaySource source(list(recording_at({0.0, 0.001}), recording_at({0.0, 0.001}, "Y")), 1.0);
      }),
      HasSubstr("different axes"));
  EXPECT_THAT(message_of([] {
                ReplaySource source(
                    list(recording_at({0.0, 0.001}), recording_at({0.0, 0.002}, "X", 0.002)), 1.0);
              }),
              HasSubstr("different cycles: 0.001 s and 0.002 s"));
}

}  // namespace
}  // namespace servotwin::daemon
