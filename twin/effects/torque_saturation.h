// A motor that cannot provide what the control demands.
//
//   asked = demand - held + viscous x',   missing = what of it lies beyond +- limit, else 0
//   d = share (missing + held)
//
// The demand is that of the loop, including friction and the tracking error, so the limit stays
// active until the error has been corrected. The integrator of a control does not wind up
// meanwhile, while that of the linear loop does: `held` is what the latter has too much.
//
//   rate = a3 e - c2 x_r' + reset a1 e'                  of the linear loop's integrator
//   held' = rate while missing and rate have one sign    clamping: it stops where it would lead
//                                                        further beyond the limit
//   held' = rate while anything is missing               holding
//   held' = missing / tracking_s                         back-calculation
//
// reset = 1/Ti of a PI velocity control. Without an integrator the three are the same, and held is
// 0. Source: docs/theory.md 3.11.
#pragma once

#include <array>
#include <cmath>

#include "twin/effect.h"

namespace servotwin {

/// What the integrator of the velocity control does at the limit.
enum class AntiWindup { kClamping, kHolding, kBackCalculation };

template <AntiWindup A>
struct TorqueSaturationOf {
  static constexpr bool kTracks = A == AntiWindup::kBackCalculation;
  static constexpr Identity kIdentity{
      .id = A == AntiWindup::kClamping  ? "torque_saturation"
            : A == AntiWindup::kHolding ? "torque_saturation_holding"
                                        : "torque_saturation_back_calculation",
      .meaning = A == AntiWindup::kClamping
                     ? "the control demands more torque than the motor can give"
                 : A == AntiWindup::kHolding
                     ? "the same, with a control that holds its integrator at the limit"
                     : "the same, with a control that leads its integrator back to the limit",
      .acts = Acts::kForce,
      .cause = "torque_saturation",
      .form_of = A == AntiWindup::kClamping ? "" : "torque_saturation",
      .check = "acceleration limits of the program against the torque limit of the motor",
      .on_motor = true,
      .of_control = true};
  static constexpr Parameter kReset{
      "reset", "1/s", 0.1, 1000.0, 60.0, "reset rate of the velocity control's integrator, 1/Ti"};
  static constexpr Parameter kTracking{
      "tracking_s", "s", 1e-4, 10.0, 0.02, "time in which the integrator is led back to the limit"};
  static constexpr std::array<Parameter, 3> kShapes{
      {{"limit_mps2", "m/s^2", 0.01, 1000.0, 1.0, "acceleration that the motor can give", true,
        false, Scan::kDemand},
       kTracks ? kTracking : kReset,
       {"viscous", "1/s", 1e-3, 100.0, 0.3,
        "viscous friction that is part of the poles and that the motor overcomes as well"}}};
  static constexpr std::array<Parameter, 1> kCoefficients{
      {{"share", "1", -10.0, 10.0, 0.0, "share of the demand above the limit that is missing"}}};
  template <class T>
  struct Memory {
    explicit Memory(const T* /*shape*/) {}
    T held = T(0.0);
    T asked = T(0.0), rate = T(0.0);  // at the sample before
    template <class F>
    void each(const F& f) {
      f(held);
      f(asked);
      f(rate);
    }
  };

  template <class T, class M>
  static void unit_forces(const T* shape, Memory<T>& memory, const MotionOf<M>& m,
                          T* force) noexcept {
    const T without = m.demand + shape[2] * m.velocity;
    memory.held += change_of_held(shape, memory, m, T(without - memory.held));
    const T asked = without - memory.held;
    memory.asked = asked;
    force[0] = beyond(shape[0], asked) + memory.held;
  }

 private:
  /// What of the demand lies beyond the limit, else 0.
  template <class T>
  static T beyond(const T& limit, const T& asked) noexcept {
    return asked > limit ? asked - limit : asked < -limit ? asked + limit : T(0.0);
  }

  /// The change of `held` over this step.
  template <class T, class M>
  static T change_of_held(const T* shape, Memory<T>& memory, const MotionOf<M>& m,
                          const T& asked) noexcept {
    using std::exp;
    if constexpr (kTracks) {
      // What is missing fades while the demand stays: exactly so over the step. Only a loop with an
      // integrator has a rate.
      if (m.demand_rate == M(0.0)) return T(0.0);
      return beyond(shape[0], asked) * (1.0 - exp(-m.step_s / shape[1]));
    } else {
      // The side on which the limit was exceeded, or may be now.
      const bool was_beyond = memory.asked > shape[0] || memory.asked < -shape[0];
      const double side = (was_beyond ? memory.asked : asked) > T(0.0) ? 1.0 : -1.0;
      const T before = side * memory.asked - shape[0], now = side * asked - shape[0];
      const T rate = m.demand_rate + shape[1] * m.demand_damping;
      const T leads = 0.5 * side * (rate + memory.rate);  // further beyond, in the mean
      memory.rate = rate;
      if (A == AntiWindup::kClamping && !(leads > T(0.0))) return T(0.0);
      // Three cases: beyond throughout, the limit is left within the step, or reached. Never back
      // below the limit: there the integrator runs again.
      const T all = m.step_s * leads, now_if_held = now - all;
      T change = T(0.0);
      if (before > T(0.0)) {
        change = now_if_held > T(0.0) ? all : all * before / (before - now_if_held);
        if (!(now_if_held > T(0.0)) && now > change) change = now;
      } else if (now > T(0.0)) {
        change = all * now / (now - before);
        if (change > now) change = now;
      }
      return side * change;
    }
  }
};

using TorqueSaturation = TorqueSaturationOf<AntiWindup::kClamping>;
using TorqueSaturationHolding = TorqueSaturationOf<AntiWindup::kHolding>;
using TorqueSaturationBackCalculation = TorqueSaturationOf<AntiWindup::kBackCalculation>;

}  // namespace servotwin
