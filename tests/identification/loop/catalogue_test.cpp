// For every effect of the catalogue the simulation and the regressors must agree.

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "identification/least_squares/unit_columns.h"
#include "identification/loop/projection.h"
#include "twin/twin.h"
#include "twin/two_pi.h"

namespace servotwin {
namespace {

class EveryEffect : public ::testing::TestWithParam<std::tuple<std::size_t, int>> {
 protected:
  static Effect random_effect(std::size_t kind, std::mt19937_64& rng) {
    std::uniform_real_distribution<double> part(0.1, 0.9);
    Effect effect;
    effect.kind = kind;
    std::size_t i = 0;
    for (const Parameter& p : shapes_of(kind)) {
      effect.shape[i] = p.lower > 0.0 ? p.lower * std::pow(p.upper / p.lower, part(rng))
                                      : p.lower + part(rng) * 0.5 * (p.upper - p.lower);
      // Times at which the axis moves, accelerations that occur, and periods that it passes.
      if (p.unit == "s" && p.upper > 1e6) effect.shape[i] = 2.5 * part(rng);
      if (p.unit == "m/s^2") effect.shape[i] = 0.1 * part(rng);
      if (p.name == "period") effect.shape[i] = 0.02 * part(rng);
      // A table over the range of the regressor that occurs.
      if (p.name == "low") effect.shape[i] = -0.02 * part(rng);
      if (p.name == "high") effect.shape[i] = 0.02 * part(rng);
      ++i;
    }
    i = 0;
    // Large enough to change the error, small enough that friction does not hold the axis.
    for (const Parameter& p : coefficients_of(kind))
      effect.coefficient[i++] =
          std::max(p.lower, (p.unit == "m" ? 5e-7 : std::min(p.upper, 0.3)) * part(rng));
    return effect;
  }
};

TEST_P(EveryEffect, StepAndColumnsAgreeAlongTheSameMotion) {
  const auto [kind, order] = GetParam();
  std::mt19937_64 rng{20 + kind};
  for (int round = 0; round < 5; ++round) {
    const double h = 1e-3;
    Model model;
    model.sample_time_s = h;
    model.loop.order = order;
    model.loop.denominator = denominator_of({8.0 * kTwoPi, 25.0 * kTwoPi, 0.5}, order);
    model.loop.numerator = {0.9, 0.8 * model.loop.denominator[0],
                            order == 3 ? 0.6 * model.loop.denominator[1] : 0.0};
    model.effects = {random_effect(kind, rng)};

    Segment segment;
    segment.sample_time_s = h;
    segment.command.resize(3000);
    for (Eigen::Index k = 0; k < 3000; ++k) {
      const double t = std::max(0.0, h * static_cast<double>(k) - 0.05);  // from rest
      segment.command(k) =
          0.02 * std::pow(std::sin(kTwoPi * (0.6 + 0.2 * round) * t), 3) * std::min(1.0, t);
    }
    // The twin steps along the command (delayed if the model has a delay) ...
    Signals signals;
    signals.h = h;
    signals.command = Spline::through(segment.command, h);
    const Eigen::ArrayXd delayed = signals.command.delayed(model.command_delay_s());
    const Spline motion = Spline::through(delayed, h);
    Twin twin(model);
    twin.start(delayed(0));
    signals.position = Eigen::ArrayXd::Constant(3000, twin.loop_position());
    Eigen::ArrayXd reading = Eigen::ArrayXd::Constant(3000, twin.position());
    segment.neighbour = 0.5 * segment.command.square();
    segment.neighbour_motion = 0.7 * segment.neighbour;
    segment.in_cut = (segment.command > 0.0).cast<double>();
    signals.in_cut = segment.in_cut;
    signals.neighbour_acceleration = Spline::through(segment.neighbour, h).second;
    signals.neighbour_motion_acceleration = Spline::through(segment.neighbour_motion, h).second;
    signals.velocity = Eigen::ArrayXd::Zero(3000);
    signals.acceleration = Eigen::ArrayXd::Zero(3000);
    signals.demand = Eigen::ArrayXd::Constant(3000, twin.demand());
    signals.demand_rate = signals.demand_damping = Eigen::ArrayXd::Zero(3000);
    for (Eigen::Index k = 1; k < 3000; ++k) {
      CommandPiece piece{motion.first(k - 1),
                         motion.second(k - 1),
                         motion.third(k - 1),
                         delayed(k),
                         motion.first(k),
                         motion.second(k),
                         signals.neighbour_acceleration(k),
                         signals.neighbour_motion_acceleration(k),
                         signals.in_cut(k)};
      twin.step(piece);
      signals.position(k) = twin.loop_position();
      reading(k) = twin.position();
      signals.velocity(k) = twin.velocity();
      signals.acceleration(k) = twin.acceleration();
      signals.demand(k) = twin.demand();
      if (order == 3) {
        signals.demand_damping(k) = model.loop.denominator[0] * (motion.first(k) - twin.velocity());
        signals.demand_rate(k) = model.loop.denominator[2] * (delayed(k) - twin.loop_position()) -
                                 model.loop.numerator[2] * motion.first(k);
      }
    }
    const Eigen::ArrayXd error = segment.command - reading;
    signals.error = error;
    EXPECT_LT((error - simulate(model, segment)).abs().maxCoeff(), 1e-12);

    // ... and the regressors of that motion, times the model's coefficients, must be the same
    // error.
    Structure structure{order, {kind}};
    structure.every_coefficient = true;
    const Projection data({signals}, structure, false);
    Point point;
    point.denominator = model.loop.denominator;
    point.shapes.assign(
        model.effects[0].shape.begin(),
        model.effects[0].shape.begin() + static_cast<std::ptrdiff_t>(shapes_of(kind).size()));
    const Eigen::MatrixXd columns = data.regressors(point);
    Eigen::VectorXd linear(columns.cols());
    for (int i = 0; i < order; ++i) linear(i) = model.loop.numerator[static_cast<std::size_t>(i)];
    for (Eigen::Index i = order; i < columns.cols(); ++i)
      linear(i) = model.effects[0].coefficient[static_cast<std::size_t>(i - order)];
    Eigen::ArrayXd expected = (columns * linear).array();
    expected += segment.command - delayed;
    EXPECT_LT((expected - error).abs().maxCoeff(), 1e-12)
        << identity_of(kind).id << ", round " << round;
    // The effect must change the error: without it the error differs.
    Model bare = model;
    bare.effects.clear();
    EXPECT_GT((simulate(bare, segment) - error).abs().maxCoeff(),
              order == 3 && kind == kind_of<ConstantForce>() ? -1.0 : 1e-10);
  }
}

/// The demand along a motion equals that of the twin, up to the integration rule.
TEST(Demand, IsTheTwinsOwnAlongItsMotion) {
  const double h = 1e-3;
  for (const int order : {2, 3}) {
    Model model;
    model.sample_time_s = h;
    model.loop.order = order;
    model.loop.denominator = denominator_of({8.0 * kTwoPi, 25.0 * kTwoPi, 0.5}, order);
    model.loop.numerator = {0.4, 0.3 * model.loop.denominator[0],
                            order == 3 ? 0.2 * model.loop.denominator[1] : 0.0};
    Effect friction = make_effect<CoulombFriction>();
    friction.shape[0] = 1e-3;
    friction.coefficient[0] = 0.4;
    model.effects = {friction};
    Segment segment;
    segment.sample_time_s = h;
    segment.command.resize(3000);
    for (Eigen::Index k = 0; k < 3000; ++k) {
      const double t = std::max(0.0, h * static_cast<double>(k) - 0.05);
      segment.command(k) = 0.02 * std::pow(std::sin(kTwoPi * 0.8 * t), 3) * std::min(1.0, t);
    }
    const Spline motion = Spline::through(segment.command, h);
    Twin twin(model);
    twin.start(segment.command(0));
    Eigen::ArrayXd position = Eigen::ArrayXd::Constant(3000, twin.position()),
                   velocity = Eigen::ArrayXd::Zero(3000),
                   demand = Eigen::ArrayXd::Constant(3000, twin.demand());
    for (Eigen::Index k = 1; k < 3000; ++k) {
      twin.step({motion.first(k - 1), motion.second(k - 1), motion.third(k - 1), segment.command(k),
                 motion.first(k), motion.second(k)});
      position(k) = twin.position();
      velocity(k) = twin.velocity();
      demand(k) = twin.demand();
    }
    segment.actual = position;
    Signals signals = signals_of(segment);
    signals.velocity = velocity;
    add_drive(model, signals);
    const Eigen::ArrayXd along = signals.demand;
    EXPECT_LT((along - demand).abs().maxCoeff(), order == 2 ? 1e-9 : 1e-3 * demand.abs().maxCoeff())
        << "order " << order;
  }
}

TEST_P(EveryEffect, DerivativesByShapeAgreeWithDifferences) {
  const std::size_t kind = std::get<0>(GetParam());
  std::mt19937_64 rng{77 + kind};
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  const auto shape_count = shapes_of(kind).size();
  const auto coefficient_count = coefficients_of(kind).size();
  for (int round = 0; round < 200; ++round) {
    const Effect effect = random_effect(kind, rng);
    // A short random motion, for effects with memory.
    std::vector<Motion> motion(12);
    for (Motion& m : motion) {
      m.step_s = 1e-3;
      m.velocity = 0.03 * std::pow(uniform(rng), 5);
      m.position = 0.1 * uniform(rng);
      m.displacement = m.velocity * m.step_s;
      m.command_velocity = 0.03 * uniform(rng);
      m.acceleration = 10.0 * uniform(rng);
      m.command_acceleration = 10.0 * uniform(rng);
      m.tracking_error = 1e-4 * uniform(rng);
      m.neighbour_acceleration = uniform(rng);
      m.neighbour_motion_acceleration = uniform(rng);
      m.demand = 0.2 * uniform(rng);
      m.demand_rate = uniform(rng);
      m.demand_damping = 0.01 * uniform(rng);
      m.time_s = 0.5 + 0.4 * uniform(rng);
    }
    const UnitColumns columns = unit_columns(kind, effect.shape.data(), motion, true);
    const auto last = static_cast<Eigen::Index>(motion.size()) - 1;
    for (std::size_t p = 0; p < shape_count; ++p) {
      const auto at = [&](double factor) {
        auto moved = effect.shape;
        moved[p] *= factor;
        EffectMemory<double> plain;
        start_memory<double>(kind, moved.data(), plain);
        std::array<double, kMaxCoefficients> out{};
        for (const Motion& m : motion)
          unit_forces<double>(kind, moved.data(), plain, m, out.data());
        return out;
      };
      // By the logarithm of the shape: rounding then counts against the force and not the shape.
      const auto up = at(1.0 + 1e-6), down = at(1.0 - 1e-6), here = at(1.0);
      for (std::size_t c = 0; c < coefficient_count; ++c) {
        const auto column = static_cast<Eigen::Index>(c);
        EXPECT_NEAR(columns.force(last, column), here[c], 1e-12 * (1.0 + std::abs(here[c])));
        const double derivative = columns.by_shape[p](last, column) * effect.shape[p];
        // If a force has a corner between the three points, the side without it is compared.
        double difference = (up[c] - down[c]) / 2e-6;
        for (const double side : {(up[c] - here[c]) / 1e-6, (here[c] - down[c]) / 1e-6})
          if (std::abs(side - derivative) < std::abs(difference - derivative)) difference = side;
        EXPECT_NEAR(derivative, difference,
                    2e-5 * (1e-3 + std::abs(difference) + std::abs(here[c])))
            << shapes_of(kind)[p].name;
      }
    }
  }
}

/// Two masses have no columns along a given motion (tests/twin/two_mass_axis_test.cpp).
std::vector<std::size_t> kinds_along_a_motion() {
  std::vector<std::size_t> kinds;
  for (std::size_t kind = 0; kind < kEffectKinds; ++kind) {
    if (!acts_on_axis(kind)) kinds.push_back(kind);
  }
  return kinds;
}

INSTANTIATE_TEST_SUITE_P(Catalogue, EveryEffect,
                         ::testing::Combine(::testing::ValuesIn(kinds_along_a_motion()),
                                            ::testing::Values(2, 3)),
                         [](const auto& test) {
                           return std::string(identity_of(std::get<0>(test.param)).id) + "_order" +
                                  std::to_string(std::get<1>(test.param));
                         });

TEST(Catalogue, IdsAreUniqueAndFound) {
  for (std::size_t kind = 0; kind < kEffectKinds; ++kind) {
    EXPECT_EQ(kind_of(identity_of(kind).id), kind);
    EXPECT_FALSE(identity_of(kind).meaning.empty());
    for (const Parameter& p : shapes_of(kind)) EXPECT_LE(p.lower, p.start);
    for (const Parameter& p : shapes_of(kind)) EXPECT_LT(p.lower, p.upper);
    for (const Parameter& p : coefficients_of(kind)) EXPECT_LT(p.lower, p.upper);
  }
  EXPECT_EQ(kind_of("no_such_effect"), kEffectKinds);
}

}  // namespace
}  // namespace servotwin
