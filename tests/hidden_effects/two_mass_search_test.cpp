// The start of a fit of two masses, from the phases in which the axis slides. The machine shares no
// code with the twin, and its friction has another law than the rigid axis that is given.
#include "identification/loop/two_mass_search.h"

#include <gtest/gtest.h>

#include <limits>
#include <numbers>
#include <optional>

#include "identification/loop/two_mass_fit.h"
#include "tests/hidden_effects/brisk_moves.h"
#include "tests/support/two_masses.h"
#include "twin/two_mass_axis.h"

namespace servotwin::hidden_effects {
namespace {

using Family = Friction::Family;

constexpr int kRoundsOfMoves = 6;
constexpr double kEncoderNoise = 1e-8;

/// 100 kg whose friction builds up over some 20 um and falls with speed by a quarter.
Rig machine(Family family) {
  Rig rig;
  rig.friction.family = family;
  rig.friction.level = 40.0;
  rig.friction.viscous = 150.0;
  rig.friction.bristle_damping = 1e-3;
  rig.friction.stribeck_rise = 0.25;
  rig.drive.position_gain = 60.0;
  rig.drive.velocity_gain = 100.0 * 350.0;
  rig.drive.integral_time = 0.012;
  rig.reading.noise = kEncoderNoise;
  return rig;
}

Rig sprung(Family family) {
  Rig rig = machine(family);
  rig.body.spring_frequency_hz = 58.0;
  rig.body.damping_ratio = 0.15;
  rig.body.motor_share = 0.35;
  return rig;
}

/// How many times slower than the drive a rigid axis is that was fitted to a load on a spring.
struct Slower {
  double gain = 1.5, position = 1.5;
};

/// A rigid axis with Coulomb friction and the gains of the rig, but slower.
Model slow_rigid(const Rig& rig, const Slower& slower = {}) {
  const double gain = rig.drive.velocity_gain / rig.body.mass / slower.gain,
               position = rig.drive.position_gain / slower.position,
               reset = rig.drive.integral_time > 0.0
                           ? 1.0 / rig.drive.integral_time / slower.position
                           : 0.0;
  Model out;
  out.sample_time_s = rig.reading.sample_time;
  out.loop.order = reset > 0.0 ? 3 : 2;
  out.loop.denominator = {gain, gain * (position + reset), gain * position * reset};
  out.loop.numerator = {1.0, gain, gain * reset};
  Effect friction;
  friction.kind = kind_of<CoulombFriction>();
  std::size_t i = 0;
  for (const Parameter& p : shapes_of(friction.kind)) friction.shape[i++] = p.start;
  friction.coefficient[0] = rig.friction.level / rig.body.mass;
  out.effects = {friction};
  return out;
}

Structure structure_of(const Model& model) {
  Structure out;
  out.order = model.loop.order;
  for (const Effect& effect : model.effects) out.effects.push_back(effect.kind);
  return out;
}

std::optional<TwoMassStart> start_of(const Rig& rig, const Model& rigid, std::size_t kind) {
  const SegmentedAxis axis = recorded_brisk_moves(rig, kRoundsOfMoves);
  return two_mass_start(axis.segments, structure_of(rigid), rigid, kind);
}

class TwoMassStartOf : public testing::TestWithParam<Family> {};

TEST_P(TwoMassStartOf, ASpringHasItWhateverTheLawOfFriction) {
  const Rig rig = sprung(GetParam());
  const auto start = start_of(rig, slow_rigid(rig), kind_of<TwoMassMotorEncoder>());
  ASSERT_TRUE(start);
  const TwoMassParameters found = two_mass_parameters(*two_mass_of(start->model));
  EXPECT_NEAR(found.omega / (2.0 * std::numbers::pi * rig.body.spring_frequency_hz), 1.0, 0.05);
  // The grid begins with a damping of 0.05, and shares of 0.5 and 0.75.
  EXPECT_NEAR(found.zeta, rig.body.damping_ratio, 0.06);
  EXPECT_NEAR(found.load_share, 1.0 - rig.body.motor_share, 0.1);
  EXPECT_LT(start->rms, 1.2 * kEncoderNoise);
}

INSTANTIATE_TEST_SUITE_P(Laws, TwoMassStartOf,
                         testing::Values(Family::kCoulomb, Family::kMaxwell, Family::kLuGre));

// Friction on the load hides the drive from a rigid axis, which was found ten times slower.
TEST(TwoMassStartOfASlowLoop, IsThatOfTheDrive) {
  Rig rig = test::two_masses(Family::kMaxwell, 150.0, 0.0);
  rig.drive.position_from = rig.reading.recorded = Encoder::kMotor;
  const auto start = start_of(rig, slow_rigid(rig, {10.0, 2.8}), kind_of<TwoMassMotorEncoder>());
  ASSERT_TRUE(start);
  const double gain = rig.drive.velocity_gain / rig.body.mass;
  EXPECT_GT(start->model.loop.denominator[0], 0.5 * gain);
  EXPECT_LT(start->model.loop.denominator[0], 2.0 * gain);
  const TwoMassParameters found = two_mass_parameters(*two_mass_of(start->model));
  EXPECT_NEAR(found.omega / (2.0 * std::numbers::pi * rig.body.spring_frequency_hz), 1.0, 0.05);
}

// With its encoder at the load, damping and share of the load make up for each other while the axis
// slides: what leaves least is a load of 3 %.
TEST(TwoMassStartOfALoadEncoder, IsNoLoadThatIsFarTooLight) {
  const Rig rig = test::two_masses(Family::kLuGre, 150.0, 0.0);
  const auto start = start_of(rig, slow_rigid(rig), kind_of<TwoMassLoadEncoder>());
  ASSERT_TRUE(start);
  const TwoMassParameters found = two_mass_parameters(*two_mass_of(start->model));
  EXPECT_GT(found.load_share, 0.3 * (1.0 - rig.body.motor_share));
  EXPECT_LT(found.load_share, 1.5 * (1.0 - rig.body.motor_share));
}

// A load at a spring that is known to weigh: its weight belongs to the last gain, which the start
// changes.
TEST(TwoMassStartOfAWeight, ScalesItWithTheGains) {
  Rig rig = sprung(Family::kCoulomb);
  rig.drive.integral_time = 0.0;
  rig.body.constant_force = 120.0;
  Model rigid = slow_rigid(rig);
  rigid.effects.push_back({});
  rigid.effects.back().kind = kind_of<ConstantForce>();
  // What a loop with this gain makes of the deflection that the weight causes.
  const double stiffness = rig.drive.velocity_gain * rig.drive.position_gain / rig.body.mass;
  rigid.effects.back().coefficient[0] =
      rig.body.constant_force / rig.body.mass * rigid.loop.denominator[1] / stiffness;
  const auto start = start_of(rig, rigid, kind_of<TwoMassMotorEncoder>());
  ASSERT_TRUE(start);
  EXPECT_NEAR(start->model.find(kind_of<ConstantForce>())->coefficient[0],
              rig.body.constant_force / rig.body.mass, 0.1);
  const TwoMassParameters found = two_mass_parameters(*two_mass_of(start->model));
  EXPECT_NEAR(found.omega / (2.0 * std::numbers::pi * rig.body.spring_frequency_hz), 1.0, 0.05);
}

// A rigid axis whose screw has a ripple: no spring explains it, whatever the law of friction.
class TwoMassStartOfARipple : public testing::Test {
 protected:
  TwoMassStartOfARipple() {
    Rig rig = machine(Family::kLuGre);
    rig.body.cogging = 8.0;
    axis_ = recorded_brisk_moves(rig, kRoundsOfMoves);
    rigid_ = slow_rigid(rig);
    start_ = two_mass_start(axis_.segments, structure_of(rigid_), rigid_, kKind);
  }

  static constexpr std::size_t kKind = kind_of<TwoMassMotorEncoder>();
  SegmentedAxis axis_;
  Model rigid_;
  std::optional<TwoMassStart> start_;
};

TEST_F(TwoMassStartOfARipple, SaysWhatASpringLeavesAtLeast) {
  constexpr int kRoundsOfFit = 30, kPassesOfFit = 2;
  ASSERT_TRUE(start_);
  EXPECT_GT(start_->least, 10.0 * kEncoderNoise);
  for (const std::size_t law : {kind_of<Presliding>(), kind_of<LuGre>(), kind_of<MaxwellSlip>()}) {
    const auto begun = with_law({structure_of(start_->model), start_->model}, law);
    const auto fit = refined(*begun, axis_.segments, 0.0, kRoundsOfFit, kPassesOfFit);
    ASSERT_TRUE(fit);
    EXPECT_GT(fit->rms, 0.95 * start_->least);
  }
}

TEST_F(TwoMassStartOfARipple, IsNotFittedWhereLessIsAsked) {
  const auto fit_below = [&](double most) {
    return fit_two_masses(axis_.segments, structure_of(rigid_), rigid_, rigid_, most, {kKind}, 0.0,
                          [](const Model&) { return true; });
  };
  ASSERT_TRUE(start_);
  EXPECT_TRUE(fit_below(std::numeric_limits<double>::infinity()));
  EXPECT_FALSE(fit_below(0.8 * start_->least));
}

TEST(TwoMassStart, OfASpringLeavesTheNoiseAtLeast) {
  const Rig rig = sprung(Family::kLuGre);
  const auto start = start_of(rig, slow_rigid(rig), kind_of<TwoMassMotorEncoder>());
  ASSERT_TRUE(start);
  EXPECT_GT(start->least, 0.5 * kEncoderNoise);
  EXPECT_LT(start->least, 1.05 * kEncoderNoise);
}

TEST(TwoMassStart, IsNoneBesideAFilterOrAtRest) {
  const Rig rig = sprung(Family::kCoulomb);
  const SegmentedAxis axis = recorded_brisk_moves(rig, kRoundsOfMoves);
  Model filtered = slow_rigid(rig);
  filtered.effects.push_back(make_effect<ControlFilter>());
  const std::size_t kind = kind_of<TwoMassMotorEncoder>();
  EXPECT_FALSE(two_mass_start(axis.segments, structure_of(filtered), filtered, kind));
  SegmentedAxis still = axis;
  still.segments.front().command = still.segments.front().actual = Eigen::ArrayXd::Zero(5000);
  const Model rigid = slow_rigid(rig);
  EXPECT_FALSE(two_mass_start(still.segments, structure_of(rigid), rigid, kind));
}

}  // namespace
}  // namespace servotwin::hidden_effects
