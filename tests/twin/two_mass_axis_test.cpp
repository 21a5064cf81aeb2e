// The axis of two masses against a cascade control in front of two bodies, integrated by
// tests/support/two_mass_machine.h; and in its limits against the rigid axis and closed forms.

#include "twin/two_mass_axis.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "tests/support/two_mass_machine.h"
#include "twin/twin.h"

namespace servotwin {
namespace {

using test::integrated;
using test::model_of;
using test::Setpoint;
using Axis = test::TwoBodies;
using Drive = test::Cascade;

Setpoint setpoint(double t) {
  // 1 mm sin^3: starts at rest with no acceleration.
  const double w = kTwoPi * 1.3, s = std::sin(w * t), c = std::cos(w * t), size = 1e-3;
  return {size * s * s * s, size * w * 3.0 * s * s * c,
          size * w * w * (6.0 * s * c * c - 3.0 * s * s * s)};
}

Segment commanded(double h, std::size_t rows) {
  Segment s;
  s.sample_time_s = h;
  s.command.resize(static_cast<Eigen::Index>(rows));
  for (std::size_t k = 0; k < rows; ++k)
    s.command(static_cast<Eigen::Index>(k)) = setpoint(h * static_cast<double>(k)).x;
  return s;
}

struct Apart {
  double rms = 0.0, by = 0.0;  ///< of the difference, and of the error itself
};
Apart apart(const Drive& drive, const Axis& axis, double h) {
  const auto rows = static_cast<std::size_t>(std::lround(2.0 / h));
  const std::vector<double> truth = integrated(drive, axis, h, rows, setpoint);
  const Eigen::ArrayXd error = simulate(model_of(drive, axis, h), commanded(h, rows));
  Apart out;
  for (std::size_t k = 0; k < rows; ++k) {
    const double d = error(static_cast<Eigen::Index>(k)) - truth[k];
    out.rms += d * d;
    out.by += truth[k] * truth[k];
  }
  return {std::sqrt(out.rms / static_cast<double>(rows)),
          std::sqrt(out.by / static_cast<double>(rows))};
}

class TwoMassAxisTest : public testing::TestWithParam<Encoders> {};

// The command is a spline through samples and friction is linear within a cycle: both errors are of
// higher order in the cycle.
TEST_P(TwoMassAxisTest, FollowsTheDifferentialEquation) {
  for (const double reset : {60.0, 0.0}) {
    Drive drive;
    drive.reset = reset;
    Axis axis;
    axis.encoders = GetParam();
    axis.load_friction = 0.0;
    const Apart smooth = apart(drive, axis, 1e-3);
    EXPECT_LT(smooth.rms, 2e-5 * smooth.by) << "without friction, reset " << reset;
    axis.load_friction = 0.3;
    axis.motor_friction = 0.2;
    axis.constant_force = 0.4;
    const Apart rough = apart(drive, axis, 1e-3);
    EXPECT_LT(rough.rms, 3e-3 * rough.by) << "with friction on both, reset " << reset;
    const Apart fine = apart(drive, axis, 0.25e-3);
    EXPECT_LT(fine.rms, 3e-4 * fine.by) << "in short cycles, reset " << reset;
  }
}

TEST_P(TwoMassAxisTest, CrossesItsPlayAsTheDifferentialEquation) {
  Axis axis;
  axis.encoders = GetParam();
  axis.width = 2e-5;
  for (const double reset : {60.0, 0.0}) {
    Drive drive;
    drive.reset = reset;
    for (const double force : {0.0, 0.8}) {
      axis.constant_force = force;
      const Apart coarse = apart(drive, axis, 1e-3);
      EXPECT_LT(coarse.rms, 2e-2 * coarse.by) << force << ", reset " << reset;
      const Apart fine = apart(drive, axis, 0.25e-3);
      EXPECT_LT(fine.rms, 4e-3 * fine.by) << force << ", reset " << reset;
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Encoders, TwoMassAxisTest,
                         testing::Values(Encoders::kMotor, Encoders::kLoad, Encoders::kOutside));

// A stiff spring: motor and load move as one, and the error is that of the rigid axis.
TEST(TwoMassAxis, IsTheRigidAxisInTheLimit) {
  Axis axis;
  axis.frequency_hz = 2000.0;
  axis.zeta = 0.7;
  const Model two = model_of(Drive(), axis, 1e-3);
  Model rigid = two;
  rigid.effects.pop_back();
  const Segment segment = commanded(1e-3, 2000);
  const Eigen::ArrayXd stiff = simulate(two, segment), one = simulate(rigid, segment);
  EXPECT_LT((stiff - one).abs().maxCoeff(), 5e-4 * one.abs().maxCoeff());
}

// The rate of the load's own vibration, where the motor is held fast: omega sqrt(1 - zeta^2).
TEST(TwoMassAxis, ALoadRingsAtItsFrequencyBehindAMotorThatIsHeld) {
  Drive held{800.0, 8000.0, 0.0, 1.0, 0.0};
  Axis axis;
  axis.encoders = Encoders::kOutside;
  axis.load_friction = 0.0;
  axis.zeta = 0.01;
  Twin twin(model_of(held, axis, 1e-3));
  const std::array<double, 4> state{0.0, 0.0, 1e-5, 0.0};  // the spring is drawn out
  twin.start(0.0, state);
  std::vector<double> crossings;
  double before = twin.position();
  for (int k = 1; k < 2000; ++k) {
    twin.step({});
    const double now = twin.position();
    if ((now > 0.0) != (before > 0.0)) crossings.push_back(k - 1 + before / (before - now));
    before = now;
  }
  ASSERT_GT(crossings.size(), 20U);
  const double hertz =
      0.5e3 * static_cast<double>(crossings.size() - 1) / (crossings.back() - crossings.front());
  EXPECT_NEAR(hertz, axis.frequency_hz, 0.02 * axis.frequency_hz);
}

// With the position loop closed at the load of a soft spring the machine shakes itself. The truth
// is the integrator: the error grows.
TEST(TwoMassAxis, ALoopThatIsUnstableWithTheSpringIsRefused) {
  Axis axis;
  axis.encoders = Encoders::kLoad;
  axis.frequency_hz = 12.0;
  axis.load_friction = 0.0;
  const std::vector<double> errors = integrated(Drive(), axis, 1e-3, 3000, setpoint);
  const auto largest = [&](std::size_t from, std::size_t to) {
    double most = 0.0;
    for (std::size_t k = from; k < to; ++k) most = std::max(most, std::abs(errors[k]));
    return most;
  };
  ASSERT_GT(largest(2000, 3000), 10.0 * largest(0, 1000));
  EXPECT_NE(why_invalid(model_of(Drive(), axis, 1e-3)).find("unstable with this spring"),
            std::string::npos);
  axis.frequency_hz = 60.0;
  EXPECT_EQ(why_invalid(model_of(Drive(), axis, 1e-3)), "");
}

// A weight holds the load on one side of the gap from the start on.
TEST(TwoMassAxis, StandsStillUnderAWeightWithPlay) {
  for (const Encoders encoders : {Encoders::kMotor, Encoders::kLoad, Encoders::kOutside}) {
    Axis axis;
    axis.encoders = encoders;
    axis.width = 2e-5;
    axis.constant_force = 0.8;
    Twin twin(model_of(Drive(), axis, 1e-3));
    twin.start(0.01);
    const double stands = twin.position();
    CommandPiece still;
    still.end_position = 0.01;
    for (int k = 0; k < 200; ++k) {
      twin.step(still);
      ASSERT_NEAR(twin.position(), stands, 1e-12) << k;
    }
  }
}

// Friction is there twice, and there is room for one law and what joins it.
TEST(TwoMassAxis, MoreFrictionThanAModelCanHaveIsRefused) {
  Axis axis;
  axis.motor_friction = 0.3;
  Model model = model_of(Drive(), axis, 1e-3);
  while (model.effects.size() < static_cast<std::size_t>(kMaxEffects))
    model.effects.push_back(make_effect<CoulombFriction>());
  EXPECT_NE(why_invalid(model).find("of friction beside two_mass"), std::string::npos);
}

TEST(TwoMassAxis, IsRefusedBesideAModeAndBesideAnother) {
  Model model = model_of(Drive(), Axis(), 1e-3);
  EXPECT_EQ(why_invalid(model), "");
  model.loop.modes.push_back({300.0, 0.05, 0.0, 0.0, 0.0, 0.0});
  EXPECT_NE(why_invalid(model).find("the two masses are the mode"), std::string::npos);
  model.loop.modes.clear();
  model.effects.push_back(make_effect<PlayOutside>());
  EXPECT_NE(why_invalid(model).find("an axis has one of them"), std::string::npos);
}

}  // namespace
}  // namespace servotwin
