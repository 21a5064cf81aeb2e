// The derivatives of a simulation against differences of whole simulations, for every effect of the
// catalogue, both orders, modes of vibration, a delay and two masses.

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "twin/twin.h"
#include "twin/two_pi.h"

namespace servotwin {
namespace {

// Relative change of a parameter for a difference: its truncation and its rounding are both far
// below kRelativeTolerance.
constexpr double kStep = 1e-6;
/// Norm of the difference of both over that of the derivative, and what the tolerance of the force
/// balance leaves in a difference for every part in which a cycle is solved [m].
constexpr double kRelativeTolerance = 5e-5, kNoise_m = 4e-10, kNoise_mps2 = 4e-6, kNoise_mps = 4e-8;

Loop loop_of(int order) {
  const double kv = 200.0, kp = 40.0, reset = 30.0;
  Loop loop;
  loop.order = order;
  if (order == 3) {
    loop.denominator = {kv, kv * (kp + reset), kv * kp * reset};
    loop.numerator = {0.7, kv * 0.5, kv * reset * 0.5};
  } else {
    loop.denominator = {kv, kv * kp, 0.0};
    loop.numerator = {0.7, kv * 0.5, 0.0};
  }
  return loop;
}

Effect coulomb() {
  Effect friction = make_effect<CoulombFriction>();
  friction.shape[0] = 2e-3;
  friction.coefficient[0] = 0.5;
  return friction;
}

/// Values at which nothing happens at the very moment of a sample or at rest.
Effect effect_of(std::size_t kind) {
  Effect out;
  out.kind = kind;
  std::size_t i = 0;
  for (const Parameter& p : shapes_of(kind)) {
    out.shape[i] = 1.0037 * p.start;
    if (p.name == "low") out.shape[i] = -0.031;
    if (p.name == "high") out.shape[i] = 0.047;
    if (p.name == "limit_mps2") out.shape[i] = 1.9;
    if (p.name == "weight_1") out.shape[i] = 500.0;
    if (p.name == "delay_s") out.shape[i] = 2.3e-3;
    if (p.name == "friction_share") out.shape[i] = 0.6;
    if (acts_on_axis(kind) && p.name == "frequency_hz") out.shape[i] = 150.0;
    if (acts_on_axis(kind) && p.name == "damping_ratio") out.shape[i] = 0.3;
    if (p.name == "load_share") out.shape[i] = 0.2;
    ++i;
  }
  i = 0;
  for (const Parameter& p : coefficients_of(kind)) {
    double value = p.start != 0.0 ? p.start : 0.05;
    if (p.unit == "m") value = kind == kind_of<EncoderError>() ? 1e-6 : 2e-5;
    if (p.name == "growth" && p.unit == "1") value = 1e-4;
    if (kind == kind_of<LeadError>() && p.name == "slope") value = 1e-4;
    if (limits_motor(kind)) value = 0.3;
    out.coefficient[i++] = value;
  }
  return out;
}

/// 1.5 s of motion; `moving`: from within it, with an encoder that the starting state is found
/// from.
Segment segment_for(const Model& model, bool moving) {
  Segment s;
  s.start_s = 0.3;
  s.sample_time_s = model.sample_time_s;
  const auto n = static_cast<Eigen::Index>(1.5 / s.sample_time_s);
  s.command.resize(n);
  s.neighbour.resize(n);
  s.in_cut.resize(n);
  for (Eigen::Index k = 0; k < n; ++k) {
    const double t = static_cast<double>(k) * s.sample_time_s + (moving ? 0.37 : 0.0);
    const double slow = std::sin(kTwoPi * 0.9 * t), fast = std::sin(kTwoPi * 2.07 * t);
    s.command(k) = 0.02 * slow * slow * slow + 0.003 * fast * fast * fast;
    s.neighbour(k) = 0.01 * std::pow(std::sin(kTwoPi * 1.53 * t), 3);
    s.in_cut(k) = k > n / 3 ? 1.0 : 0.0;
  }
  if (moving) {
    s.actual = s.command - simulate(model, s);
    for (Eigen::Index k = 0; k < n; ++k)
      s.actual(k) += 2e-6 * std::sin(0.9 * static_cast<double>(k)) +
                     1e-5 * std::sin(0.1 * static_cast<double>(k));
  }
  return s;
}

struct Direction {
  std::string name;
  Model along;
};

/// One for every parameter that is not 0, of its own size.
std::vector<Direction> directions_of(const Model& model) {
  std::vector<Direction> out;
  std::size_t count = 0;
  Model same = model;
  each_parameter(same, model, [&](double, double) { ++count; });
  for (std::size_t i = 0; i < count; ++i) {
    Model along = empty_like<double>(model);
    std::size_t at = 0;
    double size = 0.0;
    each_parameter(along, model, [&](double& by, double value) {
      if (at++ == i) by = size = value;
    });
    if (size != 0.0) out.push_back({"parameter " + std::to_string(i), std::move(along)});
  }
  return out;
}

Eigen::ArrayXd difference(const Model& model, const Model& along, const Segment& segment,
                          Outputs outputs = {}) {
  const auto at = [&](double share) {
    Model moved = model;
    each_parameter(moved, along, [share](double& x, double by) { x += share * by; });
    return simulate(moved, segment, outputs);
  };
  return (at(kStep) - at(-kStep)) / (2.0 * kStep);
}

/// Force and velocity have no derivative where friction has a corner; a difference over a sample
/// that crosses one is something else. Motion is smooth there.
Eigen::VectorXd without_corners(Eigen::VectorXd off) {
  constexpr std::ptrdiff_t kMostCorners = 4;
  std::sort(off.begin(), off.end(), [](double l, double r) { return std::abs(l) > std::abs(r); });
  return off.tail(off.size() - kMostCorners);
}

void expect_derivatives(const Model& model, const std::string& what) {
  ASSERT_EQ(why_invalid(model), "") << what;
  for (const bool moving : {false, true}) {
    const Segment segment = segment_for(model, moving);
    const std::vector<Direction> all = directions_of(model);
    std::vector<Model> directions;
    for (const Direction& one : all) directions.push_back(one.along);
    constexpr Outputs kAll{.motor = true, .torque = true};
    const Simulated out = simulate(model, directions, segment, kAll);
    EXPECT_TRUE((out.error == simulate(model, segment, kAll)).all()) << what;
    const auto of = [&](Eigen::Index output) {
      return Eigen::seqN(output, segment.size(), kAll.per_sample());
    };
    EXPECT_TRUE((out.error(of(0)) == simulate(model, segment)).all()) << what;
    for (std::size_t i = 0; i < all.size(); ++i) {
      const Eigen::VectorXd by = out.by.col(static_cast<Eigen::Index>(i)),
                            apart = by - difference(model, all[i].along, segment, kAll).matrix();
      for (Eigen::Index output = 0; output < kAll.per_sample(); ++output) {
        const bool is_error = output < kAll.torque_at();
        const double noise =
            Twin(model).step_constants().parts * (is_error                     ? kNoise_m
                                                  : output == kAll.torque_at() ? kNoise_mps2
                                                                               : kNoise_mps);
        const Eigen::VectorXd off = apart(of(output));
        EXPECT_LT(is_error ? off.norm() : without_corners(off).norm(),
                  kRelativeTolerance * by(of(output)).norm() + noise)
            << what << ", " << all[i].name << ", output " << output
            << (moving ? ", from within a motion" : ", from rest");
      }
    }
  }
}

class DerivativesOf : public testing::TestWithParam<std::size_t> {};

TEST_P(DerivativesOf, TheEffectAreThoseOfDifferences) {
  for (const int order : {2, 3}) {
    Model model;
    model.sample_time_s = 1e-3;
    model.loop = loop_of(order);
    const Effect effect = effect_of(GetParam());
    if (!is_friction_law(effect.kind)) model.effects.push_back(coulomb());
    model.effects.push_back(effect);
    expect_derivatives(model, "order " + std::to_string(order));
  }
}

INSTANTIATE_TEST_SUITE_P(Catalogue, DerivativesOf, testing::Range(std::size_t{0}, kEffectKinds),
                         [](const auto& test) { return std::string(identity_of(test.param).id); });

TEST(Derivatives, OfStandingAndMovingModesAreThoseOfDifferences) {
  for (const int order : {2, 3}) {
    for (const bool moves : {false, true}) {
      Model model;
      model.sample_time_s = 1e-3;
      model.loop = loop_of(order);
      model.loop.travel = {-0.05, 0.05};
      model.loop.modes = {{kTwoPi * 41.0, 0.04, 2e-3, 0.7, 1e-4, 0.2},
                          {kTwoPi * 93.0, 0.03, 1e-3, 0.3, 2e-5, 0.1}};
      if (moves) {
        for (Mode& mode : model.loop.modes)
          mode.slope = 0.2, mode.curve = 0.1, mode.zeta_slope = 0.1;
      }
      model.effects = {coulomb(), effect_of(kind_of<TimeDelay>())};
      expect_derivatives(model, "order " + std::to_string(order) + (moves ? ", moving" : ""));
    }
  }
}

TEST(Derivatives, OfCyclesInPartsAreThoseOfDifferences) {
  Model model;
  model.sample_time_s = 4e-3;
  model.loop = loop_of(3);
  model.effects = {effect_of(kind_of<Presliding>()), effect_of(kind_of<TimeDelay>())};
  expect_derivatives(model, "4 ms");
}

// The spline of a command that begins to move shakes the load within its gap by 1e-16 m before.
TEST(Derivatives, OfPlayAreThoseOfDifferencesAfterARest) {
  for (const std::size_t kind :
       {kind_of<PlayMotorEncoder>(), kind_of<PlayLoadEncoder>(), kind_of<PlayOutside>()}) {
    Model model;
    model.sample_time_s = 1e-3;
    model.loop = loop_of(3);
    model.effects = {coulomb(), effect_of(kind)};
    Segment segment = segment_for(model, false);
    const Eigen::Index rest = 300;
    segment.command.tail(segment.size() - rest) =
        segment.command.head(segment.size() - rest).eval();
    segment.command.head(rest) = segment.command(0);
    for (const Direction& one : directions_of(model)) {
      const Simulated out = simulate(model, std::vector<Model>{one.along}, segment);
      const Eigen::ArrayXd by = out.by.col(0).array();
      const double apart = (by - difference(model, one.along, segment)).matrix().norm();
      EXPECT_LT(apart, kRelativeTolerance * by.matrix().norm() +
                           kNoise_m * Twin(model).step_constants().parts)
          << identity_of(kind).id << one.name;
    }
  }
}

TEST(Derivatives, OfMoreParametersThanOnePassHas) {
  Model model;
  model.sample_time_s = 1e-3;
  model.loop = loop_of(3);
  model.effects = {effect_of(kind_of<Gms>()), effect_of(kind_of<Cogging>()),
                   effect_of(kind_of<AsymmetricFriction>())};
  ASSERT_GT(directions_of(model).size(), 2 * kParametersPerPass - 6);
  expect_derivatives(model, "many");
}

}  // namespace
}  // namespace servotwin
