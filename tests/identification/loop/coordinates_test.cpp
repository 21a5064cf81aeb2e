// The coordinates of fits: what they keep while the gains change, what is held, and their
// derivatives.
#include "identification/loop/coordinates.h"

#include <gtest/gtest.h>

#include <cmath>

#include "twin/catalogue.h"

namespace servotwin {
namespace {

Model two_masses() {
  Model out;
  out.sample_time_s = 1e-3;
  out.loop.order = 2;
  out.loop.denominator = {500.0, 20'000.0, 0.0};
  out.loop.numerator = {0.9, 300.0, 0.0};
  Effect friction = make_effect<CoulombFriction>(), axis = make_effect<TwoMassMotorEncoder>(),
         lead = make_effect<LeadError>();
  friction.coefficient[0] = 1.5;
  lead.coefficient[0] = 1e-5;
  axis.shape[TwoMassMotorEncoder::kFrictionShareAt] = 0.5;
  out.effects = {friction, axis, lead};
  return out;
}

Structure structure_of(const Model& model) {
  Structure out;
  out.order = model.loop.order;
  for (const Effect& effect : model.effects) out.effects.push_back(effect.kind);
  return out;
}

// Of e = (c0 s + c1) s / P x_r and d / P, P = s^2 + a1 s + a2, by hand: k0 = c1 / a2,
// k1 = (c0 - a1 k0) / a2.
TEST(Coordinates, KeepTheErrorsWhileTheGainsChange) {
  const Model start = two_masses();
  const Structure structure = structure_of(start);
  const Coordinates coordinates(structure, start, 1.0);
  Eigen::VectorXd x = coordinates.of(start);
  const Model same = coordinates.model(x.data());
  for (std::size_t i = 0; i < 2; ++i) {
    EXPECT_NEAR(same.loop.denominator[i], start.loop.denominator[i], 1e-9 * 20'000.0);
    EXPECT_NEAR(same.loop.numerator[i], start.loop.numerator[i], 1e-9 * 300.0);
  }
  Eigen::Index poles = x.size() - 2;  // before the shapes
  for (const Effect& effect : start.effects) poles -= std::ssize(shapes_of(effect.kind));
  x(poles) += 0.3;
  x(poles + 1) += 0.2;
  const Model other = coordinates.model(x.data());
  const auto &a = start.loop.denominator, &c = start.loop.numerator, &b = other.loop.denominator,
             &d = other.loop.numerator;
  ASSERT_GT(std::abs(b[1] / a[1] - 1.0), 0.1);
  EXPECT_NEAR(d[1] / b[1], c[1] / a[1], 1e-12);
  EXPECT_NEAR((d[0] - b[0] * d[1] / b[1]) / b[1], (c[0] - a[0] * c[1] / a[1]) / a[1], 1e-12);
  EXPECT_NEAR(other.effects[0].coefficient[0] / b[1], 1.5 / a[1], 1e-12);
  EXPECT_EQ(other.effects[2].coefficient[0], 1e-5) << "a displacement of the reading";
}

TEST(Coordinates, OfAnIntegratingLoopAsWell) {
  Model start;
  start.sample_time_s = 1e-3;
  start.loop.order = 3;
  start.loop.denominator = {200.0, 15'000.0, 400'000.0};
  start.loop.numerator = {0.6, 90.0, 2000.0};
  const Structure structure = structure_of(start);
  const Coordinates coordinates(structure, start, 1.0);
  Eigen::VectorXd x = coordinates.of(start);
  x.tail(3).array() += 0.1;
  const Loop& loop = coordinates.model(x.data()).loop;
  // The series of the numerator over the denominator, by division.
  const auto series = [](const Loop& l) {
    const auto &n = l.numerator, &p = l.denominator;
    const double k0 = n[2] / p[2], k1 = (n[1] - p[1] * k0) / p[2],
                 k2 = (n[0] - p[0] * k0 - p[1] * k1) / p[2];
    return Eigen::Vector3d(k0, k1, k2);
  };
  const Eigen::Vector3d is = series(loop), was = series(start.loop);
  for (Eigen::Index i = 0; i < 3; ++i) EXPECT_NEAR(is(i), was(i), 1e-9 * std::abs(was(i)));
}

TEST(Coordinates, AHeldDriveLeavesTheFrictionAlone) {
  const Model start = two_masses();
  const Structure structure = structure_of(start);
  const Coordinates coordinates(structure, start, 1.0, {.effects = {2}, .drive = true});
  Eigen::VectorXd x = coordinates.of(start);
  const auto free = coordinates.free();
  EXPECT_EQ(free.size(), 1 + shapes_of(start.effects[0].kind).size() + 1)
      << "level and shapes of the friction, its share on the load";
  x.array() += 0.01;
  const Model other = coordinates.model(x.data());
  EXPECT_EQ(other.loop.denominator, start.loop.denominator);
  EXPECT_EQ(other.loop.numerator, start.loop.numerator);
  EXPECT_EQ(other.effects[2].coefficient, start.effects[2].coefficient);
  for (const std::size_t place : {0, 1, 2})
    EXPECT_EQ(other.effects[1].shape[place], start.effects[1].shape[place]);
  EXPECT_NE(other.effects[1].shape[TwoMassMotorEncoder::kFrictionShareAt],
            start.effects[1].shape[TwoMassMotorEncoder::kFrictionShareAt]);
  EXPECT_NE(other.effects[0].coefficient[0], 1.5);
}

Model integrating() {
  Model out;
  out.sample_time_s = 1e-3;
  out.loop.order = 3;
  out.loop.denominator = {200.0, 15'000.0, 400'000.0};
  out.loop.numerator = {0.6, 90.0, 0.0};
  Effect friction = make_effect<Presliding>(), added = make_effect<AddedFriction>();
  friction.coefficient[0] = 0.3;
  added.coefficient[0] = 0.05, added.coefficient[1] = 2.0;
  out.effects = {friction, added};
  return out;
}

class Directions : public testing::TestWithParam<std::pair<Model, bool>> {};

TEST_P(Directions, AreTheDerivativesOfTheModel) {
  const auto& [start, matched] = GetParam();
  Structure structure = structure_of(start);
  structure.matched_feedforward = matched;
  const auto order = static_cast<std::size_t>(start.loop.order);
  const Coordinates coordinates(structure, start, 1.0);
  const Eigen::VectorXd x = coordinates.of(start);
  const std::vector<Model> along = coordinates.directions(x.data());
  ASSERT_EQ(std::ssize(along), x.size());
  for (Eigen::Index i = 0; i < x.size(); ++i) {
    const double step = 1e-6 * std::max(1e-6, std::abs(x(i)));
    Eigen::VectorXd up = x, down = x;
    up(i) += step, down(i) -= step;
    const Model high = coordinates.model(up.data()), low = coordinates.model(down.data());
    const Model& d = along[static_cast<std::size_t>(i)];
    const auto expect = [&](double by, double above, double below) {
      EXPECT_NEAR(by, (above - below) / (2.0 * step),
                  1e-5 * std::abs(by) + 1e-7 * (std::abs(above) + 1e-9) / step)
          << "coordinate " << i;
    };
    for (std::size_t j = 0; j < order; ++j) {
      expect(d.loop.denominator[j], high.loop.denominator[j], low.loop.denominator[j]);
      expect(d.loop.numerator[j], high.loop.numerator[j], low.loop.numerator[j]);
    }
    if (matched) {
      EXPECT_EQ(high.loop.numerator[order - 1], 0.0);
    }
    for (std::size_t e = 0; e < start.effects.size(); ++e) {
      for (std::size_t c = 0; c < coefficients_of(start.effects[e].kind).size(); ++c)
        expect(d.effects[e].coefficient[c], high.effects[e].coefficient[c],
               low.effects[e].coefficient[c]);
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Coordinates, Directions,
                         testing::Values(std::pair{two_masses(), false},
                                         std::pair{integrating(), false},
                                         std::pair{integrating(), true}));

// A share of the mass has bounds of its own, whatever the gain is.
TEST(Coordinates, AShareStaysWhileTheGainChanges) {
  Model start = two_masses();
  start.effects[1] = make_effect<BacklashBehindEncoder>();
  start.effects[1].coefficient[1] = 1.0;  // the most there is
  const Structure structure = structure_of(start);
  const Coordinates coordinates(structure, start, 1.0);
  Eigen::VectorXd x = coordinates.of(start);
  Eigen::Index poles = x.size() - 2;
  for (const Effect& effect : start.effects) poles -= std::ssize(shapes_of(effect.kind));
  x(poles) -= 0.7, x(poles + 1) -= 0.7;
  EXPECT_EQ(coordinates.model(x.data()).effects[1].coefficient[1], 1.0);
}

}  // namespace
}  // namespace servotwin
