#include "identification/recording/noise_floor.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
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
  EXPECT_TRUE(std::isnan(noise_floor({s}).rms));
}

TEST(NoiseFloor, WhatDoesNotRepeatFromLapToLapIsNoise) {
  const NoiseFloor floor = noise_floor({laps(0.0, 0.4e-6, 4)});
  EXPECT_NEAR(floor.lap_s, 3.0, 1.5e-3);
  EXPECT_NEAR(floor.repeats.rms, 0.4e-6, 0.03e-6);
  EXPECT_LT(floor.repeats.low, 0.4e-6);
  EXPECT_GT(floor.repeats.high, 0.4e-6);
}

// A force of 3 Hz that the command knows nothing of: no model predicts it, but it is no noise.
TEST(NoiseFloor, WhatDiffersFromLapToLapBesideTheNoiseIsOfTheFloor) {
  Segment s = laps(0.0, 0.4e-6, 4);
  for (Eigen::Index i = 0; i < s.size(); ++i)
    s.actual(i) += 5e-6 * std::sin(2.0 * std::numbers::pi * 3.13 * 1e-3 * static_cast<double>(i));
  const NoiseFloor floor = noise_floor({s});
  EXPECT_NEAR(floor.white.rms, 0.4e-6, 0.02e-6);
  EXPECT_GT(floor.repeats.rms, 1e-6);
  EXPECT_EQ(floor.rms, floor.repeats.rms);
  EXPECT_EQ(floor.low, floor.repeats.low);
}

TEST(NoiseFloor, ACommandThatNeverRepeatsHasNoLap) {
  Segment s = laps(0.0, 0.4e-6, 1);
  for (Eigen::Index i = 0; i < s.size(); ++i)
    s.command(i) += 1e-3 * std::pow(1e-3 * static_cast<double>(i), 2);
  EXPECT_TRUE(std::isnan(noise_floor({s}).repeats.rms));
}

/// An axis that moves in one half of the record and rests in the other, with this noise in both.
Segment half_at_rest(double noise, double sample_time_s = 1e-3) {
  std::mt19937_64 rng{6};
  std::normal_distribution<double> normal(0.0, noise);
  Segment s = laps(0.0, 0.0, 1);
  s.sample_time_s = sample_time_s;
  s.command.tail(1500).setConstant(s.command(1499));
  s.actual.tail(1500) = s.command.tail(1500);
  for (double& x : s.actual) x += normal(rng);
  return s;
}

void add_at_rest(Segment& s, const std::function<double(double)>& motion) {
  for (Eigen::Index i = 1500; i < s.size(); ++i)
    s.actual(i) += motion(s.sample_time_s * static_cast<double>(i - 1500));
}

TEST(NoiseFloor, HasAnInterval) {
  const NoiseFloor floor = noise_floor({half_at_rest(0.7e-6)});
  EXPECT_NEAR(floor.rms, 0.7e-6, 0.03e-6);
  EXPECT_LT(floor.low, 0.7e-6);
  EXPECT_GT(floor.low, 0.6e-6);
  EXPECT_GT(floor.high, 0.7e-6);
  EXPECT_LT(floor.high, 0.8e-6);
}

TEST(NoiseFloor, MotionAloneShowsTheEncoderNoise) {
  EXPECT_NEAR(noise_floor({laps(0.0, 0.7e-6, 1)}).white.rms, 0.7e-6, 0.03e-6);
}

TEST(NoiseFloor, AToneOfTheMainsIsNoNoise) {
  const auto with_tone = [](double frequency_hz, double amplitude) {
    Segment s = laps(0.0, 0.4e-6, 1);
    for (Eigen::Index i = 0; i < s.size(); ++i)
      s.actual(i) += amplitude * std::sin(2.0 * std::numbers::pi * frequency_hz * 1e-3 *
                                          static_cast<double>(i));
    return noise_floor({s}).white;
  };
  EXPECT_NEAR(with_tone(50.0, 20e-6).rms, 0.4e-6, 0.02e-6);
  EXPECT_NEAR(with_tone(150.0, 4e-6).rms, 0.4e-6, 0.02e-6);
  // Five times the noise within the band that shows it: a quarter too much.
  EXPECT_NEAR(with_tone(300.0, 2e-6).rms, 0.4e-6, 0.12e-6);
}

// Stick and slip: steps of twenty times the noise, ten a second.
TEST(NoiseFloor, StepsAtRestAreNoNoise) {
  Segment s = half_at_rest(0.4e-6);
  add_at_rest(s, [](double t) { return 8e-6 * std::floor(10.0 * t); });
  EXPECT_NEAR(noise_floor({s}).white.rms, 0.4e-6, 0.03e-6);
}

// Readings are intervals: the error of one is that of noise and rounding together. Noise of a small
// part of a step shows only where an edge is near: on an axis that creeps, hardly ever.
TEST(NoiseFloor, AStepThatIsCoarserThanTheNoiseCountsWithIt) {
  constexpr double kStep = 1e-6;
  for (const double noise : {0.05 * kStep, 0.2 * kStep}) {
    Segment s = half_at_rest(noise);
    for (Eigen::Index i = 0; i < 1500; ++i) s.actual(i) -= s.command(i);  // creeps there as well
    for (Eigen::Index i = 0; i < s.size(); ++i)
      s.actual(i) += 0.02 * kStep * static_cast<double>(i);
    for (double& x : s.actual) x = std::round(x / kStep) * kStep;
    const NoiseFloor floor = noise_floor({s});
    const double truth = std::hypot(noise, kStep / std::sqrt(12.0));
    EXPECT_NEAR(floor.rms, truth, 0.2 * truth);
    EXPECT_LE(floor.low, truth);
    EXPECT_GE(floor.high, truth);
  }
}

// A recorder of 1 kHz that asks the encoder every 10 ms: what is held says nothing about the noise.
TEST(NoiseFloor, AHeldEncoderIsNotTakenForNoise) {
  Segment s = laps(0.0, 0.4e-6, 1);
  for (Eigen::Index i = 0; i < s.size(); ++i) s.actual(i) = s.actual(i - i % 10);
  EXPECT_TRUE(std::isnan(noise_floor({s}).white.rms));
}

// At rest the readings change between a few steps: held, unless the step is known from motion.
TEST(NoiseFloor, AtRestIsMeasuredWithTheStepThatMotionHasShown) {
  constexpr double kStep = 1e-6, kNoise = 0.5e-6;
  std::mt19937 random(11);
  std::normal_distribution<double> noise(0.0, kNoise);
  Segment rest;
  rest.sample_time_s = 1e-3;
  rest.command.setConstant(4000, 0.1);
  rest.actual = rest.command;
  for (double& x : rest.actual) x = kStep * std::round((x + noise(random)) / kStep);
  // Noise and rounding add up: sqrt(0.5^2 + 1 / 12) um.
  EXPECT_NEAR(noise_floor({rest}, kStep).white.rms, 0.577e-6, 0.03e-6);
}

// Where friction has caught an integrator, the axis creeps; here by four times its noise in 50 ms.
TEST(NoiseFloor, CreepAtRestIsNoNoise) {
  Segment s = half_at_rest(0.7e-6);
  add_at_rest(s, [](double t) { return 60e-6 * t; });
  EXPECT_NEAR(noise_floor({s}).white.rms, 0.7e-6, 0.03e-6);
}

// A soft axis is still on its way when its command has come to rest: here in a swing of 2 Hz and
// 20 um, recorded every 4 ms. Straight lines of 50 ms left 0.24 um of it.
TEST(NoiseFloor, SettlingIsNoNoise) {
  Segment s = half_at_rest(5e-9, 4e-3);
  add_at_rest(s, [](double t) { return 20e-6 * std::cos(2.0 * std::numbers::pi * 2.0 * t); });
  EXPECT_NEAR(noise_floor({s}).white.rms, 5e-9, 5e-10);
}

// A push at rest is no noise of the encoder, nor is a lap that was disturbed one of the record.
TEST(NoiseFloor, APushIsNoNoise) {
  Segment rest = half_at_rest(0.7e-6);
  rest.actual.segment(2200, 40) += 50e-6;
  EXPECT_NEAR(noise_floor({rest}).white.rms, 0.7e-6, 0.03e-6);

  Segment four = laps(0.0, 0.4e-6, 4);
  four.actual.segment(4000, 60) += 80e-6;
  EXPECT_NEAR(noise_floor({four}).repeats.rms, 0.4e-6, 0.03e-6);
}

}  // namespace
}  // namespace servotwin
