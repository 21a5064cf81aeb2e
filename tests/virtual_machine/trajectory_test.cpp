#include "tests/virtual_machine/trajectory.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <stdexcept>

#include "tests/virtual_machine/program.h"

namespace servotwin::virtual_machine {
namespace {

using std::numbers::pi;

constexpr Limits kLimits{.velocity = 0.1, .acceleration = 2.0, .jerk = 60.0};

/// Largest |velocity|, |acceleration| and |jerk|, and the largest disagreement between a derivative
/// and the difference of what it is the derivative of.
struct Extremes {
  double velocity = 0.0, acceleration = 0.0, jerk = 0.0;
  double velocity_gap = 0.0, acceleration_gap = 0.0;
};

Extremes extremes_of(const Trajectory& trajectory) {
  Extremes x;
  const double h = 1e-5;
  for (double t = h; t < trajectory.duration(); t += 10.0 * h) {
    const Setpoint p = trajectory.at(t);
    const Setpoint before = trajectory.at(t - h);
    const Setpoint after = trajectory.at(t + h);
    x.velocity = std::max(x.velocity, std::abs(p.velocity));
    x.acceleration = std::max(x.acceleration, std::abs(p.acceleration));
    x.jerk = std::max(x.jerk, std::abs(p.jerk));
    x.velocity_gap = std::max(
        x.velocity_gap, std::abs((after.position - before.position) / (2.0 * h) - p.velocity));
    x.acceleration_gap =
        std::max(x.acceleration_gap,
                 std::abs((after.velocity - before.velocity) / (2.0 * h) - p.acceleration));
  }
  return x;
}

TEST(Trajectory, LongMoveHasTheTimeOfTheClosedForm) {
  Trajectory trajectory(0.02);
  trajectory.move_to(0.22, kLimits);
  // D / v + v / A + A / j
  EXPECT_NEAR(trajectory.duration(), 0.2 / 0.1 + 0.1 / 2.0 + 2.0 / 60.0, 1e-12);
  EXPECT_DOUBLE_EQ(trajectory.end_position(), 0.22);
  EXPECT_NEAR(trajectory.at(trajectory.duration() / 2.0).position, 0.12, 1e-12);
  EXPECT_DOUBLE_EQ(trajectory.at(trajectory.duration() / 2.0).velocity, 0.1);
}

TEST(Trajectory, ShortMoveHasTheTimeOfTheClosedForm) {
  // Neither velocity nor acceleration limit reached: four jerk phases of (D / 2 j)^(1/3) each.
  Trajectory trajectory;
  trajectory.move_to(-1e-3, kLimits);
  EXPECT_NEAR(trajectory.duration(), 4.0 * std::cbrt(1e-3 / (2.0 * 60.0)), 1e-12);
  EXPECT_NEAR(trajectory.at(trajectory.duration() / 2.0).position, -0.5e-3, 1e-15);
}

TEST(Trajectory, StaysWithinItsLimitsAndIsSmooth) {
  Trajectory trajectory;
  trajectory.dwell(0.05);
  for (const double target : {0.3, 0.29, -0.01, -0.0101, 0.004})
    trajectory.move_to(target, kLimits);
  const Extremes x = extremes_of(trajectory);
  EXPECT_NEAR(x.velocity, 0.1, 1e-12);
  EXPECT_NEAR(x.acceleration, 2.0, 1e-12);
  EXPECT_NEAR(x.jerk, 60.0, 1e-12);
  // Within 1e-5 s of a jump of the jerk the difference is off by at most j h / 2.
  EXPECT_LT(x.velocity_gap, 1e-8);
  EXPECT_LE(x.acceleration_gap, 60.0 * 1e-5 / 2.0 + 1e-9);
}

TEST(Trajectory, RestsBeforeItsStartAndAfterItsEnd) {
  Trajectory trajectory(0.5);
  EXPECT_DOUBLE_EQ(trajectory.at(1.0).position, 0.5);
  trajectory.move_to(0.6, kLimits);
  EXPECT_DOUBLE_EQ(trajectory.at(-1.0).position, 0.5);
  EXPECT_DOUBLE_EQ(trajectory.at(99.0).position, 0.6);
  EXPECT_DOUBLE_EQ(trajectory.at(99.0).velocity, 0.0);
}

TEST(Trajectory, ArcRunsOnItsCircle) {
  PlanePath path(0.1, -0.2);
  path.arc(0.01, pi / 3.0, -2.0 * pi, kLimits);
  const double cx = 0.1 - 0.01 * std::cos(pi / 3.0);
  const double cy = -0.2 - 0.01 * std::sin(pi / 3.0);
  EXPECT_DOUBLE_EQ(path.x().duration(), path.y().duration());
  for (double t = 0.0; t < path.x().duration(); t += 1e-3) {
    const Setpoint x = path.x().at(t);
    const Setpoint y = path.y().at(t);
    EXPECT_NEAR(std::hypot(x.position - cx, y.position - cy), 0.01, 1e-15);
    EXPECT_LE(std::hypot(x.velocity, y.velocity), 0.1 + 1e-12);
  }
  EXPECT_NEAR(path.x().end_position(), 0.1, 1e-15);
  EXPECT_NEAR(path.y().end_position(), -0.2, 1e-15);
  // Inside of a phase the jerk is the derivative of the acceleration, too.
  for (const double t : {0.02, 0.3, 0.65}) {
    EXPECT_NEAR((path.x().at(t + 1e-5).acceleration - path.x().at(t - 1e-5).acceleration) / 2e-5,
                path.x().at(t).jerk, 1e-4 * 60.0)
        << t;
  }
  // Clockwise: from 60 degrees it moves to the right and down.
  EXPECT_GT(path.x().at(0.05).position, 0.1);
  EXPECT_LT(path.y().at(0.05).position, -0.2);
  const Extremes x = extremes_of(path.x());
  EXPECT_LT(x.velocity_gap, 1e-8);
  EXPECT_LE(x.acceleration_gap, 60.0 * 1e-5 / 2.0 + 1e-9);
}

TEST(PlanePath, LinesAreStraight) {
  PlanePath path(0.0, 0.0);
  path.line_to(0.03, -0.04, kLimits);
  for (double t = 0.0; t < path.x().duration(); t += 1e-3) {
    EXPECT_NEAR(path.y().at(t).position, -4.0 / 3.0 * path.x().at(t).position, 1e-16);
  }
  EXPECT_DOUBLE_EQ(path.x().end_position(), 0.03);
  EXPECT_DOUBLE_EQ(path.y().end_position(), -0.04);
}

TEST(Moves, FillTheirTimeWithinTheirStrokeAndRepeatWithTheSeed) {
  const MoveMix mix{.duration = 10.0, .stroke = 0.08};
  const Trajectory a = moves(mix, 5);
  const Trajectory b = moves(mix, 5);
  const Trajectory c = moves(mix, 6);
  EXPECT_NEAR(a.duration(), 10.0, 1e-9);
  double difference = 0.0;
  double slow = 0.0;
  double fast = 0.0;
  for (double t = 0.0; t < 10.0; t += 1e-3) {
    const Setpoint p = a.at(t);
    EXPECT_EQ(p.position, b.at(t).position);
    EXPECT_LE(std::abs(p.position), 0.04 + 1e-3 + 1e-12);
    difference = std::max(difference, std::abs(p.position - c.at(t).position));
    if (std::abs(p.velocity) > 1e-4 && std::abs(p.velocity) < 0.02) slow += 1e-3;
    if (std::abs(p.velocity) > 0.1) fast += 1e-3;
  }
  EXPECT_GT(difference, 0.01);
  EXPECT_GT(slow, 0.5);
  EXPECT_GT(fast, 0.2);
}

TEST(Trajectory, RefusesWhatCannotBeMoved) {
  Trajectory trajectory;
  EXPECT_THROW(trajectory.dwell(0.0), std::invalid_argument);
  EXPECT_THROW(trajectory.move_to(1.0, {0.0, 1.0, 1.0}), std::invalid_argument);
  EXPECT_THROW(trajectory.move_to(1.0, {1.0, -1.0, 1.0}), std::invalid_argument);
  EXPECT_THROW(trajectory.move_to(1.0, {1.0, 1.0, NAN}), std::invalid_argument);
  EXPECT_THROW(trajectory.move_to(NAN, kLimits), std::invalid_argument);
  EXPECT_THROW(trajectory.line(2.0, 1.0, kLimits), std::invalid_argument);
  EXPECT_THROW(trajectory.arc(-1.0, 0.0, 1.0, kLimits), std::invalid_argument);
  EXPECT_DOUBLE_EQ(trajectory.duration(), 0.0);
}

}  // namespace
}  // namespace servotwin::virtual_machine
