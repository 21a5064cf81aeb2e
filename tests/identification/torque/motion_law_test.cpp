// The friction test motion against its closed form, and the paper's own example.
#include "identification/torque/motion_law.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <stdexcept>
#include <vector>

#include "tests/support/expect_error.h"

namespace servotwin {
namespace {

using test::expect_error;

constexpr std::array kCoefficients{100e-7, 100e-7, 40e-7, 3e-7};

/// 2 mm for the first three, 5 mm up to the sixth, 10 mm for the rest.
std::vector<double> three_bands(std::size_t velocities) {
  std::vector<double> bands(velocities, 10e-3);
  for (std::size_t i = 0; i < 6; ++i) bands[i] = i < 3 ? 2e-3 : 5e-3;
  return bands;
}

MotionLawPlan the_papers() {
  MotionLawPlan plan;
  plan.velocities = polynomial_velocities(kCoefficients, 51);
  plan.bands = three_bands(51);
  return plan;
}

/// Speeds that rise and fall, about another centre.
MotionLawPlan mixed() {
  MotionLawPlan plan;
  plan.velocities = {0.01, 0.2, 0.03};
  plan.bands = {4e-3, 12e-3, 6e-3};
  plan.settle_s = 0.15;
  plan.acceleration = 2.0;
  plan.rest_s = 0.4;
  plan.centre = 0.1;
  return plan;
}

TEST(PolynomialVelocities, AreThoseOfThePaper) {
  const std::vector<double> v = polynomial_velocities(kCoefficients, 51);
  ASSERT_EQ(v.size(), 51U);
  EXPECT_NEAR(v.front(), 0.0243e-3, 1e-12);
  EXPECT_NEAR(v[1], 0.0484e-3, 1e-12);
  EXPECT_NEAR(v.back(), 50.7193e-3, 1e-12);
}

TEST(MotionLaw, LastsAsLongAsTheClosedFormSays) {
  const MotionLawPlan plan = the_papers();
  const MotionLaw law(plan);
  ASSERT_EQ(law.ramps().size(), 102U);
  // Up from -x_i to x_i, down to where the next speed begins.
  double total = 0.0, position = -1e-3 - 0.2 * plan.velocities[0];
  for (std::size_t i = 0; i < 51; ++i) {
    const std::size_t next = std::min<std::size_t>(i + 1, 50);
    const double v = plan.velocities[i];
    const double high = plan.bands[i] / 2.0 + 0.2 * v;
    const double low = -plan.bands[next] / 2.0 - 0.2 * plan.velocities[next];
    total +=
        (high - position) / v + v + (high - low) / v + v + 2.0;  // q / V + V / a, and the rests
    position = low;
  }
  EXPECT_NEAR(law.duration_s(), total, 1e-9 * total);
  EXPECT_NEAR(law.high(), 5e-3 + 0.2 * plan.velocities[50], 1e-15);
  EXPECT_NEAR(law.low(), -law.high(), 1e-15);
}

TEST(MotionLaw, NarrowBandsForTheSlowSpeedsSaveWhatThePaperSays) {
  // The paper: under a third of the time of one band. That is so, rests left out, if its fifty-one
  // speeds are i = 0 to 50; for the printed interval of 0.02 to 50 mm/s, which is i = 1 to 51, its
  // own figures give two fifths.
  const auto share_of_motion = [](const MotionLawPlan& plan) {
    const MotionLaw law(plan);
    const double rests = 2.0 * 51.0 * plan.rest_s;
    return (law.duration_s() - rests) / (law.single_band_duration_s() - rests);
  };
  MotionLawPlan plan = the_papers();
  EXPECT_NEAR(share_of_motion(plan), 0.385, 0.002);
  plan.velocities.insert(plan.velocities.begin(), kCoefficients[0]);
  plan.velocities.pop_back();
  EXPECT_LT(share_of_motion(plan), 1.0 / 3.0);
  plan.bands.assign(51, 10e-3);
  const MotionLaw single(plan);
  EXPECT_EQ(single.duration_s(), single.single_band_duration_s());
}

TEST(MotionLaw, IsAtItsSpeedThroughoutTheBand) {
  for (const MotionLawPlan& plan : {the_papers(), mixed()}) {
    const MotionLaw law(plan);
    std::size_t i = 0;
    for (const MotionRamp& ramp : law.ramps()) {
      SCOPED_TRACE(ramp.velocity);
      const double speed = plan.velocities[i / 2];
      const double direction = i % 2 == 0 ? 1.0 : -1.0;
      EXPECT_EQ(ramp.velocity, direction * speed);
      EXPECT_EQ(ramp.band, plan.bands[i / 2]);
      const double near = plan.centre - direction * ramp.band / 2.0;
      const double length = ramp.band_end_s - ramp.band_begin_s;
      for (const double share : {0.0, 0.37, 1.0}) {
        const double t = ramp.band_begin_s + share * length;
        EXPECT_NEAR(law.at(t), near + direction * share * ramp.band, 1e-12);
        EXPECT_NEAR(law.at(t), near + ramp.velocity * share * length, 1e-12);
      }
      EXPECT_GE(ramp.band_begin_s - ramp.start_s, speed / plan.acceleration);
      EXPECT_GE(ramp.end_s - ramp.band_end_s, speed / plan.acceleration);
      ++i;
    }
    EXPECT_EQ(i, 2 * plan.velocities.size());
  }
}

TEST(MotionLaw, NeverJumpsNorExceedsItsAcceleration) {
  // A bound on the second difference at every place bounds the acceleration, and lets the velocity
  // not jump.
  const MotionLawPlan plan = mixed();
  const MotionLaw law(plan);
  const double h = 1e-4;
  double most = 0.0;
  for (double t = -0.1; t < law.duration_s() + 0.1; t += 0.37 * h) {
    const double second = (law.at(t + h) - 2.0 * law.at(t) + law.at(t - h)) / (h * h);
    most = std::max(most, std::abs(second));
  }
  EXPECT_LE(most, plan.acceleration * (1.0 + 1e-6));
  EXPECT_GT(most, plan.acceleration * (1.0 - 1e-6));
}

TEST(MotionLaw, RestsAfterEveryRamp) {
  const MotionLawPlan plan = mixed();
  const MotionLaw law(plan);
  const auto& ramps = law.ramps();
  for (std::size_t i = 0; i < ramps.size(); ++i) {
    const double next = i + 1 < ramps.size() ? ramps[i + 1].start_s : law.duration_s();
    EXPECT_NEAR(next - ramps[i].end_s, 0.4, 1e-12);
    for (const double share : {0.0, 0.5, 1.0}) {
      EXPECT_NEAR(law.at(ramps[i].end_s + 0.4 * share), ramps[i].to, 1e-15);
    }
    if (i + 1 < ramps.size()) {
      EXPECT_EQ(ramps[i + 1].from, ramps[i].to);
    }
  }
  EXPECT_EQ(law.at(-1.0), ramps.front().from);
  EXPECT_EQ(law.at(1e9), ramps.back().to);
}

TEST(MotionLaw, RefusesWhatCannotBeDone) {
  const auto refused = [](const std::function<void(MotionLawPlan&)>& change, const char* message) {
    MotionLawPlan plan = mixed();
    change(plan);
    expect_error<std::invalid_argument>([&] { (void)MotionLaw(plan); }, {message});
  };
  refused([](MotionLawPlan& p) { p.velocities.clear(); }, "there are no velocities");
  refused([](MotionLawPlan& p) { p.bands.pop_back(); }, "2 bands for 3 velocities");
  refused([](MotionLawPlan& p) { p.velocities[1] = -0.2; },
          "velocity 2 (-200 mm/s) must be positive");
  refused([](MotionLawPlan& p) { p.velocities[1] = 0.0; }, "velocity 2 (0 mm/s) must be positive");
  refused([](MotionLawPlan& p) { p.velocities[1] = NAN; },
          "velocity 2 (nan mm/s) must be positive");
  refused([](MotionLawPlan& p) { p.bands[2] = 0.0; },
          "the band of velocity 3 (30 mm/s) is 0 mm, must be positive");
  refused([](MotionLawPlan& p) { p.acceleration = 0.0; }, "acceleration is 0 mm/s^2");
  refused([](MotionLawPlan& p) { p.settle_s = -1.0; }, "settle is -1 s");
  refused([](MotionLawPlan& p) { p.rest_s = -1.0; }, "rest is -1 s");
  refused([](MotionLawPlan& p) { p.centre = INFINITY; }, "centre is inf");
  refused([](MotionLawPlan& p) { p.travel = 0.0; }, "travel is 0 mm");
  refused([](MotionLawPlan& p) { p.travel = 0.071; },
          "velocity 2 (200 mm/s) needs 72 mm of travel and there are 71 mm");
  // 0.2 m/s from rest takes 10 mm at 2 m/s^2: settling for 0.05 s is just enough.
  refused([](MotionLawPlan& p) { p.settle_s = 0.0499; },
          "velocity 2 (200 mm/s) is not reached before its band: it takes 10 mm (v^2 / 2a) and has "
          "9.98 mm; settle for at least 0.05 s");
  MotionLawPlan plan = mixed();
  plan.settle_s = 0.05;
  plan.travel = 0.0321;  // 12 mm + 2 x 0.05 s x 200 mm/s, plus a margin for rounding
  EXPECT_NO_THROW((void)MotionLaw(plan));
}

}  // namespace
}  // namespace servotwin
