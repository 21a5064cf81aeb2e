// Motor and load of an axis as two masses on a spring, in the loop of its drive.
//
//   (1 - load_share) x1'' = u - c - d1      motor
//   load_share x2''       = c - d2          load
//   c = load_share (omega^2 s + 2 zeta omega (x1' - x2')) in contact, never pulling across the gap
//       s: x1 - x2 beyond +- width / 2      without play: x1 - x2
//   u = (1 - c0) x_r'' - c1 x_r' + a1 (x_r - x1)' + a2 e + I,   I' = a3 e - c2 x_r'   (order 3)
//   e = x_r - x1 or, if the load's encoder closes the position loop, x_r - x2; then the part
//       a1 reset of a2 stays with the motor, whose velocity the integrator integrates
//
// All forces are per moved mass of both. In the limit of a stiff spring it is the loop of
// twin/loop.h. Omega and zeta are those of the load with the motor held.
//
// Linear but for the play: the state (e1, e1', q, q', I) with q = x1 - x2 is stepped exactly for a
// cubic command and for forces that are linear within the step. Play is the force by which the
// spring falls short of the linear one, a force on both masses. SI units. `discretise` allocates;
// the rest allocates nothing and throws nothing. Any one thread.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <numbers>

#include "twin/effects/two_mass.h"
#include "twin/model.h"

namespace servotwin {

template <class S>
struct CommandPieceOf;

/// The parameters of an effect that acts on the axis.
template <class S>
struct TwoMassParametersOf {
  Encoders encoders = Encoders::kMotor;
  S omega = 0.0;  ///< [rad/s]
  S zeta = 0.0;
  S load_share = 0.0, friction_share = 0.0;
  S reset = 0.0;  ///< [1/s]
  S width = 0.0;  ///< of the gap [m | rad]; 0 without play
};
using TwoMassParameters = TwoMassParametersOf<double>;

/// Of the effect that acts on the axis; nothing in a model without one.
template <class S>
[[nodiscard]] const EffectOf<S>* two_mass_of(const ModelOf<S>& model) {
  for (const EffectOf<S>& effect : model.effects) {
    if (acts_on_axis(effect.kind)) return &effect;
  }
  return nullptr;
}
template <class S>
[[nodiscard]] TwoMassParametersOf<S> two_mass_parameters(const EffectOf<S>& effect) {
  TwoMassParametersOf<S> out;
  out.omega = 2.0 * std::numbers::pi * effect.shape[0];
  out.zeta = effect.shape[1];
  out.load_share = effect.shape[2];
  out.friction_share = effect.shape[3];
  visit_effect(effect.kind, [&]<class E, std::size_t>() {
    if constexpr (E::kIdentity.acts == Acts::kAxis) {
      out.encoders = E::kEncoders;
      if constexpr (E::kEncoders == Encoders::kLoad) out.reset = effect.shape[E::kResetAt];
      if constexpr (E::kPlay) out.width = effect.shape[E::kWidthAt];
    }
  });
  return out;
}
/// Whether these are two masses with play between them.
template <class S>
[[nodiscard]] bool plays(const ModelOf<S>& model) {
  const EffectOf<S>* two_masses = two_mass_of(model);
  return two_masses != nullptr && two_mass_parameters(*two_masses).width > 0.0;
}
/// The same kind of axis without play.
template <class S>
[[nodiscard]] EffectOf<S> without_play(const EffectOf<S>& effect) {
  EffectOf<S> out = effect;
  visit_effect(effect.kind, [&]<class E, std::size_t>() {
    if constexpr (E::kIdentity.acts == Acts::kAxis)
      out.kind = kind_of<TwoMass<E::kEncoders, false>>();
  });
  return out;
}

/// The body on which the force of an effect acts: friction on both, by the axis' share on each.
enum class ActsOn { kMotor, kLoad, kBoth };
[[nodiscard]] inline ActsOn acts_on(std::size_t kind) {
  if (identity_of(kind).on_motor) return ActsOn::kMotor;
  return is_friction(kind) && kind != kind_of<ConstantForce>() ? ActsOn::kBoth : ActsOn::kLoad;
}

/// a2 in two parts: by the position of the loop's encoder, and by the motor's.
template <class S>
struct PositionGainOf {
  S by_loop = 0.0, by_motor = 0.0;
};
template <class S>
[[nodiscard]] PositionGainOf<S> position_gain_of(const LoopOf<S>& loop,
                                                 const TwoMassParametersOf<S>& parameters) {
  const S &a1 = loop.denominator[0], &a2 = loop.denominator[1];
  if (parameters.encoders != Encoders::kLoad) return {0.0, a2};
  const S by_motor = loop.order == 3 ? std::min<S>(a1 * parameters.reset, a2) : S(0.0);
  return {a2 - by_motor, by_motor};
}

/// The equations without play: the rate of the state (e1, e1', q, q', I) by the state, by velocity
/// and acceleration of the command, and by forces on motor and load.
template <class S>
struct TwoMassEquationsOf {
  static constexpr std::size_t kStates = 5;
  using State = std::array<S, kStates>;
  int states = 0;  ///< 5 with integral action, else 4
  std::array<State, kStates> by_state{};
  State by_velocity{}, by_acceleration{}, by_motor_force{}, by_load_force{};
};
using TwoMassEquations = TwoMassEquationsOf<double>;
/// Lanes for the derivatives by the parameters of loop and masses alone: six are used.
inline constexpr std::size_t kDriveLanes = 8;
using DriveDual = Dual<kDriveLanes>;

/// Compiled for double, TwinDual and DriveDual.
template <class S>
[[nodiscard]] TwoMassEquationsOf<S> two_mass_equations(const LoopOf<S>& loop,
                                                       const TwoMassParametersOf<S>& parameters);

/// Whether the loop is stable with these two masses, without play. Allocates.
[[nodiscard]] bool stable(const Loop& loop, const TwoMassParameters& parameters);

/// Compiled for double, TwinDual and DriveDual.
template <class S>
class TwoMassAxisOf {
 public:
  static constexpr int kStates = 5;
  using State = std::array<S, kStates>;
  /// The constants of a step: the state at its end by the state and the command at its begin
  /// (velocity, acceleration, jerk), and by the forces at begin and end.
  struct Step {
    std::array<State, kStates> phi{};
    std::array<std::array<S, 3>, kStates> command{};
    State motor_begin{}, motor_end{}, load_begin{}, load_end{};
  };
  struct Forces {
    S motor = 0.0, load = 0.0;  ///< d1, d2, with the play's force in them
  };
  /// Everything at the end of a step that forces of the effects may depend on.
  struct Ends {
    S motor_position = 0.0, motor_velocity = 0.0, motor_acceleration = 0.0;
    S load_position = 0.0, load_velocity = 0.0, load_acceleration = 0.0;
    S loop_error = 0.0, loop_rate = 0.0, demand = 0.0, demand_rate = 0.0;
    S recorded_error = 0.0;
  };

  [[nodiscard]] bool used() const noexcept { return states_ > 0; }
  [[nodiscard]] int states() const noexcept { return states_; }
  [[nodiscard]] const Step& step() const noexcept { return step_; }
  [[nodiscard]] const TwoMassParametersOf<S>& parameters() const noexcept { return parameters_; }

  void discretise(const LoopOf<S>& loop, const TwoMassParametersOf<S>& parameters, double step_s);
  /// The state in which constant forces are balanced, with the load on the side to which they push.
  [[nodiscard]] State at_rest(const Forces& forces) const noexcept;
  /// The state at the end of the step without the forces at its end.
  [[nodiscard]] State free(const State& from, const CommandPieceOf<S>& piece,
                           const Forces& begin) const noexcept;
  /// The same with them.
  [[nodiscard]] State with(const State& free, const Forces& end) const noexcept;
  [[nodiscard]] Ends ends_of(const State& state, const CommandPieceOf<S>& piece,
                             const Forces& end) const noexcept;
  /// The force by which the spring falls short of the linear one for this deflection and its rate.
  [[nodiscard]] S missing_contact(const S& deflection, const S& rate) const noexcept;
  [[nodiscard]] S missing_contact(const State& state) const noexcept {
    return missing_contact(state[2], state[3]);
  }

 private:
  void add(S& sum, const S& constant, const S& x) const noexcept {
    if constexpr (is_dual<S>) {
      add_product(sum, constant, x, lanes_, S::kLanes);
    } else {
      sum += constant * x;
    }
  }

  int states_ = 0;  // 5 with integral action, else 4
  TwoMassParametersOf<S> parameters_;
  std::array<S, kMaxOrder> denominator_{}, numerator_{};
  PositionGainOf<S> gain_;
  S integral_ = 0.0, integral_velocity_ = 0.0;
  S command_velocity_ = 0.0;  // -c1, of the demand
  S command_acceleration_ = 0.0;
  Step step_;
  std::size_t lanes_ = 0;  // only the first so many parameters change what is above
};
using TwoMassAxis = TwoMassAxisOf<double>;

}  // namespace servotwin
