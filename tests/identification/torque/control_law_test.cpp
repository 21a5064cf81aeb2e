// A torque that is made by a law with known coefficients, from a command whose derivatives are
// known in closed form, and one that is cut off.
#include "identification/torque/control_law.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>

namespace servotwin {
namespace {

constexpr double kStep_s = 1e-3;

/// Coefficients of the torque; the velocity control's integrator holds the command's position.
struct Law {
  double constant = 7.0, friction = 3.0, velocity = 9.0, position = 200.0, integral = 4e4,
         error = 1.2e6, rate = 30.0, acceleration = 5.0;
};

/// Two sines and a drift as the command, and any error, as if the machine were any. It begins and
/// ends in motion.
Segment made_by(const Law& law, double start_s = 0.0, double step_s = kStep_s) {
  std::mt19937_64 random(3);
  std::normal_distribution<double> normal;
  Segment s;
  s.start_s = start_s;
  s.sample_time_s = step_s;
  const Eigen::Index n = 6000;
  s.command.resize(n), s.actual.resize(n), s.torque.resize(n);
  const double w1 = 2.0 * std::numbers::pi * 0.7, w2 = 2.0 * std::numbers::pi * 1.9;
  double slow = 0.0, integral = 0.0;
  for (Eigen::Index k = 0; k < n; ++k) {
    const double t = 0.123 + step_s * static_cast<double>(k), before = slow;
    slow += 0.1 * (1e-5 * normal(random) - slow);
    // The drift makes the position none of the accelerations before.
    s.command(k) = 0.01 * t + 0.03 * std::sin(w1 * t) + 0.01 * std::sin(w2 * t);
    s.actual(k) = s.command(k) - slow;
    integral += step_s * slow;
    const double v = 0.01 + 0.03 * w1 * std::cos(w1 * t) + 0.01 * w2 * std::cos(w2 * t),
                 a = -0.03 * w1 * w1 * std::sin(w1 * t) - 0.01 * w2 * w2 * std::sin(w2 * t);
    s.torque(k) = law.constant + law.friction * (v > 0.0 ? 1.0 : -1.0) + law.velocity * v +
                  law.position * s.command(k) + law.integral * integral + law.error * slow +
                  law.rate * (slow - before) / step_s + law.acceleration * a;
  }
  return s;
}

/// RMS of what the law misses where it is known, over the RMS of the torque about its mean.
double missed_by(const Eigen::ArrayXd& asked, const Eigen::ArrayXd& torque, Eigen::Index& known) {
  double error = 0.0;
  known = 0;
  for (Eigen::Index k = 0; k < asked.size(); ++k) {
    if (!std::isfinite(asked(k))) continue;
    error += std::pow(asked(k) - torque(k), 2);
    ++known;
  }
  return std::sqrt(error / static_cast<double>(known) / (torque - torque.mean()).square().mean());
}

TEST(ControlLaw, IsThatOfTheControlInEverySegment) {
  Law other;
  other.constant = -30.0;  // its integrator starts elsewhere
  for (const double step_s : {kStep_s, 4.0 * kStep_s}) {
    const Segment first = made_by({}, 5.0, step_s), second = made_by(other, 50.0, step_s);
    const auto asked = asked_torque({first, second}, [](std::size_t i, Eigen::Index k) {
      return i == 0 ? k < 3000 : k > 4000;
    });
    ASSERT_EQ(asked.size(), 2U);
    for (const auto& [of, s] : {std::pair{asked[0], first}, std::pair{asked[1], second}}) {
      Eigen::Index known = 0;
      // The differences of the command are not quite its derivatives, and reverse a sample apart.
      EXPECT_LT(missed_by(of, s.torque, known), 0.01) << step_s;
      EXPECT_GT(known, s.size() - 20);
    }
  }
}

TEST(ControlLaw, GoesOnWhereTheMotorDoesNot) {
  Segment s = made_by({});
  const Eigen::ArrayXd wanted = s.torque;
  s.torque.segment(3000, 20) = s.torque(3000);
  const auto asked =
      asked_torque({s}, [](std::size_t, Eigen::Index k) { return k < 2990 || k > 3030; });
  ASSERT_EQ(asked.size(), 1U);
  const double size = (wanted - wanted.mean()).square().mean();
  EXPECT_LT((asked[0] - wanted).segment(3000, 20).square().mean(), 1e-5 * size);
  EXPECT_GT((asked[0] - s.torque).segment(3000, 20).square().mean(), 1e-3 * size);
}

TEST(ControlLaw, IsNotKnownAtTheEndsNorInASegmentThatIsNotFitted) {
  const Segment s = made_by({});
  const auto asked = asked_torque({s, s}, [](std::size_t i, Eigen::Index) { return i == 0; });
  ASSERT_EQ(asked.size(), 2U);
  EXPECT_TRUE(std::isnan(asked[0](0)));
  EXPECT_TRUE(std::isnan(asked[0](s.size() - 1)));
  EXPECT_TRUE(std::isfinite(asked[0](10)));
  EXPECT_TRUE(asked[1].isNaN().all());
}

TEST(ControlLaw, NeedsATorqueAndEnoughSamples) {
  Segment s = made_by({});
  const auto few = [](std::size_t, Eigen::Index k) { return k < 100; };
  EXPECT_TRUE(asked_torque({s}, few).empty());
  const auto all = [](std::size_t, Eigen::Index) { return true; };
  s.torque.setConstant(kAbsent);
  EXPECT_TRUE(asked_torque({s}, all).empty());
  s.torque.resize(0);
  EXPECT_TRUE(asked_torque({s}, all).empty());
}

}  // namespace
}  // namespace servotwin
