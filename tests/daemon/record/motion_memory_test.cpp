#include "daemon/record/motion_memory.h"

#include <gtest/gtest.h>

#include <cstdint>

#include "daemon/between/clock.h"
#include "tests/daemon/support.h"

namespace servotwin::daemon {
namespace {

CycleRow row_at(std::int64_t cycle, double command, double actual = 0.0) {
  CycleRow row;
  row.time_ns = cycle * 1'000'000;
  row.after_gap = false;
  row.axis_count = 1;
  row.axes[0] = {command, actual, 1.5};
  return row;
}

TEST(MotionMemory, GivesBackWhatWasAppendedSinceATime) {
  MotionMemory memory(one_axis(), 10.0);
  for (std::int64_t k = 0; k < 100; ++k)
    memory.append(row_at(1'000'000 + k, 1e-3 * static_cast<double>(k)));
  const Recording recording = memory.copy(0.0495, 0.0895, "live");
  ASSERT_EQ(recording.axes.size(), 1U);
  EXPECT_EQ(recording.source, "live");
  EXPECT_EQ(recording.axes[0].name, "X");
  ASSERT_EQ(recording.time.size(), 40U);
  EXPECT_NEAR(recording.time.front(), 0.050, 1e-12);
  EXPECT_EQ(recording.axes[0].command.front(), 0.050);
  EXPECT_EQ(recording.axes[0].command.back(), 0.089);
  EXPECT_TRUE(recording.axes[0].torque.empty()) << "this machine has no torque";
}

TEST(MotionMemory, CountsTheTimeInWhichTheCommandChanges) {
  MotionMemory memory(one_axis(), 10.0);
  std::int64_t k = 0;
  for (; k < 100; ++k) memory.append(row_at(k, 1e-3 * static_cast<double>(k)));
  for (; k < 300; ++k) memory.append(row_at(k, 0.099));
  for (; k < 350; ++k) memory.append(row_at(k, 0.099 - 1e-3 * static_cast<double>(k - 299)));
  EXPECT_NEAR(memory.moved_s(0), 0.149, 1e-12);
  EXPECT_NEAR(memory.newest_s(), 0.349, 1e-12);
  EXPECT_NEAR(memory.time_when_moved(0, 0.0495).value(), 0.050, 1e-12);
  EXPECT_NEAR(memory.time_when_moved(0, 0.0995).value(), 0.300, 1e-12) << "not while it stood";
  EXPECT_FALSE(memory.time_when_moved(0, 0.15).has_value());
}

TEST(MotionMemory, FindsTheFirstTimeItHasStoodForLongEnough) {
  MotionMemory memory(one_axis(), 10.0);
  std::int64_t k = 0;
  double command = 0.0;
  const auto until = [&](std::int64_t end, double speed) {
    for (; k < end; ++k) memory.append(row_at(k, command += 1e-3 * speed));
  };
  until(100, 0.0);
  until(150, 1.0);
  until(350, 0.0);
  until(351, 1.0);
  until(800, 0.0);
  EXPECT_NEAR(memory.time_when_stood(0, -1.0, 0.05).value(), 0.050, 1e-12);
  // Standstill begins at the last row with motion.
  EXPECT_NEAR(memory.time_when_stood(0, -1.0, 0.15).value(), 0.149 + 0.15, 1e-12);
  EXPECT_NEAR(memory.time_when_stood(0, 0.2, 0.15).value(), 0.350 + 0.15, 1e-12);
  EXPECT_NEAR(memory.time_when_stood(0, -1.0, 0.3).value(), 0.350 + 0.3, 1e-12);
  EXPECT_NEAR(memory.time_when_stood(0, 0.4005, 0.3).value(), 0.401 + 0.3, 1e-12);
  EXPECT_FALSE(memory.time_when_stood(0, -1.0, 0.46).has_value());
  EXPECT_FALSE(memory.time_when_stood(0, 5.0, 0.01).has_value());
}

TEST(MotionMemory, AJumpOverAGapIsNoMotion) {
  MotionMemory memory(one_axis(), 10.0);
  memory.append(row_at(0, 0.0));
  CycleRow after = row_at(500, 0.1);
  after.after_gap = true;
  memory.append(after);
  EXPECT_EQ(memory.moved_s(0), 0.0);
  EXPECT_NEAR(memory.newest_s(), 0.5, 1e-12);
}

TEST(MotionMemory, TimeGoesOnWhereTheSourceWasRestarted) {
  MotionMemory memory(one_axis(), 10.0);
  memory.append(row_at(5'000, 0.0));
  memory.append(row_at(5'001, 0.0));
  CycleRow again = row_at(0, 0.0);
  again.after_gap = true;
  memory.append(again);
  memory.append(row_at(1, 0.0));
  const Recording recording = memory.copy(-1.0, 100.0, "live");
  ASSERT_EQ(recording.time.size(), 4U);
  EXPECT_NEAR(recording.time[1], 0.001, 1e-12);
  EXPECT_NEAR(recording.time[2], 1.001, 1e-12);
  EXPECT_NEAR(recording.time[3], 1.002, 1e-12);
}

// In a constant expression nothing may overflow.
static_assert(between_ns(INT64_MAX, INT64_MIN + 999'999) == 1'000'000);
static_assert(between_ns(INT64_MIN, INT64_MAX) == -1);

TEST(MotionMemory, StampsMayBeAnything) {
  MotionMemory memory(one_axis(), 10.0);
  CycleRow row = row_at(0, 0.0);
  for (const std::int64_t stamp : {INT64_MAX - 1'000'000, INT64_MAX, INT64_MIN + 999'999}) {
    row.time_ns = stamp;
    memory.append(row);
  }
  EXPECT_NEAR(memory.newest_s(), 0.002, 1e-12);
}

TEST(MotionMemory, ForgetsTheOldestButNotWhatWasPromised) {
  MotionMemory memory(one_axis(), 0.1);
  for (std::int64_t k = 0; k < 10'000; ++k) memory.append(row_at(k, 0.0, static_cast<double>(k)));
  const Recording recording = memory.copy(-1.0, 100.0, "live");
  EXPECT_GE(recording.time.size(), 100U);
  EXPECT_LE(recording.time.size(), 127U);
  EXPECT_EQ(recording.time.front(), memory.oldest_s());
  EXPECT_EQ(recording.axes[0].actual.back(), 9999.0);
  for (std::size_t i = 0; i < recording.time.size(); ++i) {
    ASSERT_NEAR(recording.time[i], 1e-3 * recording.axes[0].actual[i], 1e-9);
  }
}

TEST(MotionMemory, WhatIsNotANumberIsAbsentAndNoMotion) {
  MotionMemory memory(one_axis(), 10.0);
  memory.append(row_at(0, 0.0));
  memory.append(row_at(1, INFINITY, -INFINITY));
  memory.append(row_at(2, 0.1));
  const Recording recording = memory.copy(-1.0, 100.0, "live");
  EXPECT_TRUE(std::isnan(recording.axes[0].command[1]));
  EXPECT_TRUE(std::isnan(recording.axes[0].actual[1]));
  EXPECT_EQ(memory.moved_s(0), 0.0);
}

}  // namespace
}  // namespace servotwin::daemon
