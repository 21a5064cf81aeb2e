// Motion of polygonal velocity against its closed form.
#include "tests/virtual_machine/velocity_ramps.h"

#include <gtest/gtest.h>

#include <cmath>
#include <stdexcept>

namespace servotwin::virtual_machine {
namespace {

TEST(VelocityRamps, TravelsTheAreaUnderItsVelocity) {
  VelocityRamps ramps(0.1);
  ramps.hold(0.5);
  ramps.accelerate_to(0.2, 4.0);
  ramps.hold(1.0);
  ramps.accelerate_to(-0.1, 2.0);
  ramps.hold(0.3);
  ramps.accelerate_to(0.0, 1.0);
  EXPECT_NEAR(ramps.duration(), 0.5 + 0.05 + 1.0 + 0.15 + 0.3 + 0.1, 1e-15);
  EXPECT_NEAR(ramps.end().position, 0.1 + 0.005 + 0.2 + 0.0075 - 0.03 - 0.005, 1e-15);
  EXPECT_EQ(ramps.end().velocity, 0.0);
  EXPECT_EQ(ramps.at(0.3).position, 0.1);
  EXPECT_NEAR(ramps.at(0.525).position, 0.1 + 0.5 * 4.0 * 0.025 * 0.025, 1e-15);
  EXPECT_NEAR(ramps.at(0.525).velocity, 0.1, 1e-15);
  EXPECT_EQ(ramps.at(0.525).acceleration, 4.0);
  EXPECT_EQ(ramps.at(1.0).velocity, 0.2);
  EXPECT_EQ(ramps.at(1.0).acceleration, 0.0);
  EXPECT_EQ(ramps.at(1.9).velocity, -0.1);
  for (const double t : {-1.0, 9.0}) {
    EXPECT_EQ(ramps.at(t).velocity, 0.0);
    EXPECT_EQ(ramps.at(t).position, t < 0.0 ? 0.1 : ramps.end().position);
  }
}

TEST(VelocityRamps, PositionAndVelocityAreContinuous) {
  VelocityRamps ramps;
  for (const double v : {0.1, 0.3, -0.2, 0.0}) {
    ramps.accelerate_to(v, 5.0);
    ramps.hold(0.03);
  }
  const Command command = ramps.command();
  const double h = 1e-5;
  for (double t = 0.0; t < ramps.duration(); t += h) {
    const Setpoint from = command(t), to = command(t + h);
    ASSERT_LE(std::abs(to.velocity - from.velocity), 5.0 * h * 1.0001) << t;
    ASSERT_NEAR(to.position - from.position, 0.5 * h * (from.velocity + to.velocity), 2e-10) << t;
  }
}

TEST(VelocityRamps, RefusesTimesThatAreNotPositive) {
  VelocityRamps ramps;
  EXPECT_THROW(ramps.hold(0.0), std::invalid_argument);
  EXPECT_THROW(ramps.hold(-1.0), std::invalid_argument);
  EXPECT_THROW(ramps.accelerate_to(1.0, 0.0), std::invalid_argument);
}

}  // namespace
}  // namespace servotwin::virtual_machine
