// The body and its friction against closed forms and invariants.
#include "tests/virtual_machine/body.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <stdexcept>
#include <string>
#include <vector>

namespace servotwin::virtual_machine {
namespace {

constexpr double kMass = 200.0;

StickCoulomb constant_coulomb(double level) {
  return {.level = {.coulomb = level, .breakaway = level}};
}

Gms two_elements() {
  return {.level = {.coulomb = 100.0, .breakaway = 100.0},
          .stiffness = {2e7, 4e6},
          .share = {0.7, 0.3}};
}

LuGre bristles() {
  return {
      .level = {.coulomb = 120.0, .breakaway = 150.0, .stribeck_velocity = 0.005, .exponent = 2.0},
      .sigma0 = 1e7,
      .sigma1 = 1e4,
      .sigma2 = 300.0};
}

DirectedStribeck directed() {
  return {
      .plus = {.coulomb = 60.0, .breakaway = 100.0, .stribeck_velocity = 0.006, .exponent = 1.3},
      .minus = {.coulomb = 40.0, .breakaway = 70.0, .stribeck_velocity = 0.008, .exponent = 1.3},
      .viscous_plus = 500.0,
      .viscous_minus = 900.0};
}

/// A part of a bristle friction.
LuGre share_of(const LuGre& whole, double share) {
  LuGre part = whole;
  for (double* value :
       {&part.level.coulomb, &part.level.breakaway, &part.sigma0, &part.sigma1, &part.sigma2}) {
    *value *= share;
  }
  return part;
}

double coasting_distance(const BodyParameters& p, double velocity, double step) {
  Body body(p, 0.0, velocity);
  double furthest = 0.0;
  for (double t = 0.0; t < 1.0; t += step) {
    body.advance(0.0, step);
    furthest = std::max(furthest, body.state().position);
  }
  return furthest;
}

TEST(Body, CoastsToRestUnderCoulombFrictionWhereTheClosedFormSays) {
  const BodyParameters p{.mass = kMass, .viscous = 500.0, .friction = constant_coulomb(90.0)};
  const double v = 0.2;
  const double time_constant = kMass / 500.0;
  const double logarithm = std::log(1.0 + 500.0 * v / 90.0);
  const double distance = time_constant * (v - 90.0 / 500.0 * logarithm);
  for (const double step : {1e-5, 1e-3}) {
    SCOPED_TRACE(step);
    EXPECT_NEAR(coasting_distance(p, v, step), distance, 1e-11);
    EXPECT_NEAR(coasting_distance(p, -v, step), 0.0, 0.0);
  }
  // It stops at its time, within the step that holds it, and then does not move at all.
  const double stop = time_constant * logarithm;
  Body body(p, 0.0, v);
  for (int i = 0; i < 1000; ++i) body.advance(0.0, (stop - 1e-6) / 1000.0);
  EXPECT_GT(body.state().velocity, 0.0);
  EXPECT_LT(body.state().velocity, 1e-6);
  body.advance(0.0, 2e-6);
  EXPECT_EQ(body.state().velocity, 0.0);
  const double rest = body.state().position;
  for (int i = 0; i < 1000; ++i) body.advance(i % 2 == 0 ? 89.0 : -89.0, 1e-4);
  EXPECT_EQ(body.state().position, rest);
  EXPECT_EQ(body.friction_force(89.0), 89.0);
}

TEST(Body, BreaksAwayAboveTheBreakawayForceOnly) {
  const StickCoulomb friction{
      .level = {.coulomb = 60.0, .breakaway = 100.0, .stribeck_velocity = 1e-6, .exponent = 1.0}};
  const BodyParameters p{.mass = kMass, .constant_force = 20.0, .friction = friction};
  Body body(p);
  for (int i = 0; i < 100; ++i) body.advance(120.0, 1e-3);
  for (int i = 0; i < 100; ++i) body.advance(-80.0, 1e-3);
  EXPECT_EQ(body.state().position, 0.0);
  for (int i = 0; i < 1000; ++i) body.advance(120.1, 1e-5);
  // Almost at once the level has fallen to 60 N: x = (u - F0 - Fc) t^2 / 2m.
  EXPECT_NEAR(body.state().position, 40.1 * 1e-4 / (2.0 * kMass),
              0.02 * 40.1 * 1e-4 / (2.0 * kMass));
  Body other(p);
  for (int i = 0; i < 1000; ++i) other.advance(-80.1, 1e-5);
  EXPECT_LT(other.state().position, -1e-6);
}

TEST(Body, SaturatedCoulombIsViscousBelowItsVelocityLimit) {
  const BodyParameters p{.mass = kMass,
                         .friction = SaturatedCoulomb{.coulomb = 80.0, .velocity_limit = 0.01}};
  Body body(p, 0.0, 0.008);
  for (int i = 0; i < 100; ++i) body.advance(0.0, 1e-4);
  EXPECT_NEAR(body.state().velocity, 0.008 * std::exp(-80.0 / 0.01 / kMass * 0.01), 1e-12);
  Body fast(p, 0.0, 0.5);
  for (int i = 0; i < 100; ++i) fast.advance(0.0, 1e-4);
  EXPECT_NEAR(fast.state().velocity, 0.5 - 80.0 / kMass * 0.01, 1e-12);
}

TEST(Body, SaturatedCoulombStopsWhereTheClosedFormSays) {
  // Constant deceleration down to the limit, then the velocity falls with m v_limit / Fc.
  const double fc = 80.0;
  const double limit = 0.01;
  const BodyParameters p{.mass = kMass,
                         .friction = SaturatedCoulomb{.coulomb = fc, .velocity_limit = limit}};
  const double distance = kMass * (0.04 - limit * limit) / (2.0 * fc) + kMass * limit / fc * limit;
  EXPECT_NEAR(coasting_distance(p, 0.2, 1e-4), distance, 1e-10);
}

TEST(Body, GmsElementsSwingElasticallyBelowTheirLevel) {
  const BodyParameters p{.mass = kMass, .friction = two_elements()};
  const double w = std::sqrt(2.4e7 / kMass);
  const double v = 0.9 * 70.0 / 2e7 * w;  // the stiffer element yields first
  Body body(p, 0.0, v);
  for (int i = 1; i <= 5000; ++i) {
    body.advance(0.0, 1e-5);
    ASSERT_NEAR(body.state().position, v / w * std::sin(w * i * 1e-5), 1e-7 * v / w);
  }
}

TEST(Body, GmsCoastsToWhereItsVirginCurveHasTakenUpTheEnergy) {
  const BodyParameters p{.mass = kMass, .friction = two_elements()};
  const double v = 0.1;
  // m v^2 / 2 = sum_i L_i^2 / 2 k_i + L_i (x - L_i / k_i), all elements having yielded.
  const double energy = 0.5 * kMass * v * v;
  const double bends = 0.5 * (70.0 * 70.0 / 2e7 + 30.0 * 30.0 / 4e6);
  EXPECT_NEAR(coasting_distance(p, v, 1e-6), (energy + bends) / 100.0, 1e-10);
  EXPECT_NEAR(coasting_distance(p, v, 1e-5), (energy + bends) / 100.0, 1e-9);
}

TEST(Body, GmsDissipatesTheAreaOfItsLoop) {
  // A cycle of peak-to-peak 2 A dissipates 4 L_i (A - L_i / k_i) in every element that yields.
  const BodyParameters p{.mass = kMass, .friction = two_elements()};
  Body body(p);
  const double step = 1e-5;
  const int steps = 20000;  // per period of 0.2 s
  double work = 0.0;
  double low = 0.0;
  double high = 0.0;
  for (int cycle = 0; cycle < 30; ++cycle) {
    work = 0.0;
    low = high = body.state().position;
    for (int i = 0; i < steps; ++i) {
      const double u = 250.0 * std::sin(2.0 * std::numbers::pi * (i + 0.5) / steps);
      const double from = body.state().position;
      body.advance(u, step);
      work += u * (body.state().position - from);
      low = std::min(low, body.state().position);
      high = std::max(high, body.state().position);
    }
  }
  const double amplitude = 0.5 * (high - low);
  ASSERT_GT(amplitude, 20e-6);
  EXPECT_NEAR(work, 4.0 * 70.0 * (amplitude - 70.0 / 2e7) + 4.0 * 30.0 * (amplitude - 30.0 / 4e6),
              1e-5 * work);
}

TEST(Body, FrictionOnlyEverDissipates) {
  // Work done by the motor, less kinetic and stored energy, never falls.
  const auto stored = [](const Friction& friction, const FrictionState& s) {
    if (const auto* gms = std::get_if<Gms>(&friction)) {
      double energy = 0.0;
      for (std::size_t i = 0; i < gms->stiffness.size(); ++i)
        energy += 0.5 * s.z[i] * s.z[i] / gms->stiffness[i];
      return energy;
    }
    if (const auto* lugre = std::get_if<LuGre>(&friction))
      return 0.5 * lugre->sigma0 * s.z[0] * s.z[0];
    if (const auto* both = std::get_if<CoveredLuGre>(&friction))
      return 0.5 * (both->drive.sigma0 * s.z[0] * s.z[0] + both->cover.sigma0 * s.z[1] * s.z[1]);
    return 0.0;
  };
  LuGre lugre = bristles();
  lugre.sigma1 = 0.0;
  const std::vector<Friction> models = {
      SaturatedCoulomb{100.0, 1e-3},
      constant_coulomb(100.0),
      directed(),
      two_elements(),
      gms_with_curve(100.0, 20e-6, 4.0, 8),
      lugre,
      CoveredLuGre{share_of(lugre, 0.6), share_of(lugre, 0.4), 1.5}};
  for (const Friction& friction : models) {
    SCOPED_TRACE("model " + std::to_string(friction.index()));
    Body body({.mass = kMass, .friction = friction});
    double work = 0.0;
    double dissipated = 0.0;
    for (int i = 0; i < 100000; ++i) {
      const double t = i * 1e-5;
      const double u = 150.0 * std::sin(31.0 * t) + 90.0 * std::sin(173.0 * t);
      const double from = body.state().position;
      body.advance(u, 1e-5);
      work += u * (body.state().position - from);
      const double v = body.state().velocity;
      const double now = work - 0.5 * kMass * v * v - stored(friction, body.state().friction);
      ASSERT_GE(now, dissipated - 1e-12) << "at " << t << " s";
      dissipated = now;
    }
    EXPECT_GT(dissipated, 0.01);
  }
}

TEST(Body, LuGreSlidesSteadilyAtItsStribeckCurve) {
  const LuGre friction = bristles();
  for (const double v : {0.001, 0.01, 0.2, -0.003}) {
    const double wanted = std::copysign(120.0 + 30.0 * std::exp(-v * v / 25e-6), v) + 300.0 * v;
    // A heavy body keeps its velocity while the bristle settles.
    Body body({.mass = 1e9, .friction = friction}, 0.0, v);
    for (int i = 0; i < 20000; ++i) body.advance(0.0, 1e-5);
    EXPECT_NEAR(body.friction_force(0.0), wanted, 1e-5 * std::abs(wanted)) << v;
  }
}

TEST(Body, LuGreIsASpringBeforeItSlides) {
  Body body({.mass = kMass, .friction = bristles()});
  for (int i = 0; i < 100000; ++i) body.advance(0.05, 1e-5);
  // It slides, too, but only by about the share of 0.05 N in the breakaway force.
  EXPECT_NEAR(body.state().position, 0.05 / 1e7, 5e-3 * 0.05 / 1e7);
}

TEST(Body, DirectedStribeckSlidesAtTheCurveOfItsDirection) {
  for (const double v : {0.0005, 0.01, 0.3, -0.0005, -0.01, -0.3}) {
    const double wanted = v > 0.0
                              ? 60.0 + 40.0 * std::exp(-std::pow(v / 0.006, 1.3)) + 500.0 * v
                              : -(40.0 + 30.0 * std::exp(-std::pow(-v / 0.008, 1.3))) + 900.0 * v;
    Body body({.mass = 1e9, .friction = directed()}, 0.0, v);
    body.advance(0.0, 1e-5);
    EXPECT_NEAR(body.friction_force(0.0), wanted, 1e-6) << v;
  }
}

TEST(Body, DirectedStribeckBreaksAwayAtTheForceOfItsDirection) {
  Body body({.mass = kMass, .friction = directed()});
  for (const double u : {99.9, -69.9, 75.0}) {
    for (int i = 0; i < 100; ++i) body.advance(u, 1e-3);
    EXPECT_EQ(body.state().position, 0.0);
    EXPECT_EQ(body.friction_force(u), u);
  }
  for (int i = 0; i < 100; ++i) body.advance(-75.0, 1e-3);
  EXPECT_LT(body.state().velocity, -1e-3);
  Body other({.mass = kMass, .friction = directed()});
  for (int i = 0; i < 100; ++i) other.advance(100.1, 1e-3);
  EXPECT_GT(other.state().velocity, 1e-5);
}

TEST(Body, DirectedViscousFrictionSettlesAsTheClosedFormSays) {
  // Of constant level: v = (u -+ Fc) / B (1 - exp(-B t / m)).
  DirectedStribeck friction = directed();
  friction.plus.breakaway = friction.plus.coulomb;
  friction.minus.breakaway = friction.minus.coulomb;
  for (const double u : {90.0, -90.0}) {
    Body body({.mass = kMass, .friction = friction});
    for (int i = 0; i < 2500; ++i) body.advance(u, 1e-4);
    const double force = u > 0.0 ? u - 60.0 : u + 40.0;
    const double viscous = u > 0.0 ? 500.0 : 900.0;
    EXPECT_NEAR(body.state().velocity, force / viscous * (1.0 - std::exp(-viscous * 0.25 / kMass)),
                1e-12);
  }
}

TEST(Body, TwoHalvesOfLuGreAreOne) {
  const LuGre whole = bristles();
  Body one({.mass = kMass, .friction = whole});
  Body two({.mass = kMass, .friction = CoveredLuGre{share_of(whole, 0.5), share_of(whole, 0.5)}});
  double furthest = 0.0;
  for (int i = 0; i < 50000; ++i) {
    const double u = 250.0 * std::sin(20.0 * i * 1e-5) + 60.0 * std::sin(333.0 * i * 1e-5);
    one.advance(u, 1e-5);
    two.advance(u, 1e-5);
    ASSERT_NEAR(one.state().position, two.state().position, 1e-13);
    ASSERT_NEAR(one.friction_force(u), two.friction_force(u), 1e-6);
    furthest = std::max(furthest, std::abs(one.state().position));
  }
  EXPECT_GT(furthest, 1e-3);  // it slid
}

TEST(Body, ACoverRubsHarderWhenItCloses) {
  const LuGre drive = share_of(bristles(), 0.6);
  const LuGre cover = share_of(bristles(), 0.4);
  const double opening = 120.0 + 30.0 * std::exp(-0.02 * 0.02 / 25e-6) + 300.0 * 0.02;
  for (const double ratio : {1.0, 1.4}) {
    const CoveredLuGre friction{drive, cover, ratio};
    for (const double v : {0.02, -0.02}) {
      Body body({.mass = 1e9, .friction = friction}, 0.0, v);
      for (int i = 0; i < 20000; ++i) body.advance(0.0, 1e-5);
      EXPECT_NEAR(body.friction_force(0.0), v > 0.0 ? opening : -opening * (0.6 + 0.4 * ratio),
                  1e-4);
    }
  }
}

TEST(Body, GmsLevelFollowsTheStribeckCurve) {
  Gms gms = two_elements();
  gms.level = {.coulomb = 80.0, .breakaway = 130.0, .stribeck_velocity = 0.004, .exponent = 2.0};
  for (const double v : {0.002, 0.05}) {
    Body body({.mass = 1e12, .friction = gms}, 0.0, v);
    for (int i = 0; i < 100000; ++i) body.advance(0.0, 1e-5);
    EXPECT_NEAR(body.friction_force(0.0), 80.0 + 50.0 * std::exp(-v * v / 16e-6), 1e-4);
  }
}

TEST(Body, IntegratesWithFourthOrder) {
  // Halving the step divides the error by about 16. Events must not spoil it.
  Gms stribeck = two_elements();
  stribeck.level = {
      .coulomb = 80.0, .breakaway = 130.0, .stribeck_velocity = 0.004, .exponent = 2.0};
  // A power of the velocity that is not whole has no derivatives at rest, and no fourth order.
  DirectedStribeck smooth = directed();
  smooth.plus.exponent = smooth.minus.exponent = 2.0;
  const std::vector<Friction> models = {
      StickCoulomb{{.coulomb = 80.0, .breakaway = 130.0, .stribeck_velocity = 0.004}},
      SaturatedCoulomb{100.0, 2e-3},
      smooth,
      bristles(),
      CoveredLuGre{share_of(bristles(), 0.6), share_of(bristles(), 0.4), 1.5},
      two_elements(),
      stribeck};
  const auto position = [](const Friction& friction, int steps) {
    Body body({.mass = kMass, .viscous = 2000.0, .friction = friction});
    // Breaks away, comes to rest, slides back: forces held over 5 ms.
    for (const double u : {300.0, 300.0, 60.0, -40.0, -300.0, -300.0, 0.0, 20.0}) {
      for (int i = 0; i < steps; ++i) body.advance(u, 5e-3 / steps);
    }
    return body.state().position;
  };
  for (const Friction& friction : models) {
    SCOPED_TRACE("model " + std::to_string(friction.index()));
    const double truth = position(friction, 8192);
    const double coarse = std::abs(position(friction, 128) - truth);
    const double fine = std::abs(position(friction, 512) - truth);
    EXPECT_LT(fine, coarse / 64.0 + 1e-16);
    EXPECT_LT(fine, 1e-12);
  }
}

TEST(GmsWithCurve, FollowsTheCurveItIsGiven) {
  const Gms gms = gms_with_curve(100.0, 20e-6, 3.0, 8);
  check(gms);
  double worst = 0.0;
  for (double x = 0.0; x <= 30e-6; x += 1e-7) {
    double force = 0.0;
    for (std::size_t i = 0; i < gms.stiffness.size(); ++i) {
      force += std::min(gms.stiffness[i] * x, 100.0 * gms.share[i]);
    }
    const double r = std::min(1.0, x / 20e-6);
    worst = std::max(worst, std::abs(force - 100.0 * (1.0 - std::pow(1.0 - r, 3.0))));
  }
  EXPECT_LT(worst, 2.5);  // chords of 8 elements
}

TEST(Friction, RefusesParametersOutOfRange) {
  EXPECT_THROW(check(SaturatedCoulomb{-1.0, 1e-3}), std::invalid_argument);
  EXPECT_THROW(check(SaturatedCoulomb{1.0, 0.0}), std::invalid_argument);
  EXPECT_THROW(check(constant_coulomb(NAN)), std::invalid_argument);
  LuGre lugre = bristles();
  lugre.sigma0 = 0.0;
  EXPECT_THROW(check(lugre), std::invalid_argument);
  CoveredLuGre covered{bristles(), bristles()};
  covered.closing_ratio = 0.0;
  EXPECT_THROW(check(covered), std::invalid_argument);
  covered.closing_ratio = 1.0;
  covered.cover.level.breakaway = 0.0;
  EXPECT_THROW(check(covered), std::invalid_argument);
  DirectedStribeck stribeck = directed();
  stribeck.minus.exponent = 0.0;
  EXPECT_THROW(check(stribeck), std::invalid_argument);
  stribeck = directed();
  stribeck.viscous_minus = -1.0;
  EXPECT_THROW(check(stribeck), std::invalid_argument);
  Gms gms = two_elements();
  gms.share[0] = 0.8;
  EXPECT_THROW(check(gms), std::invalid_argument);
  gms = two_elements();
  gms.stiffness.pop_back();
  EXPECT_THROW(check(gms), std::invalid_argument);
  EXPECT_THROW(gms_with_curve(1.0, 1e-5, 3.0, 17), std::invalid_argument);
  EXPECT_THROW(Body({.mass = 0.0}), std::invalid_argument);
  try {
    Body body({.mass = kMass, .viscous = -3.0});
    FAIL();
  } catch (const std::invalid_argument& e) {
    EXPECT_EQ(std::string(e.what()), "body.viscous is -3.000000, must be finite and at least 0");
  }
}

}  // namespace
}  // namespace servotwin::virtual_machine
