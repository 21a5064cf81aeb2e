// A torque that is made by a law of this form with known coefficients, and one that is cut off.
#include "identification/torque/control_law.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

namespace servotwin {
namespace {

constexpr double kStep_s = 1e-3;

/// Command, encoder and the torque of a P-PI control with feed-forward by its own formula; the
/// error is any, as if the machine were any.
Segment recorded(double rate_factor = 1.0) {
  std::mt19937_64 random(3);
  std::normal_distribution<double> normal;
  Segment s;
  s.sample_time_s = kStep_s * rate_factor;
  const Eigen::Index n = 6000;
  s.command.resize(n), s.actual.resize(n), s.torque.resize(n);
  double slow = 0.0, integral = 0.0, before = 0.0;
  for (Eigen::Index k = 0; k < n; ++k) {
    const double t = s.sample_time_s * static_cast<double>(k);
    slow += 0.1 * (1e-5 * normal(random) - slow);
    s.command(k) = 0.1 * t * t;
    s.actual(k) = s.command(k) - slow;
    integral += s.sample_time_s * slow;
    const double rate = (slow - before) / s.sample_time_s;
    before = slow;
    s.torque(k) =
        7.0 + 12.0 * slow * 1e5 + 30.0 * rate + 4e4 * integral + 50.0 * 0.2 + 9.0 * 0.2 * t;
  }
  return s;
}

TEST(ControlLaw, IsThatOfTheControl) {
  for (const double factor : {0.25, 1.0, 4.0}) {
    const Segment s = recorded(factor);
    const auto asked = asked_torque(
        {s, s}, [](std::size_t i, Eigen::Index k) { return i == 0 && k > 10 && k < 3000; });
    ASSERT_EQ(asked.size(), 2U);
    // The rate of the error needs the sample before, which 0.25 ms are not a lag of the law.
    const double most = factor < 1.0 ? 0.05 : 1e-6;
    for (const Eigen::ArrayXd& of : asked) {
      const Eigen::Index n = s.size();
      const double error = (of - s.torque).segment(20, n - 40).square().mean();
      const double size = (s.torque - s.torque.mean()).segment(20, n - 40).square().mean();
      EXPECT_LT(std::sqrt(error / size), most) << factor;
    }
  }
}

TEST(ControlLaw, GoesOnWhereTheMotorDoesNot) {
  Segment s = recorded();
  const Eigen::ArrayXd wanted = s.torque;
  s.torque.segment(3000, 20) = s.torque(3000);
  const auto asked = asked_torque(
      {s}, [](std::size_t, Eigen::Index k) { return (k > 10 && k < 2990) || k > 3030; });
  ASSERT_EQ(asked.size(), 1U);
  EXPECT_LT((asked[0] - wanted).segment(3000, 20).abs().maxCoeff(), 1e-6 * wanted.abs().maxCoeff());
  EXPECT_GT((asked[0] - s.torque).segment(3000, 20).abs().maxCoeff(), 1.0);
}

TEST(ControlLaw, NeedsATorqueAndEnoughSamples) {
  Segment s = recorded();
  const auto few = [](std::size_t, Eigen::Index k) { return k < 100; };
  EXPECT_TRUE(asked_torque({s}, few).empty());
  s.torque.setConstant(kAbsent);
  EXPECT_TRUE(asked_torque({s}, [](std::size_t, Eigen::Index) { return true; }).empty());
  s.torque.resize(0);
  EXPECT_TRUE(asked_torque({s}, [](std::size_t, Eigen::Index) { return true; }).empty());
}

}  // namespace
}  // namespace servotwin
