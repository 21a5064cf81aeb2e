#include "daemon/input/recorded_cycles.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

#include "drivers/recordings/replay.h"
#include "identification/recording/segments.h"
#include "tests/daemon/support.h"

namespace servotwin::daemon {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

/// Axis X as it moves in support.h, sampled at `taken` and stamped with `stamps`.
Recording recording_of(const std::vector<double>& stamps, const std::vector<double>& taken) {
  Recording recording;
  recording.source = "r.csv";
  recording.time = stamps;
  AxisRecord x;
  x.name = "X";
  x.torque_unit = "Nm";
  for (const double t : taken) {
    x.command.push_back(command_at(t));
    x.actual.push_back(command_at(t) - 1e-3 * t);
    x.actual_motor.push_back(command_at(t) - 2e-3 * t);
    x.torque.push_back(-t);
  }
  recording.axes.push_back(x);
  return recording;
}

std::vector<double> evenly(std::size_t rows) {
  std::vector<double> time(rows);
  for (std::size_t i = 0; i < rows; ++i) time[i] = 3.0 + kCycle_s * static_cast<double>(i);
  return time;
}

std::vector<double> in_steps_of(double resolution_s, std::vector<double> time) {
  for (double& t : time) t = std::floor(t / resolution_s + 1e-6) * resolution_s;
  return time;
}

std::vector<double> jittered(std::size_t rows) {
  std::mt19937 generator(7);
  std::normal_distribution<double> jitter(0.0, 0.2 * kCycle_s);
  std::vector<double> time = evenly(rows);
  for (double& t : time) t += jitter(generator);
  std::sort(time.begin(), time.end());
  return time;
}

std::vector<MachineFrame> frames_of(const Recording& recording) {
  RecordedCycles cycles = recorded_cycles(recording);
  Replay replay(std::move(cycles.recording), cycles.cycle_s);
  std::vector<MachineFrame> frames;
  MachineFrame frame;
  while (replay.next(frame)) frames.push_back(frame);
  return frames;
}

/// The replayed samples are those that `servotwin identify` uses; none is lost.
void expect_what_identification_reads(const Recording& recording) {
  const SegmentedAxis read = segment_axis(recording, "X");
  ASSERT_EQ(read.segments.size(), 1U);
  const Segment& segment = read.segments[0];
  const std::vector<MachineFrame> frames = frames_of(recording);
  ASSERT_EQ(static_cast<Eigen::Index>(frames.size()), segment.size());
  ASSERT_EQ(recorded_cycles(recording).recording.axes[0].actual_motor.size(), frames.size());
  for (std::size_t k = 0; k < frames.size(); ++k) {
    const auto i = static_cast<Eigen::Index>(k);
    ASSERT_EQ(frames[k].sequence, k);
    ASSERT_NEAR(frames[k].axes[0].command, segment.command[i], 1e-12) << k;
    ASSERT_NEAR(frames[k].axes[0].actual, segment.actual[i], 1e-12) << k;
    ASSERT_NEAR(frames[k].axes[0].torque, segment.torque[i], 1e-9) << k;
    const double stamp_s = segment.start_s + static_cast<double>(k) * segment.sample_time_s;
    ASSERT_NEAR(1e-9 * static_cast<double>(frames[k].time_ns), stamp_s, 1e-8);
  }
}

TEST(RecordedCycles, EvenRowsStayAsTheyAre) {
  const Recording recording = recording_of(evenly(500), evenly(500));
  const RecordedCycles cycles = recorded_cycles(recording);
  EXPECT_EQ(cycles.cycle_s, kCycle_s);
  EXPECT_EQ(cycles.recording.axes[0].command, recording.axes[0].command);
  EXPECT_EQ(cycles.recording.axes[0].torque, recording.axes[0].torque);
  EXPECT_THAT(cycles.notes, IsEmpty());
  expect_what_identification_reads(recording);
}

TEST(RecordedCycles, RowsThatShareACoarseStampAreAllThere) {
  const std::vector<double> taken = evenly(5000);
  const Recording recording = recording_of(in_steps_of(0.01, taken), taken);
  EXPECT_EQ(frames_of(recording).size(), 5000U);
  expect_what_identification_reads(recording);
  EXPECT_THAT(recorded_cycles(recording).notes,
              ElementsAre(HasSubstr("r.csv: stamps are only written to 10 ms")));
}

TEST(RecordedCycles, RowsOfLargeJitterAreResampled) {
  const std::vector<double> taken = jittered(5000);
  const Recording recording = recording_of(taken, taken);
  expect_what_identification_reads(recording);
  EXPECT_THAT(recorded_cycles(recording).notes,
              ElementsAre(HasSubstr("5000 rows resampled linearly onto ")));
}

TEST(RecordedCycles, AGapOfUnevenRowsStaysAGap) {
  std::vector<double> taken = jittered(2000);
  for (std::size_t i = 1000; i < taken.size(); ++i) taken[i] += 0.5;
  const std::vector<MachineFrame> frames = frames_of(recording_of(taken, taken));
  int gaps = 0;
  for (std::size_t k = 1; k < frames.size(); ++k) {
    const std::uint64_t advance = frames[k].sequence - frames[k - 1].sequence;
    if (advance == 1) continue;
    ++gaps;
    EXPECT_NEAR(static_cast<double>(advance) * kCycle_s, 0.5, 0.01);
  }
  EXPECT_EQ(gaps, 1);
}

TEST(RecordedCycles, CopiesAndRowsWithoutAPlaceAreDroppedAndSaid) {
  std::vector<double> stamps = evenly(500), taken = stamps;
  stamps.insert(stamps.begin() + 100, stamps[99]);
  taken.insert(taken.begin() + 100, taken[99]);
  stamps.front() = kAbsent;
  const Recording recording = recording_of(stamps, taken);
  expect_what_identification_reads(recording);
  EXPECT_EQ(frames_of(recording).size(), 499U);
  EXPECT_THAT(recorded_cycles(recording).notes,
              ElementsAre("r.csv: 1 rows dropped: the stamp of the row before was repeated",
                          "r.csv: 1 rows dropped: no usable stamp"));
}

TEST(RecordedCycles, WhatHasNoTimeIsRefusedAsIdentificationRefusesIt) {
  const auto same_message = [](const std::vector<double>& stamps) {
    const Recording recording = recording_of(stamps, evenly(stamps.size()));
    std::string message = message_of([&] { (void)recorded_cycles(recording); });
    EXPECT_EQ(message, message_of([&] { (void)segment_axis(recording, "X"); }));
    return message;
  };
  EXPECT_THAT(same_message({1.0}), HasSubstr("only one row"));
  EXPECT_THAT(same_message({1.0, 1.0, 1.0}), HasSubstr("time does not advance"));
  EXPECT_THAT(same_message({3.0, 2.0, 1.0}), HasSubstr("time runs backwards at row 2"));
}

}  // namespace
}  // namespace servotwin::daemon
