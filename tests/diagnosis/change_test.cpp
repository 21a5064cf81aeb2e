// A change of the model against the loop derived directly from the changed drive: the closed form
// of diagnosis/search/change.h, evaluated here from the physical parameters.
#include "diagnosis/search/change.h"

#include <gtest/gtest.h>

#include <algorithm>

namespace servotwin {
namespace {

/// m x'' = Kv (1 + 1/(Ti s)) (Kp e + f x_r' - x') + m_ff x_r'' - F - B x'.
struct Drive {
  double mass = 120.0, velocity_gain = 36'000.0, position_gain = 80.0, integral = 25.0;
  double feedforward = 0.4, mass_feedforward = 30.0, friction = 24.0, viscous = 0.0;

  [[nodiscard]] Model model(int order) const {
    const double k = velocity_gain / mass, b = viscous / mass;
    Model m;
    m.sample_time_s = 1e-3;
    m.loop.order = order;
    m.loop.numerator = {1.0 - mass_feedforward / mass, k * (1.0 - feedforward) + b, 0.0};
    if (order == 2) {
      m.loop.denominator = {k + b, k * position_gain, 0.0};
    } else {
      m.loop.denominator = {k + b, k * (integral + position_gain), k * integral * position_gain};
      m.loop.numerator[2] = k * (1.0 - feedforward) * integral;
    }
    Effect coulomb = make_effect<CoulombFriction>();
    coulomb.coefficient[0] = friction / mass;
    m.effects = {coulomb};
    return m;
  }
};

Model changed(const Drive& drive, int order, const std::string& name, double value) {
  Model model = drive.model(order);
  for (const Change& change : changes_of(model)) {
    if (change.quantities.front().name != name) continue;
    change.apply(model, {&value, 1});
    return model;
  }
  ADD_FAILURE() << "no change " << name;
  return model;
}

void expect_same(const Model& is, const Model& should) {
  for (std::size_t i = 0; i < kMaxOrder; ++i) {
    EXPECT_NEAR(is.loop.denominator[i], should.loop.denominator[i],
                1e-12 * (1.0 + should.loop.denominator[i]));
    EXPECT_NEAR(is.loop.numerator[i], should.loop.numerator[i],
                1e-12 * (1.0 + should.loop.denominator[i]));
  }
  ASSERT_EQ(is.effects.size(), should.effects.size());
  EXPECT_NEAR(is.effects[0].coefficient[0], should.effects[0].coefficient[0], 1e-12);
}

class AChange : public testing::TestWithParam<int> {};

TEST_P(AChange, OfMassIsTheLoopOfTheHeavierTable) {
  Drive after;
  after.mass *= 1.35;
  expect_same(changed({}, GetParam(), "mass", 0.35), after.model(GetParam()));
}

TEST_P(AChange, OfThePositionGainLeavesTheRest) {
  Drive after;
  after.position_gain *= 0.7;
  expect_same(changed({}, GetParam(), "position_loop_gain", -0.3), after.model(GetParam()));
}

TEST_P(AChange, OfTheVelocityGainLeavesForcesAsTheyAre) {
  Drive after;
  after.velocity_gain *= 1.2;
  expect_same(changed({}, GetParam(), "velocity_loop_gain", 0.2), after.model(GetParam()));
}

TEST_P(AChange, OfFeedforwardIsInTheNumeratorAlone) {
  Drive after;
  after.feedforward += 0.15;
  expect_same(changed({}, GetParam(), "velocity_feedforward", 0.15), after.model(GetParam()));
  after = {};
  after.mass_feedforward += 0.2 * after.mass;
  expect_same(changed({}, GetParam(), "acceleration_feedforward", 0.2), after.model(GetParam()));
}

TEST_P(AChange, OfFrictionScalesItsForceAndViscousFrictionIsPartOfTheLoop) {
  Drive after;
  after.friction *= 1.8;
  expect_same(changed({}, GetParam(), "friction", 0.8), after.model(GetParam()));
  after = {};
  after.viscous = 360.0;
  expect_same(changed({}, GetParam(), "viscous", 3.0), after.model(GetParam()));
}
INSTANTIATE_TEST_SUITE_P(Order, AChange, testing::Values(2, 3));

TEST(AChangeOfOrder3, OfTheIntegralGainLeavesTheRest) {
  Drive after;
  after.integral *= 1.5;
  expect_same(changed({}, 3, "integral_gain", 0.5), after.model(3));
}

TEST(Gains, AreThoseOfTheDriveWhicheverOfThemIsLarger) {
  for (const double integral : {25.0, 300.0}) {
    Drive drive;
    drive.integral = integral;
    const Gains gains = gains_of(drive.model(3).loop);
    EXPECT_NEAR(gains.position, 80.0, 1e-9);
    EXPECT_NEAR(gains.integral, integral, 1e-9);
  }
}

TEST(AnAddition, TakesThePlaceOfWhatItReplacesAndKeepsItsLevel) {
  const Model before = Drive{}.model(2);
  Model after = before;
  const Change change = addition_to(before, kind_of<Presliding>(), {1e-5, 1.0});
  std::vector<double> start;
  for (const ChangedQuantity& quantity : change.quantities) start.push_back(quantity.start);
  change.apply(after, start);
  ASSERT_EQ(after.effects.size(), 1u);
  EXPECT_EQ(after.effects[0].kind, kind_of<Presliding>());
  EXPECT_DOUBLE_EQ(after.effects[0].coefficient[0], before.effects[0].coefficient[0]);
}

TEST(Changes, OfAModelWithoutFrictionOfferToAddIt) {
  Model model = Drive{}.model(2);
  model.effects.clear();
  const double level = 0.3;
  for (const Change& change : changes_of(model)) {
    if (change.quantities.front().name != "coulomb") continue;
    change.apply(model, {&level, 1});
  }
  ASSERT_EQ(model.effects.size(), 1u);
  EXPECT_EQ(model.effects[0].kind, kind_of<CoulombFriction>());
  EXPECT_DOUBLE_EQ(model.effects[0].coefficient[0], 0.3);
}

}  // namespace
}  // namespace servotwin
