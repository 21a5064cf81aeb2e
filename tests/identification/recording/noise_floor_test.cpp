#include "identification/recording/noise_floor.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <random>

namespace servotwin {
namespace {

Segment laps(double step, double noise, int count, double lap_s = 3.0) {
  std::mt19937_64 rng{5};
  std::normal_distribution<double> normal(0.0, noise > 0.0 ? noise : 1.0);
  Segment s;
  s.sample_time_s = 1e-3;
  const auto n = static_cast<Eigen::Index>(count * lap_s / 1e-3);
  s.command.resize(n);
  s.actual.resize(n);
  for (Eigen::Index i = 0; i < n; ++i) {
    const double t = 1e-3 * static_cast<double>(i);
    const double phase = 2.0 * std::numbers::pi * t / lap_s;
    s.command(i) = 0.05 * std::sin(phase) + 0.01 * std::sin(3.0 * phase);
    double x = s.command(i) - 1e-4 * std::cos(phase);
    if (noise > 0.0) x += normal(rng);
    s.actual(i) = step > 0.0 ? std::round(x / step) * step : x;
  }
  return s;
}

TEST(NoiseFloor, FindsTheEncoderStep) {
  for (double step : {0.05e-6, 1e-6, 5e-6, 20e-6}) {
    EXPECT_NEAR(noise_floor({laps(step, 0.0, 3, 3.1)}).encoder_step, step, 0.01 * step);
  }
  // Too fine for two readings to be one step apart anywhere: not found, and nothing else taken for
  // it.
  EXPECT_EQ(noise_floor({laps(1e-10, 0.0, 1)}).encoder_step, 0.0);
  EXPECT_EQ(noise_floor({laps(0.0, 0.0, 1)}).encoder_step, 0.0);
  EXPECT_TRUE(std::isnan(noise_floor({laps(0.0, 0.0, 1)}).rms))
      << "nothing shown is not a floor of zero";
}

// A missing sample is bridged half-way between two steps of the encoder, or anywhere between them.
TEST(NoiseFloor, AFewInterpolatedSamplesDoNotHalveTheEncoderStep) {
  for (const double share : {0.5, 0.3}) {
    Segment s = laps(1e-6, 0.0, 3, 3.1);
    for (Eigen::Index i = 300; i + 1 < s.size(); i += 100) {
      s.actual(i) = (1.0 - share) * s.actual(i - 1) + share * s.actual(i + 1);
    }
    EXPECT_NEAR(noise_floor({s}).encoder_step, 1e-6, 1e-8) << share;
  }
}

TEST(NoiseFloor, ResampledReadingsShowNoEncoderStep) {
  std::mt19937_64 rng{7};
  std::uniform_real_distribution<double> between(0.0, 1.0);
  Segment s = laps(1e-6, 0.0, 1);
  const Eigen::ArrayXd read = s.actual;
  for (Eigen::Index i = 1; i < s.size(); ++i) {
    s.actual(i) = read(i - 1) + between(rng) * (read(i) - read(i - 1));
  }
  EXPECT_EQ(noise_floor({s}).encoder_step, 0.0);
}

TEST(NoiseFloor, AnEncoderThatStandsStillOnOneReadingShowsNoFloor) {
  Segment s = laps(0.0, 0.0, 1);
  s.command.tail(1500).setConstant(s.command(1499));
  s.actual.tail(1500).setConstant(0.1 / 3.0);
  EXPECT_EQ(noise_floor({s}).standstill_rms, 0.0);
  EXPECT_TRUE(std::isnan(noise_floor({s}).rms));
}

TEST(NoiseFloor, WhatDoesNotRepeatFromLapToLapIsNoise) {
  const NoiseFloor floor = noise_floor({laps(0.0, 0.4e-6, 4)});
  EXPECT_NEAR(floor.lap_s, 3.0, 1.5e-3);
  EXPECT_NEAR(floor.repeat_rms, 0.4e-6, 0.03e-6);
  EXPECT_EQ(floor.rms, floor.repeat_rms);
}

TEST(NoiseFloor, ACommandThatNeverRepeatsHasNoLap) {
  Segment s = laps(0.0, 0.4e-6, 1);
  for (Eigen::Index i = 0; i < s.size(); ++i)
    s.command(i) += 1e-3 * std::pow(1e-3 * static_cast<double>(i), 2);
  EXPECT_TRUE(std::isnan(noise_floor({s}).repeat_rms));
}

TEST(NoiseFloor, StandstillShowsTheEncoderNoise) {
  std::mt19937_64 rng{6};
  std::normal_distribution<double> normal(0.0, 0.7e-6);
  Segment s = laps(0.0, 0.0, 1);
  s.command.tail(1500).setConstant(s.command(1499));
  for (Eigen::Index i = 1500; i < s.size(); ++i) s.actual(i) = s.command(i) + normal(rng);
  EXPECT_NEAR(noise_floor({s}).standstill_rms, 0.7e-6, 0.05e-6);
}

// Where friction has caught an integrator, the axis creeps; here by four times its noise in 50 ms.
TEST(NoiseFloor, CreepAtRestIsNoNoise) {
  std::mt19937_64 rng{6};
  std::normal_distribution<double> normal(0.0, 0.7e-6);
  Segment s = laps(0.0, 0.0, 1);
  s.command.tail(1500).setConstant(s.command(1499));
  for (Eigen::Index i = 1500; i < s.size(); ++i) {
    const double t = 1e-3 * static_cast<double>(i - 1500);
    s.actual(i) = s.command(i) + normal(rng) + 60e-6 * t;
  }
  EXPECT_NEAR(noise_floor({s}).standstill_rms, 0.7e-6, 0.05e-6);
}

// A soft axis is still on its way when its command has come to rest: here in a swing of 2 Hz and
// 20 um, recorded every 4 ms. Straight lines of 50 ms left 0.24 um of it.
TEST(NoiseFloor, SettlingIsNoNoise) {
  std::mt19937_64 rng{6};
  std::normal_distribution<double> normal(0.0, 5e-9);
  Segment s = laps(0.0, 0.0, 1);
  s.sample_time_s = 4e-3;
  s.command.tail(1500).setConstant(s.command(1499));
  for (Eigen::Index i = 1500; i < s.size(); ++i) {
    const double t = 4e-3 * static_cast<double>(i - 1500);
    s.actual(i) = s.command(i) + normal(rng) + 20e-6 * std::cos(2.0 * std::numbers::pi * 2.0 * t);
  }
  EXPECT_NEAR(noise_floor({s}).standstill_rms, 5e-9, 1e-9);
}

// A push at rest is no noise of the encoder, nor is a lap that was disturbed one of the record.
TEST(NoiseFloor, APushIsNoNoise) {
  std::mt19937_64 rng{6};
  std::normal_distribution<double> normal(0.0, 0.7e-6);
  Segment rest = laps(0.0, 0.0, 1);
  rest.command.tail(1500).setConstant(rest.command(1499));
  for (Eigen::Index i = 1500; i < rest.size(); ++i)
    rest.actual(i) = rest.command(i) + normal(rng) + (i / 40 == 55 ? 50e-6 : 0.0);
  EXPECT_NEAR(noise_floor({rest}).standstill_rms, 0.7e-6, 0.1e-6);

  Segment four = laps(0.0, 0.4e-6, 4);
  four.actual.segment(4000, 60) += 80e-6;
  EXPECT_NEAR(noise_floor({four}).repeat_rms, 0.4e-6, 0.03e-6);
}

}  // namespace
}  // namespace servotwin
