#include "identification/model/motor_torque.h"

#include <gtest/gtest.h>

#include <cmath>

namespace servotwin {
namespace {

constexpr double kTorqueCycle_s = 1e-3;

TEST(LaggedTorque, OfARampIsTheRampLater) {
  const Eigen::ArrayXd ramp = Eigen::ArrayXd::LinSpaced(100, 0.0, 99.0);
  for (const double lag_s : {2.5e-3, 2e-3, -1.25e-3, 0.0}) {
    const Eigen::ArrayXd out = lagged(ramp, {lag_s, false}, kTorqueCycle_s);
    for (Eigen::Index k = 5; k < 95; ++k)
      EXPECT_NEAR(out(k), ramp(k) - lag_s / kTorqueCycle_s, 1e-12) << lag_s << ' ' << k;
  }
}

TEST(LaggedTorque, BehindAFilterAnswersAStepAsAFilterOfFirstOrder) {
  constexpr double kTimeConstant_s = 7e-3;
  Eigen::ArrayXd step = Eigen::ArrayXd::Ones(100);
  step(0) = 0.0;
  const Eigen::ArrayXd out = lagged(step, {kTimeConstant_s, true}, kTorqueCycle_s);
  for (Eigen::Index k = 0; k < 100; ++k)
    EXPECT_NEAR(out(k), 1.0 - std::exp(-static_cast<double>(k) * kTorqueCycle_s / kTimeConstant_s),
                1e-12);
}

}  // namespace
}  // namespace servotwin
