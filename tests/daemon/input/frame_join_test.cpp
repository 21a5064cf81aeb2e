// Two streams of one motion, whose clocks differ: what is true is the motion at the moment of each
// cycle.
#include "daemon/input/frame_join.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <optional>
#include <random>
#include <stdexcept>

namespace servotwin::daemon {
namespace {

constexpr std::int64_t kTick_ns = 1'000'000;

/// A motion of 0.1 m amplitude with up to 0.6 m/s and 4 m/s^2, as fast as feed axes are.
double place(double t_s) { return 0.1 * std::sin(6.0 * t_s); }

/// The streams of a machine: commands by a clock that is an hour ahead, encoders by one that gains
/// `drift`, 0.37 of a cycle apart.
class Streams {
 public:
  static constexpr double kCycle_s = 1e-3;
  explicit Streams(double drift, std::vector<JoinedAxis> axes = {{{0, 0}, {1, 0}}})
      : drift_(drift), join_(std::move(axes), {kCycle_s, kCycle_s}, {false, false}) {}

  /// The next cycle of both; `lost`: the second stream's is.
  void pass(bool lost = false) {
    const std::int64_t t = cycle_ * kTick_ns, encoder = t + 370'000;
    std::exponential_distribution<double> late(1.0 / 20e3);
    MachineFrame frame;
    frame.sequence = static_cast<std::uint64_t>(cycle_);
    frame.time_ns = t + 3'600'000'000'000;
    frame.axis_count = 1;
    frame.axes[0].command = place(1e-9 * static_cast<double>(t));
    frame.axes[0].torque = 7.0;
    join_.add_first(frame, t + 30'000 + std::llround(late(random_)));
    take(t + 100'000);
    FrameJoin::Sample sample;
    sample.stamp_ns = encoder + std::llround(drift_ * static_cast<double>(encoder));
    sample.arrival_ns = encoder + 30'000 + std::llround(late(random_));
    sample.axes[0].actual = place(1e-9 * static_cast<double>(encoder));
    sample.axes[0].command = 2.0 * sample.axes[0].actual;
    sample.axes[0].torque = 1e-9 * static_cast<double>(encoder);
    if (!lost) join_.add_second(sample);
    take(encoder + 100'000);
    ++cycle_;
  }
  void pass_for(double seconds) {
    for (std::int64_t n = std::llround(seconds / kCycle_s); n > 0; --n) pass();
  }
  /// Of the cycles that were taken since the last call: greatest error of the encoder, cycles
  /// without one, greatest delay.
  struct Seen {
    double error_m = 0.0, torque_error = 0.0;
    int taken = 0, absent = 0;
    std::int64_t latest_ns = 0;
  };
  Seen seen() { return std::exchange(seen_, {}); }
  [[nodiscard]] const FrameJoin& join() const { return join_; }
  [[nodiscard]] const MachineFrame& last() const { return frame_; }

 private:
  void take(std::int64_t now) {
    while (join_.take(frame_, now)) {
      const std::int64_t moment = frame_.time_ns - 3'600'000'000'000;
      EXPECT_EQ(frame_.axes[0].command, place(1e-9 * static_cast<double>(moment)));
      ++seen_.taken;
      seen_.latest_ns = std::max(seen_.latest_ns, now - moment);
      if (std::isnan(frame_.axes[0].actual)) {
        ++seen_.absent;
      } else {
        const double t = 1e-9 * static_cast<double>(moment);
        seen_.error_m = std::max(seen_.error_m, std::abs(frame_.axes[0].actual - place(t)));
        seen_.torque_error = std::max(seen_.torque_error, std::abs(frame_.axes[0].torque - t));
      }
    }
  }
  double drift_;
  FrameJoin join_;
  MachineFrame frame_;
  std::mt19937 random_{3};
  std::int64_t cycle_ = 0;
  Seen seen_;
};

TEST(FrameJoin, TheEncoderIsThatOfTheMomentOfTheCommand) {
  for (const double drift : {50e-6, -50e-6, 0.0}) {
    Streams streams(drift);
    streams.pass_for(2.0);
    EXPECT_EQ(streams.seen().absent, 2000) << "as long as the clocks are not known";
    streams.pass_for(3.0);
    (void)streams.seen();
    streams.pass_for(30.0);
    const Streams::Seen seen = streams.seen();
    EXPECT_EQ(seen.absent, 0);
    EXPECT_NEAR(seen.taken, 30'000, 2);
    // 3 us of the clocks at 0.6 m/s; a cycle that is taken as it comes is wrong by 222 um.
    EXPECT_LT(seen.error_m, 2e-6);
    EXPECT_LT(seen.torque_error, 5e-6);
    EXPECT_LT(seen.latest_ns, 2 * kTick_ns);
    const ClockDifference& clocks = streams.join().clocks();
    EXPECT_TRUE(clocks.settled);
    EXPECT_NEAR(clocks.drift, drift, 0.5e-6);
    EXPECT_NEAR(clocks.ahead_s, -3600.0 + drift * 35.0, 5e-6);
    EXPECT_EQ(clocks.absent, 0U);
  }
}

TEST(FrameJoin, WhatTheSecondStreamLacksIsAbsentAndCounted) {
  Streams streams(20e-6);
  streams.pass_for(6.0);
  (void)streams.seen();
  for (int i = 0; i < 100; ++i) streams.pass(i >= 40 && i < 60);
  const Streams::Seen seen = streams.seen();
  EXPECT_GE(seen.absent, 18);
  EXPECT_LE(seen.absent, 22);
  EXPECT_EQ(streams.join().clocks().absent, static_cast<std::uint64_t>(seen.absent));
  EXPECT_LT(seen.error_m, 2e-6);
  EXPECT_LE(seen.latest_ns, 4 * kTick_ns + 200'000);
}

// With clocks that need not be found only the interpolation is left.
TEST(FrameJoin, BetweenSamplesThereIsNoStraightLine) {
  FrameJoin join({{{0, 0}, {1, 0}}}, {1e-3, 1e-3}, {true, true});
  constexpr std::int64_t kWallAhead_ns = 1'700'000'000'000'000'000;
  join.set_wall_ahead(kWallAhead_ns);
  MachineFrame frame, out;
  frame.axis_count = 1;
  FrameJoin::Sample sample;
  double worst = 0.0;
  for (std::int64_t cycle = 0; cycle < 1000; ++cycle) {
    const std::int64_t moment = cycle * kTick_ns, encoder = moment + 500'000;
    frame.time_ns = kWallAhead_ns + moment;
    join.add_first(frame, moment);
    EXPECT_FALSE(join.take(out, moment));
    sample.stamp_ns = kWallAhead_ns + encoder;
    sample.axes[0].actual = place(1e-9 * static_cast<double>(encoder));
    join.add_second(sample);
    ASSERT_TRUE(join.take(out, encoder));
    EXPECT_EQ(join.moment_ns(), moment);
    if (cycle < 3) continue;
    worst =
        std::max(worst, std::abs(out.axes[0].actual - place(1e-9 * static_cast<double>(moment))));
  }
  // By theory jerk / 6 * 0.5 * 0.5 * 1.5 ms^3 = 1.35 nm for the parabola, 450 nm for a line.
  EXPECT_LT(worst, 2e-9);
}

/// Both streams by the wall clock, which is that of the steady clock: only the join is left.
class Exact {
 public:
  explicit Exact(double second_s = 1e-3)
      : join({{{0, 0}, {1, 0}}}, {1e-3, second_s}, {true, true}) {}
  void first(std::int64_t at, std::int64_t stamp) {
    MachineFrame frame;
    frame.axis_count = 1;
    frame.time_ns = stamp;
    join.add_first(frame, at);
  }
  void second(std::int64_t stamp, double actual) {
    FrameJoin::Sample sample;
    sample.stamp_ns = stamp;
    sample.axes[0].actual = actual;
    join.add_second(sample);
  }
  /// The encoder of the oldest cycle; nothing if it is not ready.
  std::optional<double> taken(std::int64_t now) {
    MachineFrame frame;
    if (!join.take(frame, now)) return std::nullopt;
    return frame.axes[0].actual;
  }
  FrameJoin join;
};

TEST(FrameJoin, NothingIsInterpolatedOverAGap) {
  Exact exact;
  for (std::int64_t k = 0; k < 1000; ++k) exact.second(k * kTick_ns, 0.0);
  // 50 ms are lost, in which the axis moves by 0.1 m.
  for (const std::int64_t k : {1047, 1048, 1049}) exact.first(k * kTick_ns, k * kTick_ns);
  exact.second(1050 * kTick_ns, 0.1);
  for (int i = 0; i < 3; ++i) EXPECT_TRUE(std::isnan(exact.taken(1050 * kTick_ns).value()));
  exact.first(1050 * kTick_ns, 1050 * kTick_ns + kTick_ns / 2);
  exact.second(1051 * kTick_ns, 0.1);
  EXPECT_NEAR(exact.taken(1051 * kTick_ns).value(), 0.1, 1e-12) << "not by the samples before it";
  EXPECT_EQ(exact.join.clocks().absent, 3U);
}

TEST(FrameJoin, ASlowerSecondStreamIsWaitedFor) {
  Exact exact(0.01);
  std::uint64_t with_encoder = 0;
  for (std::int64_t k = 0; k < 1000; ++k) {
    const std::int64_t now = k * kTick_ns;
    exact.first(now, now);
    if (k % 10 == 5) exact.second(now, 1e-3 * static_cast<double>(k));
    while (const auto actual = exact.taken(now)) {
      if (!std::isfinite(*actual)) continue;
      EXPECT_NEAR(*actual, 1e-9 * static_cast<double>(exact.join.moment_ns()), 1e-9);
      ++with_encoder;
    }
  }
  EXPECT_GE(with_encoder, 980U);
}

TEST(FrameJoin, StampsMayHaveAnyValue) {
  constexpr std::int64_t kLeast = std::numeric_limits<std::int64_t>::min(),
                         kMost = std::numeric_limits<std::int64_t>::max();
  for (const bool by_wall_clock : {true, false}) {
    FrameJoin join({{{0, 0}, {1, 0}}}, {1e-3, 1e-3}, {by_wall_clock, by_wall_clock});
    MachineFrame frame, out;
    frame.axis_count = 1;
    std::int64_t now = 0;
    for (const std::int64_t stamp : {std::int64_t{0}, kMost, kLeast, std::int64_t{5}, kMost}) {
      FrameJoin::Sample sample;
      sample.stamp_ns = static_cast<std::int64_t>(0 - static_cast<std::uint64_t>(stamp));
      sample.arrival_ns = now;
      sample.axes[0].actual = 1.0;
      join.add_second(sample);
      frame.time_ns = stamp;
      join.add_first(frame, now);
      now += 10 * kTick_ns;
      while (join.take(out, now)) {
      }
    }
    EXPECT_FALSE(join.waiting());
  }
}

TEST(FrameJoin, OneLostSampleIsInterpolatedOver) {
  Streams streams(20e-6);
  streams.pass_for(6.0);
  (void)streams.seen();
  streams.pass(true);
  streams.pass_for(0.01);
  const Streams::Seen seen = streams.seen();
  EXPECT_EQ(seen.absent, 0);
  EXPECT_LT(seen.error_m, 3e-6);
}

TEST(FrameJoin, AnAxisMayComeWhollyFromTheSecondStream) {
  Streams streams(0.0, {{{0, 0}, {0, 0}}, {{1, 0}, {1, 0}}});
  streams.pass_for(6.0);
  const MachineFrame& last = streams.last();
  EXPECT_EQ(last.axis_count, 2);
  EXPECT_EQ(last.axes[0].torque, 7.0);
  const double t = 1e-9 * static_cast<double>(last.time_ns - 3'600'000'000'000);
  EXPECT_NEAR(last.axes[1].command, 2.0 * place(t), 5e-6);
  EXPECT_NEAR(last.axes[1].actual, place(t), 3e-6);
}

TEST(FrameJoin, AFrameWithFewerAxesIsOfAnotherMachine) {
  FrameJoin join({{{0, 1}, {0, 0}}}, {1e-3, 1e-3}, {true, true});
  MachineFrame frame, out;
  frame.axis_count = 1;
  join.add_first(frame, 0);
  ASSERT_TRUE(join.take(out, 10 * kTick_ns));
  EXPECT_EQ(out.axis_count, 0);
}

TEST(FrameJoin, AxesThatAreInNoStreamAreRefused) {
  EXPECT_THROW(FrameJoin({}, {1e-3, 1e-3}, {true, true}), std::invalid_argument);
  EXPECT_THROW(FrameJoin({{{2, 0}, {0, 0}}}, {1e-3, 1e-3}, {true, true}), std::invalid_argument);
  EXPECT_THROW(FrameJoin({{{0, 0}, {1, 32}}}, {1e-3, 1e-3}, {true, true}), std::invalid_argument);
  EXPECT_THROW(FrameJoin({{{0, 0}, {1, 0}}}, {0.0, 1e-3}, {true, true}), std::invalid_argument);
}

}  // namespace
}  // namespace servotwin::daemon
