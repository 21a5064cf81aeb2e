// Effects other than friction against closed forms.
#include <gtest/gtest.h>

#include <cmath>
#include <complex>
#include <numbers>

#include "twin/catalogue.h"
#include "twin/model.h"
#include "twin/twin.h"
#include "twin/two_pi.h"

namespace servotwin {
namespace {

constexpr double kH = 1e-3;

/// One effect along a motion that the test makes up sample by sample.
class Along {
 public:
  explicit Along(const Effect& effect) : effect_(effect) {
    start_memory<double>(effect_.kind, effect_.shape.data(), memory_);
  }
  double operator()(const Motion& m) {
    std::array<double, kMaxCoefficients> unit{};
    unit_forces<double>(effect_.kind, effect_.shape.data(), memory_, m, unit.data());
    double sum = 0.0;
    for (std::size_t c = 0; c < coefficients_of(effect_.kind).size(); ++c)
      sum += effect_.coefficient[c] * unit[c];
    return sum;
  }

 private:
  Effect effect_;
  EffectMemory<double> memory_;
};

TEST(Compliance, RingsDownAtItsFrequencyAndDamping) {
  const double f = 24.0, zeta = 0.03, w = kTwoPi * f;
  Effect effect = make_effect<Compliance>();
  effect.shape = {f, zeta};
  effect.coefficient = {1.0 / w, 0.0};  // the deflection itself
  Along mode(effect);
  Motion m;
  m.step_s = kH;
  // Under a constant acceleration from rest: q = -a/w^2 (1 - e^(-zeta w t) (cos + zeta/.. sin)).
  m.command_acceleration = 2.0;
  const double wd = w * std::sqrt(1.0 - zeta * zeta);
  for (int k = 1; k <= 400; ++k) {
    const double t = kH * k, fade = std::exp(-zeta * w * t);
    const double expected =
        -2.0 / (w * w) * (1.0 - fade * (std::cos(wd * t) + zeta * w / wd * std::sin(wd * t)));
    EXPECT_NEAR(mode(m), expected, 1e-15) << k;
  }
}

TEST(Compliance, IsStruckByFrictionAtAReversal) {
  const double f = 24.0, zeta = 0.03, w = kTwoPi * f, wd = w * std::sqrt(1.0 - zeta * zeta);
  Effect effect = make_effect<Compliance>();
  effect.shape = {f, zeta};
  effect.coefficient = {0.0, 0.0, 1.0, 0.0};  // the deflection beyond that at rest
  Along mode(effect);
  Motion m;
  m.step_s = kH;
  // Of a step of the friction from 0 to -1 a mode at rest has
  // q / q_rest = 1 - e^(-zeta w t) (cos wd t + zeta w / wd sin wd t).
  m.velocity = 0.1;
  for (int k = 1; k <= 400; ++k) {
    const double t = kH * k;
    const double expected =
        std::exp(-zeta * w * t) * (std::cos(wd * t) + zeta * w / wd * std::sin(wd * t));
    EXPECT_NEAR(mode(m), expected, 1e-9) << k;
  }
}

TEST(EncoderError, IsMinusTheAccelerationOfTheError) {
  const double period = 4e-3, a = 3e-6, b = -2e-6, k = kTwoPi / period;
  Effect effect = make_effect<EncoderError>();
  effect.shape = {period};
  effect.coefficient = {a, b};
  Along error(effect);
  // x = 5 mm sin(3 t); the error's second derivative by differences of its closed form.
  const auto x = [](double t) { return 5e-3 * std::sin(3.0 * t); };
  const auto epsilon = [&](double t) { return a * std::sin(k * x(t)) + b * std::cos(k * x(t)); };
  for (double t = 0.0; t < 2.0; t += 0.0371) {
    const double d = 1e-4;
    Motion m;
    m.step_s = kH;
    m.position = x(t);
    m.velocity = 15e-3 * std::cos(3.0 * t);
    m.command_acceleration = -45e-3 * std::sin(3.0 * t);
    const double second = (epsilon(t + d) - 2.0 * epsilon(t) + epsilon(t - d)) / (d * d);
    EXPECT_NEAR(error(m), -second, 2e-6) << t;
  }
}

/// An effect along a motor that goes from one velocity to the next.
class Driven {
 public:
  Driven(const Effect& effect, double velocity) : along_(effect) {
    motion_.step_s = kH;
    motion_.velocity = velocity;
  }
  double move_to(double velocity) {
    motion_.displacement = 0.5 * kH * (motion_.velocity + velocity);
    motion_.velocity = velocity;
    return along_(motion_);
  }

 private:
  Along along_;
  Motion motion_;
};

/// A load that friction holds where it is: the play of the textbooks.
TEST(Backlash, LosesItsWidthAtAReversalAndNothingElse) {
  Effect effect = make_effect<Backlash>();
  effect.shape = {10e-6, 2e-5, 50.0};
  effect.coefficient = {1.0, 0.0};
  Along play(effect);
  const auto move = [&](double dx) {
    Motion m;
    m.step_s = kH;
    m.displacement = dx;
    m.velocity = dx / kH;
    return play(m);
  };
  const auto creep = [&](double way) {
    double reading = 0.0;
    for (int k = 0; k < 1000; ++k) reading = move(way / 1000.0);
    return reading;
  };
  EXPECT_NEAR(creep(50e-6), -5e-6, 1e-18);  // the table follows half the gap behind
  EXPECT_NEAR(creep(20e-6), -5e-6, 1e-18);
  const double cycle = 20e-6 / 1000.0;      // it runs on for a cycle
  EXPECT_NEAR(creep(-4e-6), -1e-6, cycle);  // within the gap it stands
  EXPECT_NEAR(creep(-8e-6), 5e-6, 1e-18);
  EXPECT_NEAR(creep(-30e-6), 5e-6, 1e-18);
}

TEST(Backlash, TheLoadRunsOnWhereTheMotorSlowsDown) {
  const double width = 20e-6, friction = 0.5, slows = 2.5, speed = 0.1;
  Effect effect = make_effect<Backlash>();
  effect.shape = {width, 1e-3, friction};
  effect.coefficient = {1.0, 0.0};
  Driven play(effect, speed);
  for (int k = 0; k < 50; ++k) play.move_to(speed);
  EXPECT_NEAR(play.move_to(speed), -0.5 * width, 1e-15);
  // x_load - x_motor = (slows - friction) t^2 / 2 - width / 2, until it is on the other side.
  for (int k = 1; k <= 30; ++k) {
    const double t = kH * k, way = 0.5 * (slows - friction) * t * t;
    EXPECT_NEAR(play.move_to(speed - slows * t), std::min(way, width) - 0.5 * width, 1e-12) << k;
  }
}

TEST(BacklashInLoop, PushesByTheWholeGapAtEveryReversal) {
  Effect effect = make_effect<BacklashInLoop>();
  effect.shape = {10e-6};
  effect.coefficient = {1.0};
  Along play(effect);
  double sum = 0.0;
  const auto run = [&](double velocity, int cycles) {
    Motion m;
    m.step_s = kH;
    m.command_velocity = velocity;
    for (int i = 0; i < cycles; ++i) sum += kH * play(m);
  };
  run(0.02, 100);
  sum = 0.0;
  run(-0.02, 100);
  EXPECT_NEAR(sum, -10e-6, 1e-16);
  run(-0.02, 100);
  EXPECT_NEAR(sum, -10e-6, 1e-16);
  run(0.02, 100);
  EXPECT_NEAR(sum, 0.0, 1e-16);
}

/// What acts on a motor that slows down from speed: the load runs on against it.
TEST(BacklashBehindEncoder, TheLoadCrossesTheGapByItselfAndIsCaught) {
  const double width = 20e-6, friction = 0.5, slows = 2.5, speed = 0.1;
  Effect effect = make_effect<BacklashBehindEncoder>();
  effect.shape = {width, 1e-3, friction};
  effect.coefficient = {7.0, 1.0};
  Driven play(effect, speed);
  for (int k = 0; k < 50; ++k) play.move_to(speed);  // until it is pushed
  EXPECT_NEAR(play.move_to(speed), 0.0, 1e-12);
  // x_load - x = (slows - friction) t^2 / 2 until it is the width of the gap.
  const double across = std::sqrt(2.0 * width / (slows - friction));
  double sum = 0.0;
  for (int k = 1; k <= 30; ++k) {
    const double d = play.move_to(speed - slows * kH * k);
    if (kH * k < across) {
      EXPECT_NEAR(d, slows - friction, 1e-9) << k;
    } else if (kH * (k - 2) > across) {
      EXPECT_NEAR(d, 0.0, 1e-9) << k;
    }
    sum += kH * d;
  }
  EXPECT_NEAR(sum, 0.0, 1e-9);  // what its inertia was short of comes back in the impact
}

TEST(BacklashBehindEncoder, InTheGapTheMotorHasNoFriction) {
  Effect effect = make_effect<BacklashBehindEncoder>();
  effect.shape = {50e-6, 1e-3, 10.0};  // friction holds the load where it is
  effect.coefficient = {0.4, 0.0};
  Along play(effect);
  double gone = 0.0;  // travel without friction
  const auto run = [&](double velocity, int cycles) {
    Motion m;
    m.step_s = kH;
    m.velocity = velocity;
    m.displacement = kH * velocity;
    for (int k = 0; k < cycles; ++k) gone += play(m) / 0.4 * std::abs(m.displacement);
  };
  run(5e-3, 40);
  gone = 0.0;
  run(-5e-3, 40);
  EXPECT_NEAR(gone, 50e-6, 5e-6);  // travel of one cycle
}

TEST(UnexplainedForce, IsLinearBetweenItsKnotsAndConstantBeyond) {
  Effect effect = make_effect<UnexplainedOverVelocity>();
  effect.shape = {-0.2, 0.2};
  for (std::size_t i = 0; i < 9; ++i) effect.coefficient[i] = std::pow(static_cast<double>(i), 2.0);
  Along table(effect);
  Motion m;
  m.step_s = kH;
  for (const auto& [velocity, expected] : {std::pair{-0.5, 0.0},
                                           {-0.2, 0.0},
                                           {-0.175, 0.5},
                                           {0.0, 16.0},
                                           {0.0125, 18.25},
                                           {0.2, 64.0},
                                           {0.7, 64.0}}) {
    m.velocity = velocity;
    EXPECT_NEAR(table(m), expected, 1e-12) << velocity;
  }
}

// A pendulum of mass m and arm l on an axis with the moment J: m g l sin(x) / J, and where the zero
// is with the arm level m g l cos(x) / J.
TEST(SwingingLoad, IsTheWeightTimesItsLeverArm) {
  constexpr double kMass_kg = 2.0, kArm_m = 0.3, kInertia_kgm2 = 0.4, kGravity_mps2 = 9.81;
  const double most = kMass_kg * kGravity_mps2 * kArm_m / kInertia_kgm2;
  Effect effect = make_effect<SwingingLoad>();
  effect.coefficient = {most, 0.0};
  Along hanging(effect);
  effect.coefficient = {0.0, most};
  Along level(effect);
  for (const double degrees : {0.0, 30.0, 90.0, 180.0, -90.0, 725.0}) {
    Motion m;
    m.position = degrees * kTwoPi / 360.0;
    EXPECT_NEAR(hanging(m), most * std::sin(m.position), 1e-12 * most) << degrees;
    EXPECT_NEAR(level(m), most * std::cos(m.position), 1e-12 * most) << degrees;
  }
}

// The step response of two poles, p and s, in closed form.
TEST(CrossCoupling, FollowsTheOtherAxisAsItsLoopDoes) {
  for (const double zeta : {0.3, 0.8, 0.99999, 1.0, 1.00001, 2.2, 5.0}) {
    const double f = 12.0, w = kTwoPi * f;
    const std::complex<double> apart = w * std::sqrt(std::complex<double>(zeta * zeta - 1.0)),
                               p = -zeta * w - apart, s = -zeta * w + apart;
    Effect effect = make_effect<CrossCoupling>();
    effect.shape = {f, zeta};
    effect.coefficient = {0.3, 0.2, 0.1};
    Along along(effect);
    Motion m;
    m.step_s = kH;
    m.neighbour_acceleration = 2.0;
    for (int k = 1; k <= 2000; ++k) {
      const double t = kH * k, critical = std::exp(-w * t);
      const bool apart_at_all = zeta != 1.0;
      const double q =
          apart_at_all ? (2.0 + 2.0 * (s * std::exp(p * t) - p * std::exp(s * t)) / (p - s)).real()
                       : 2.0 - 2.0 * (1.0 + w * t) * critical;
      const double rate = apart_at_all
                              ? (2.0 * w * w * (std::exp(p * t) - std::exp(s * t)) / (p - s)).real()
                              : 2.0 * w * w * t * critical;
      ASSERT_NEAR(along(m), 0.3 * q + 0.2 * rate / w + 0.1 * (2.0 - q), 1e-10)
          << k << ", zeta " << zeta;
    }
    EXPECT_NEAR(along(m), 0.3 * 2.0, 1e-5);
  }
}

TEST(Onset, EffectsOfAMomentAreNotThereBeforeIt) {
  Motion m;
  m.step_s = kH;
  m.acceleration = 3.0;
  m.velocity = 0.1;
  m.displacement = 1e-4;
  m.tracking_error = 2e-6;
  Effect inertia = make_effect<InertiaChange>();
  inertia.shape = {4.0};
  inertia.coefficient = {0.25};
  Effect added = make_effect<AddedFriction>();
  added.shape = {4.0};
  added.coefficient = {0.4, 2.0};
  Effect gain = make_effect<GainChange>();
  gain.shape = {4.0};
  gain.coefficient = {1000.0, 0.0};
  for (const auto& [effect, late] :
       {std::pair{inertia, 0.25 * 3.0}, {added, 0.4 + 0.2}, {gain, 1000.0 * 2e-6}}) {
    Along along(effect);
    m.time_s = 3.999;
    EXPECT_EQ(along(m), 0.0);
    m.time_s = 4.0 + 0.5 * kOnset_s;
    EXPECT_NEAR(along(m), 0.5 * late, 1e-12);
    m.time_s = 9.0;
    EXPECT_NEAR(along(m), late, 1e-12);
  }
}

TEST(TorqueSaturation, IsWhatTheDemandExceedsTheLimitBy) {
  Effect effect = make_effect<TorqueSaturation>();
  effect.shape = {2.0, 60.0, 0.5};
  effect.coefficient = {0.5};
  Along along(effect);
  const auto at = [&](double demand) {
    Motion m;
    m.demand = demand;
    return along(m);
  };
  EXPECT_EQ(at(1.9), 0.0);
  EXPECT_DOUBLE_EQ(at(2.6), 0.3);
  EXPECT_EQ(at(-1.9), 0.0);
  EXPECT_DOUBLE_EQ(at(-2.6), -0.3);
  Motion creeping;
  creeping.demand = 1.9;
  creeping.velocity = 0.4;  // viscous friction takes 0.2
  EXPECT_NEAR(along(creeping), 0.05, 1e-15);
}

TEST(TorqueSaturation, HoldsTheIntegratorWhileThatLeadsFurtherBeyond) {
  Effect effect = make_effect<TorqueSaturation>();
  effect.shape = {2.0, 60.0, 0.5};
  effect.coefficient = {1.0};
  Along along(effect);
  Motion m;
  m.step_s = 0.01;
  m.demand_damping = 0.05;  // 3 m/s^3 by 1/Ti
  const auto at = [&](double demand, double rate) {
    m.demand = demand;
    m.demand_rate = rate;
    return along(m);
  };
  EXPECT_EQ(at(1.0, 2.0), 0.0) << "below the limit nothing is held";
  EXPECT_DOUBLE_EQ(at(2.5, 2.0), 0.5);
  // A third of the step was beyond: 0.05 / 3 is held.
  EXPECT_DOUBLE_EQ(at(2.5, -9.0), 0.5) << "what leads back is not held: -0.5 in the mean";
  // 0.5 - 0.05 / 3 beyond before it is left; held over all of the step, 1 + 0.05 / 3 + 0.03 short
  // of it after.
  const double left = (0.5 - 0.05 / 3.0) / (1.5 + 0.03);
  EXPECT_DOUBLE_EQ(at(1.0, 9.0), 0.05 / 3.0 + 0.03 * left) << "and what was held stays away";
  EXPECT_DOUBLE_EQ(at(1.0, 2.0), 0.05 / 3.0 + 0.03 * left);
}

TEST(TorqueSaturation, HoldsTheIntegratorWhereverItLeads) {
  Effect effect = make_effect<TorqueSaturationHolding>();
  effect.shape = {2.0, 60.0, 0.5};
  effect.coefficient = {1.0};
  Along along(effect);
  Motion m;
  m.step_s = 0.01;
  const auto at = [&](double demand, double rate) {
    m.demand = demand;
    m.demand_rate = rate;
    return along(m);
  };
  EXPECT_EQ(at(1.0, -5.0), 0.0) << "below the limit nothing is held";
  EXPECT_DOUBLE_EQ(at(2.5, -5.0), 0.5);
  // What leads back is held as well: of a third of this step and all of the next.
  EXPECT_DOUBLE_EQ(at(2.5, -5.0), 0.5);
  const double held = -0.05 / 3.0 - 0.05, left = (0.5 - held) / (1.5 - 0.05);
  EXPECT_DOUBLE_EQ(at(1.0, -5.0), held - 0.05 * left) << "and stays away";
}

TEST(TorqueSaturation, LeadsTheIntegratorBackInTheTrackingTime) {
  constexpr double kLimit = 2.0, kAsked = 2.6, kTracking = 0.03, kCycle = 0.01;
  Effect effect = make_effect<TorqueSaturationBackCalculation>();
  effect.shape = {kLimit, kTracking, 0.5};
  effect.coefficient = {1.0};
  Along along(effect);
  Motion m;
  m.step_s = kCycle;
  m.demand = kAsked;
  m.demand_rate = 1.0;
  for (int k = 0; k < 20; ++k)
    EXPECT_NEAR(along(m), kAsked - kLimit, 1e-15) << "the motor gives what it can";
  // What is missing of a constant demand fades with the tracking time; the rest is held.
  m.demand = kLimit;
  EXPECT_NEAR(along(m), (kAsked - kLimit) * (1.0 - std::exp(-20.0 * kCycle / kTracking)), 1e-15);
  // A control without an integrator has nothing to lead back.
  Along without(effect);
  m.demand_rate = 0.0;
  m.demand = kAsked;
  without(m);
  m.demand = kLimit;
  EXPECT_EQ(without(m), 0.0);
}

TEST(DwellStiction, GrowsWithTheLogarithmOfTheRestAndIsLostWithTravel) {
  Effect effect = make_effect<DwellStiction>();
  effect.shape = {50e-6, 0.5};
  effect.coefficient = {0.2};
  Along along(effect);
  Motion m;
  m.step_s = 0.01;
  m.friction = -0.8;  // the axis came to rest before friction had turned
  for (int i = 1; i <= 300; ++i)
    EXPECT_NEAR(along(m), -0.8 * 0.2 * std::log1p(0.02 * i), 1e-12) << "at rest";
  m.command_velocity = m.velocity = -0.01;
  m.displacement = -25e-6;
  m.friction = -1.0;
  EXPECT_NEAR(along(m), -0.2 * std::log(7.0) * std::exp(-0.5), 1e-12);
  EXPECT_NEAR(along(m), -0.2 * std::log(7.0) * std::exp(-1.0), 1e-12);
  // What motion has left of it, the next rest adds to.
  m.command_velocity = m.velocity = m.displacement = 0.0;
  EXPECT_NEAR(along(m), -0.2 * (std::log(7.0) * std::exp(-1.0) + std::log(1.02)), 1e-12);
}

TEST(DwellStiction, ItIsTheAxisThatRestsAndASettlingBeginsItAnew) {
  Effect effect = make_effect<DwellStiction>();
  effect.shape = {50e-6, 0.5};
  effect.coefficient = {1.0};
  Along along(effect);
  Motion m;
  m.step_s = 0.01;
  m.friction = 1.0;
  m.command_velocity = 0.1;  // the axis is at rest nevertheless
  double extra = 0.0;
  for (int i = 1; i <= 100; ++i) extra = along(m);
  EXPECT_NEAR(extra, std::log(3.0), 1e-12);
  // An encoder's last digit comes and goes; its mean velocity is close to 0.
  m.displacement = 1e-6;
  m.velocity = 1e-9;
  extra = along(m);
  EXPECT_NEAR(extra, std::log(3.02), 1e-5);
  // 3 um in one step: of the age e^-3 is left, of the force e^-0.06.
  m.displacement = 3e-6;
  m.velocity = 3e-4;
  const double settled = along(m), age = 1.02 * std::exp(-3.0);
  EXPECT_NEAR(settled, extra * std::exp(-0.06), 1e-6);
  m.displacement = m.velocity = 0.0;
  EXPECT_NEAR(along(m), settled + std::log((0.51 + age) / (0.5 + age)), 1e-6);
}

// Of several laws, along a motion that turns: what changes friction is the law's own force over its
// coefficient, wherever in the model the law stands.
TEST(WhatChangesFriction, HasTheDirectionOfTheLawInTheModel) {
  for (const bool behind : {false, true}) {
    Model model;
    model.sample_time_s = 1e-3;
    model.loop = {2, {200.0, 1e4}, {1.0, 200.0}};
    Effect law = make_effect<Presliding>(), unlike = make_effect<AsymmetricFriction>();
    law.coefficient = {0.3};
    unlike.coefficient = {0.3};
    model.effects = {unlike, law};
    if (behind) std::swap(model.effects[0], model.effects[1]);
    // With a difference as large as the law there is no friction backwards and twice as much
    // forwards; at its constant speed the axis is away by f / a2 = 2 x 0.3 / 1e4 more one way.
    Twin twin(model);
    twin.start(0.0);
    double forward = 0.0, backward = 0.0;
    for (int k = 1; k <= 4000; ++k) {
      const double v = k <= 2000 ? 0.01 : -0.01;
      const double x = k <= 2000 ? 1e-5 * k : 0.02 - 1e-5 * (k - 2000);
      const double error = twin.step({v, 0.0, 0.0, x, v, 0.0});
      (k <= 2000 ? forward : backward) = error;
    }
    EXPECT_NEAR(forward, 200.0 * 0.01 / 1e4 + 0.6 / 1e4, 1e-8);
    EXPECT_NEAR(backward, -200.0 * 0.01 / 1e4, 1e-8);
  }
}

// Half turned after a reversal as much as sliding: friction that has set in beside a law is that
// law at a higher level, and nothing else.
TEST(WhatChangesFriction, IsTheLawAtAnotherLevelAllAlongAReversal) {
  Model beside, higher;
  beside.sample_time_s = higher.sample_time_s = kH;
  beside.loop = higher.loop = {2, {200.0, 1e4}, {1.0, 200.0}};
  Effect law = make_effect<Presliding>(), added = make_effect<AddedFriction>();
  law.shape = {2e-4, 0.4};
  law.coefficient = {0.3};
  added.shape = {1e-3};
  added.coefficient = {0.2, 0.0};
  beside.effects = {added, law};
  law.coefficient = {0.5};
  higher.effects = {law};
  Twin two(beside), one(higher);
  two.start(0.0);
  one.start(0.0);
  double most = 0.0;
  for (int k = 1; k <= 1000; ++k) {
    // After a rest, by which it has set in, 0.3 mm there and back again and again.
    const double w = 20.0, t = std::max(0.0, kH * k - 0.2), before = std::max(0.0, t - kH);
    const auto x = [w](double at) { return 1.5e-4 * (1.0 - std::cos(w * at)); };
    const auto v = [w](double at) { return 1.5e-4 * w * std::sin(w * at); };
    const double a = (v(t) - v(before)) / kH;
    const CommandPiece piece{v(before), a, 0.0, x(t), v(t), a};
    const double error = one.step(piece);
    EXPECT_NEAR(two.step(piece), error, 1e-12) << k;
    most = std::max(most, std::abs(error));
  }
  EXPECT_GT(most, 2e-5);  // friction is most of it: 0.5 / 1e4
}

TEST(Tones, AreSinesInTimeAndTheCutIsGated) {
  Effect pump = make_effect<PeriodicDisturbance>();
  pump.shape = {12.5};
  pump.coefficient = {0.3, 0.4};
  Effect cut = make_effect<CuttingForce>();
  cut.shape = {12.5};
  cut.coefficient = {1.0, 0.3, 0.4};
  for (double t = 0.0; t < 1.0; t += 0.0123) {
    Motion m;
    m.time_s = t;
    const double tone = 0.5 * std::sin(kTwoPi * 12.5 * t + std::atan2(0.4, 0.3));
    EXPECT_NEAR(Along(pump)(m), tone, 1e-12);
    EXPECT_EQ(Along(cut)(m), 0.0);
    m.in_cut = 1.0;
    EXPECT_NEAR(Along(cut)(m), 1.0 + tone, 1e-12);
  }
}

TEST(ThermalGrowth, IsAShareOfThePositionThatWarmsUp) {
  Effect effect = make_effect<ThermalGrowth>();
  effect.shape = {20.0};
  effect.coefficient = {1e-5, 2e-6, 0.0};
  Motion m;
  m.position = 0.3;
  m.time_s = 0.0;
  EXPECT_EQ(Along(effect)(m), 0.0);
  m.time_s = 20.0;
  EXPECT_NEAR(Along(effect)(m), (3e-6 + 2e-6) * (1.0 - 1.0 / std::numbers::e), 1e-18);
}

TEST(ImpulseDisturbance, EveryPushHasHalfItsWidthTimesItsHeight) {
  Effect effect = make_effect<ImpulseDisturbance>();
  effect.shape = {1.0, 2.0, 3.0, 4.0, 0.01};
  effect.coefficient = {5.0, 0.0, -7.0, 0.0};
  Along along(effect);
  double first = 0.0, third = 0.0;
  for (int i = 0; i < 5000; ++i) {
    Motion m;
    m.time_s = kH * i;
    (m.time_s < 2.5 ? first : third) += kH * along(m);
  }
  EXPECT_NEAR(first, 5.0 * 0.01, 1e-9);
  EXPECT_NEAR(third, -7.0 * 0.01, 1e-9);
}

}  // namespace
}  // namespace servotwin
