// The virgin curve by halving reversal branches, from recordings of the independent virtual
// machine.
#include "identification/torque/hysteresis.h"

#include <gtest/gtest.h>

#include <cmath>

#include "identification/torque/force_fit.h"
#include "tests/virtual_machine/axis.h"
#include "tests/virtual_machine/program.h"

namespace servotwin {
namespace {

namespace vm = virtual_machine;

constexpr double kLevel = 80.0;       // [N]
constexpr double kBreakaway = 30e-6;  // [m]

/// A stiff axis in position control that moves slowly back and forth under a constant load.
Segment slow_reversals(const vm::Gms& friction) {
  vm::Axis axis;
  axis.body.mass = 100.0;
  axis.body.constant_force = 25.0;
  axis.body.friction = friction;
  axis.drive.position_gain = 100.0;
  axis.drive.velocity_gain = 4e4;
  axis.drive.integral_gain = 4e6;
  axis.recorder.sample_time = 1e-3;
  vm::Trajectory motion;
  vm::reverse(motion, 200e-6, 8, {1e-3, 0.05, 5.0});
  const vm::AxisRecord record = vm::record(axis, motion);
  Segment s;
  s.sample_time_s = record.sample_time;
  s.command = record.command;
  s.actual = record.actual;
  s.torque = record.torque;
  return s;
}

/// The virgin curve of Maxwell-slip elements: each is a spring up to its level.
double virgin(const vm::Gms& friction, double x) {
  double force = 0.0;
  for (std::size_t i = 0; i < friction.stiffness.size(); ++i)
    force += std::min(friction.stiffness[i] * x, friction.share[i] * friction.level.coulomb);
  return force;
}

TEST(VirginCurve, HalvedReversalsAreTheCurveOfTheElements) {
  const vm::Gms friction = vm::gms_with_curve(kLevel, kBreakaway, 3.0, 8);
  const VirginCurve curve = virgin_curve_of({slow_reversals(friction)}, 150e-6, 100.0);
  EXPECT_EQ(curve.branches, 7);
  for (Eigen::Index k = 0; k < curve.force.size(); ++k)
    EXPECT_NEAR(curve.force(k), virgin(friction, curve.displacement(k)), 0.01 * kLevel)
        << curve.displacement(k);
  EXPECT_LT(curve.deviation.maxCoeff(), 0.01 * kLevel);
}

// The three parameters of the reduced GMS from the halved curve: the constant load drops out.
TEST(VirginCurve, GivesBreakawayForceAndDisplacement) {
  const vm::Gms friction = vm::gms_with_curve(kLevel, kBreakaway, 3.0, 8);
  const VirginCurve curve = virgin_curve_of({slow_reversals(friction)}, 150e-6, 100.0);
  const auto fit = fit_force(ForceData::of_virgin_curve(curve.displacement, curve.force),
                             {false, {kind_of<Presliding>()}});
  ASSERT_TRUE(fit);
  const Effect& presliding = fit->model.effects[0];
  EXPECT_NEAR(presliding.coefficient[0], kLevel, 0.01 * kLevel);
  // Where a concave curve ends is known only roughly.
  EXPECT_NEAR(presliding.shape[0], kBreakaway, 0.35 * kBreakaway);
  EXPECT_LT(fit->error.rms, 0.015 * kLevel);  // the machine's curve is not a reduced GMS
}

// The same parameters from the torque of the whole motion, without picking reversals. Thesis 4.4.2
// finds them differently: in open loop, by comparing the displacement that the model simulates for
// a recorded torque. Here the force of the recorded motion is fitted.
TEST(VirginCurve, TheForceFitOverTheWholeMotionFindsTheSame) {
  const vm::Gms friction = vm::gms_with_curve(kLevel, kBreakaway, 3.0, 8);
  const auto fit = fit_force(ForceData::of_motion({slow_reversals(friction)}, 0.0),
                             {true, {kind_of<Presliding>(), kind_of<ConstantForce>()}});
  ASSERT_TRUE(fit);
  EXPECT_NEAR(fit->model.effects[0].coefficient[0], kLevel, 0.02 * kLevel);
  EXPECT_NEAR(fit->model.effects[0].shape[0], kBreakaway, 0.35 * kBreakaway);
  EXPECT_NEAR(fit->model.effects[1].coefficient[0], 25.0, 0.5);
}

TEST(VirginCurve, NeedsReversalsWithTravel) {
  const Segment s = slow_reversals(vm::gms_with_curve(kLevel, kBreakaway, 3.0, 8));
  EXPECT_THROW((void)virgin_curve_of({s}, 300e-6, 100.0), std::runtime_error);
  EXPECT_THROW((void)virgin_curve_of({s}, 0.0, 100.0), std::runtime_error);
}

}  // namespace
}  // namespace servotwin
