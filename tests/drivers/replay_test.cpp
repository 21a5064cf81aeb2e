#include "drivers/recordings/replay.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

namespace servotwin {
namespace {

using testing::HasSubstr;

/// Two axes whose values are the number of the row.
Recording recording_at(const std::vector<double>& time) {
  Recording recording;
  recording.source = "r.csv";
  recording.time = time;
  AxisRecord x, b;
  x.name = "X";
  x.torque_unit = "V";
  b.name = "B";
  b.rotary = true;
  for (std::size_t i = 0; i < time.size(); ++i) {
    const auto row = static_cast<double>(i);
    x.command.push_back(row);
    x.actual.push_back(row + 0.25);
    x.torque.push_back(-row);
    b.command.push_back(100.0 + row);
    b.actual.push_back(kAbsent);
  }
  recording.axes = {x, b};
  return recording;
}

std::vector<double> evenly(std::size_t rows) {
  std::vector<double> time(rows);
  for (std::size_t i = 0; i < rows; ++i) time[i] = 3.0 + 0.002 * static_cast<double>(i);
  return time;
}

TEST(Replay, DescribesTheMachine) {
  const Replay replay(recording_at(evenly(10)), 0.002);
  EXPECT_NEAR(replay.machine().cycle_s, 0.002, 1e-12);
  ASSERT_EQ(replay.machine().axes.size(), 2U);
  EXPECT_EQ(replay.machine().axes[0].name, "X");
  EXPECT_EQ(replay.machine().axes[0].torque_unit, "V");
  EXPECT_TRUE(replay.machine().axes[1].rotary);
}

// The names become those of files and messages.
TEST(Replay, AnAxisNameThatLeadsElsewhereIsRefused) {
  for (const std::string& name :
       {std::string("../../x"), std::string("a/b"), std::string(), std::string("."),
        std::string("a\0b", 3), std::string(300, 'a')}) {
    Recording recording = recording_at(evenly(10));
    recording.axes[1].name = name;
    try {
      (void)Replay(recording, 0.002);
      ADD_FAILURE() << name;
    } catch (const std::runtime_error& error) {
      EXPECT_THAT(error.what(), HasSubstr("r.csv: cannot be replayed, the axis name '"));
      EXPECT_THAT(error.what(), HasSubstr("must be 1 to 63 letters"));
    }
  }
}

TEST(Replay, GivesEveryRowOnceInOrder) {
  Replay replay(recording_at(evenly(10)), 0.002);
  MachineFrame frame;
  for (std::uint64_t row = 0; row < 10; ++row) {
    EXPECT_NEAR(replay.elapsed_s(), 0.002 * static_cast<double>(row), 1e-12);
    ASSERT_TRUE(replay.next(frame));
    EXPECT_EQ(frame.sequence, row);
    EXPECT_EQ(frame.time_ns, 3'000'000'000 + 2'000'000 * static_cast<std::int64_t>(row));
    EXPECT_EQ(frame.axis_count, 2);
    EXPECT_EQ(frame.ahead_count, 0);
    EXPECT_EQ(frame.axes[0].command, static_cast<double>(row));
    EXPECT_EQ(frame.axes[0].actual, static_cast<double>(row) + 0.25);
    EXPECT_EQ(frame.axes[0].torque, -static_cast<double>(row));
    EXPECT_TRUE(std::isnan(frame.axes[1].actual));
    EXPECT_TRUE(std::isnan(frame.axes[1].torque));
  }
  EXPECT_FALSE(replay.next(frame));
}

TEST(Replay, AGapOfTheRecordingIsAJumpOfTheSequence) {
  std::vector<double> time = evenly(10);
  for (std::size_t i = 6; i < 10; ++i) time[i] += 7.72;
  Replay replay(recording_at(time), 0.002, 4);
  MachineFrame frame;
  std::vector<std::uint64_t> sequence;
  std::vector<int> ahead;
  while (replay.next(frame)) {
    sequence.push_back(frame.sequence);
    ahead.push_back(frame.ahead_count);
  }
  EXPECT_EQ(sequence, (std::vector<std::uint64_t>{0, 1, 2, 3, 4, 5, 3866, 3867, 3868, 3869}));
  EXPECT_EQ(ahead, (std::vector<int>{4, 4, 3, 2, 1, 0, 3, 2, 1, 0}))
      << "nothing is known across a gap";
}

TEST(Replay, TellsTheCommandsThatCome) {
  Replay replay(recording_at(evenly(10)), 0.002, 3);
  MachineFrame frame;
  ASSERT_TRUE(replay.next(frame));
  ASSERT_EQ(frame.ahead_count, 3);
  for (std::size_t i = 0; i < 3; ++i) {
    EXPECT_EQ(frame.ahead[0][i], 1.0 + static_cast<double>(i));
    EXPECT_EQ(frame.ahead[1][i], 101.0 + static_cast<double>(i));
  }
}

TEST(Replay, WhatCannotBeReplayedIsSaid) {
  const auto refused = [](Recording recording, int look_ahead = 0) -> std::string {
    try {
      const Replay replay(std::move(recording), 0.002, look_ahead);
    } catch (const std::runtime_error& error) {
      return error.what();
    }
    return "nothing";
  };
  // A row without a cycle of its own would be ignored by whoever it is sent to.
  for (const double third : {3.002, 3.0025, 2.9, kAbsent}) {
    EXPECT_EQ(refused(recording_at({3.0, 3.002, third, 3.006})),
              "r.csv: cannot be replayed, row 3 has no cycle of its own");
  }
  EXPECT_EQ(refused(recording_at({kAbsent, 3.0})),
            "r.csv: cannot be replayed, row 1 has no cycle of its own");
  EXPECT_EQ(refused(recording_at({})), "r.csv: cannot be replayed without rows and a cycle");
  EXPECT_THAT(refused(recording_at(evenly(5)), 33),
              HasSubstr("look-ahead of 33 cycles: must be 0 to 32"));
  Recording none = recording_at(evenly(5));
  none.axes.clear();
  EXPECT_THAT(refused(none), HasSubstr("0 axes cannot be replayed"));
}

}  // namespace
}  // namespace servotwin
