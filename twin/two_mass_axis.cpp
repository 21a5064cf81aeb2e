#include "twin/two_mass_axis.h"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>

#include "twin/hold_of.h"
#include "twin/linear_algebra.h"
#include "twin/twin.h"

namespace servotwin {

namespace {

// Places of the state.
constexpr std::size_t kError = 0, kRate = 1, kDeflection = 2, kDeflectionRate = 3, kIntegral = 4;

}  // namespace

namespace {

/// Units in which all states are of one size: rates by the fastest frequency, the integral by its
/// square.
template <class S>
double fastest_of(const LoopOf<S>& loop, const TwoMassParametersOf<S>& parameters) {
  return std::max({value_of(parameters.omega), value_of(loop.denominator[0]),
                   std::sqrt(std::abs(value_of(loop.denominator[1])))});
}
Eigen::VectorXd units_of(Eigen::Index states, double fastest) {
  Eigen::VectorXd unit = Eigen::VectorXd::Ones(states);
  unit(kRate) = unit(kDeflectionRate) = fastest;
  if (states == TwoMassAxis::kStates) unit(kIntegral) = fastest * fastest;
  return unit;
}

}  // namespace

template <class S>
TwoMassEquationsOf<S> two_mass_equations(const LoopOf<S>& loop,
                                         const TwoMassParametersOf<S>& parameters) {
  const bool integrates = loop.order == 3, by_load = parameters.encoders == Encoders::kLoad;
  const auto [by_loop, by_motor] = position_gain_of(loop, parameters);
  const S& share = parameters.load_share;
  TwoMassEquationsOf<S> out;
  out.states = integrates ? 5 : 4;
  const auto n = static_cast<std::size_t>(out.states);
  // The demand by the states; the motor's acceleration is (demand - c - d1) / (1 - share).
  typename TwoMassEquationsOf<S>::State demand{}, contact{};
  demand[kError] = by_motor + by_loop;
  demand[kRate] = loop.denominator[0];
  demand[kDeflection] = by_loop;
  if (integrates) demand[kIntegral] = 1.0;
  contact[kDeflection] = share * parameters.omega * parameters.omega;
  contact[kDeflectionRate] = share * 2.0 * parameters.zeta * parameters.omega;
  out.by_state[kError][kRate] = 1.0;
  out.by_state[kDeflection][kDeflectionRate] = 1.0;
  for (std::size_t i = 0; i < n; ++i) {
    const S motor = (demand[i] - contact[i]) / (1.0 - share);
    const S load = contact[i] / share;
    out.by_state[kRate][i] = -motor;
    out.by_state[kDeflectionRate][i] = motor - load;
  }
  if (integrates) {
    out.by_state[kIntegral][kError] = loop.denominator[2];
    if (by_load) out.by_state[kIntegral][kDeflection] = loop.denominator[2];
  }
  const S light = 1.0 / (1.0 - share);
  const S command_acceleration = 1.0 - loop.numerator[0], command_velocity = -loop.numerator[1];
  out.by_velocity[kRate] = -light * command_velocity;
  out.by_velocity[kDeflectionRate] = light * command_velocity;
  if (integrates) out.by_velocity[kIntegral] = -loop.numerator[2];
  out.by_acceleration[kRate] = 1.0 - light * command_acceleration;
  out.by_acceleration[kDeflectionRate] = light * command_acceleration;
  out.by_motor_force[kRate] = light;
  out.by_motor_force[kDeflectionRate] = -light;
  out.by_load_force[kDeflectionRate] = 1.0 / share;
  return out;
}

bool stable(const Loop& loop, const TwoMassParameters& parameters) {
  const TwoMassEquations equations = two_mass_equations(loop, parameters);
  const Eigen::Index n = equations.states;
  Eigen::MatrixXd a(n, n);
  for (Eigen::Index r = 0; r < n; ++r) {
    for (Eigen::Index c = 0; c < n; ++c)
      a(r, c) = equations.by_state[static_cast<std::size_t>(r)][static_cast<std::size_t>(c)];
  }
  const Eigen::VectorXd unit = units_of(n, fastest_of(loop, parameters));
  const Eigen::VectorXcd roots =
      eigenvalues(unit.cwiseInverse().asDiagonal() * a * unit.asDiagonal());
  return (roots.real().array() < 0.0).all();
}

template <class S>
void TwoMassAxisOf<S>::discretise(const LoopOf<S>& loop, const TwoMassParametersOf<S>& parameters,
                                  double step_s) {
  const bool integrates = loop.order == 3;
  states_ = integrates ? 5 : 4;
  parameters_ = parameters;
  denominator_ = loop.denominator;
  numerator_ = loop.numerator;
  gain_ = position_gain_of(loop, parameters);
  integral_ = integrates ? denominator_[2] : S(0.0);
  integral_velocity_ = integrates ? numerator_[2] : S(0.0);
  command_acceleration_ = 1.0 - numerator_[0];
  command_velocity_ = -numerator_[1];

  const TwoMassEquationsOf<S> equations = two_mass_equations(loop, parameters);
  const double fastest = fastest_of(loop, parameters);
  const Eigen::VectorXd unit = units_of(states_, fastest), one_over = unit.cwiseInverse();
  const auto square = [&](const Eigen::MatrixXd& x) -> Eigen::MatrixXd {
    return one_over.asDiagonal() * x * unit.asDiagonal();
  };
  const auto column = [&](const Eigen::VectorXd& x) -> Eigen::VectorXd {
    return one_over.asDiagonal() * x;
  };
  const auto in_units = [&](Hold hold) {
    hold.phi = unit.asDiagonal() * hold.phi * one_over.asDiagonal();
    hold.g = unit.asDiagonal() * hold.g;
    return hold;
  };
  const auto hold = [&](const State& b, int m) {
    return hold_of<S, kStates>(
        states_, equations.by_state, b,
        [&](const Eigen::MatrixXd& system, const Eigen::VectorXd& input) {
          return in_units(discretise_alike(square(system), column(input), step_s, m, fastest));
        },
        [&](const Eigen::MatrixXd& system, const Eigen::VectorXd& input, const Eigen::MatrixXd& da,
            const Eigen::VectorXd& db) {
          return in_units(discretise_alike_derivative(square(system), column(input), square(da),
                                                      column(db), step_s, m, fastest));
        });
  };
  const auto by_velocity = hold(equations.by_velocity, 2),
             by_acceleration = hold(equations.by_acceleration, 1),
             by_motor = hold(equations.by_motor_force, 1),
             by_load = hold(equations.by_load_force, 1);
  for (std::size_t at = 0; at < static_cast<std::size_t>(states_); ++at) {
    for (std::size_t c = 0; c < static_cast<std::size_t>(states_); ++c)
      step_.phi[at][c] = by_velocity.phi[at][c];
    step_.command[at] = {by_velocity.g[at][0], by_velocity.g[at][1] + by_acceleration.g[at][0],
                         by_velocity.g[at][2] + by_acceleration.g[at][1]};
    step_.motor_end[at] = by_motor.g[at][1] / step_s;
    step_.motor_begin[at] = by_motor.g[at][0] - step_.motor_end[at];
    step_.load_end[at] = by_load.g[at][1] / step_s;
    step_.load_begin[at] = by_load.g[at][0] - step_.load_end[at];
  }
  for (std::size_t r = 0; r < kStates; ++r) {
    for (const auto& some :
         {step_.phi[r], step_.motor_begin, step_.motor_end, step_.load_begin, step_.load_end}) {
      for (const S& x : some) lanes_ = lanes_with(x, lanes_);
    }
    for (const S& x : step_.command[r]) lanes_ = lanes_with(x, lanes_);
  }
}

template <class S>
typename TwoMassAxisOf<S>::State TwoMassAxisOf<S>::at_rest(const Forces& forces) const noexcept {
  State out{};
  const S stiffness = parameters_.load_share * parameters_.omega * parameters_.omega;
  out[kDeflection] = forces.load / stiffness;
  if (parameters_.width > 0.0 && forces.load != 0.0)
    out[kDeflection] += (forces.load > 0.0 ? 0.5 : -0.5) * parameters_.width;
  const S held = forces.motor + forces.load;
  const bool integrates = states_ == kStates;
  // With an integrator the loop has no error at rest; without one its error demands the force.
  const S loop_error = integrates ? S(0.0) : held / denominator_[1];
  const bool by_load = parameters_.encoders == Encoders::kLoad;
  out[kError] = loop_error - (by_load ? out[kDeflection] : S(0.0));
  if (integrates) out[kIntegral] = held - gain_.by_motor * out[kError];
  return out;
}

template <class S>
typename TwoMassAxisOf<S>::State TwoMassAxisOf<S>::free(const State& from,
                                                        const CommandPieceOf<S>& piece,
                                                        const Forces& begin) const noexcept {
  State out{};
  const auto count = static_cast<std::size_t>(states_);
  for (std::size_t r = 0; r < count; ++r) {
    S sum = step_.command[r][0] * piece.velocity;
    add(sum, step_.command[r][1], piece.acceleration);
    add(sum, step_.command[r][2], piece.jerk);
    add(sum, step_.motor_begin[r], begin.motor);
    add(sum, step_.load_begin[r], begin.load);
    for (std::size_t c = 0; c < count; ++c) add(sum, step_.phi[r][c], from[c]);
    out[r] = sum;
  }
  return out;
}

template <class S>
typename TwoMassAxisOf<S>::State TwoMassAxisOf<S>::with(const State& free,
                                                        const Forces& end) const noexcept {
  State out = free;
  for (std::size_t r = 0; r < static_cast<std::size_t>(states_); ++r) {
    S both = step_.motor_end[r] * end.motor;
    add(both, step_.load_end[r], end.load);
    out[r] += both;
  }
  return out;
}

template <class S>
typename TwoMassAxisOf<S>::Ends TwoMassAxisOf<S>::ends_of(const State& state,
                                                          const CommandPieceOf<S>& piece,
                                                          const Forces& end) const noexcept {
  Ends out;
  const bool by_load = parameters_.encoders == Encoders::kLoad;
  out.motor_position = piece.end_position - state[kError];
  out.motor_velocity = piece.end_velocity - state[kRate];
  out.load_position = out.motor_position - state[kDeflection];
  out.load_velocity = out.motor_velocity - state[kDeflectionRate];
  out.loop_error = state[kError] + (by_load ? state[kDeflection] : S(0.0));
  out.loop_rate = state[kRate];
  out.recorded_error =
      state[kError] + (parameters_.encoders == Encoders::kMotor ? S(0.0) : state[kDeflection]);
  out.demand = command_acceleration_ * piece.end_acceleration +
               command_velocity_ * piece.end_velocity + denominator_[0] * state[kRate] +
               gain_.by_motor * state[kError] +
               gain_.by_loop * (state[kError] + state[kDeflection]) +
               (states_ == kStates ? state[kIntegral] : S(0.0));
  if (states_ == kStates)
    out.demand_rate = integral_ * out.loop_error - integral_velocity_ * piece.end_velocity;
  const S contact =
      parameters_.load_share * parameters_.omega *
      (parameters_.omega * state[kDeflection] + 2.0 * parameters_.zeta * state[kDeflectionRate]);
  out.motor_acceleration = (out.demand - contact - end.motor) / (1.0 - parameters_.load_share);
  out.load_acceleration = (contact - end.load) / parameters_.load_share;
  return out;
}

template <class S>
S TwoMassAxisOf<S>::missing_contact(const S& deflection, const S& rate) const noexcept {
  const S half = 0.5 * parameters_.width;
  if (half == 0.0) return 0.0;
  const S scale = parameters_.load_share * parameters_.omega;
  S linear = scale * (parameters_.omega * deflection + 2.0 * parameters_.zeta * rate);
  const S beyond = deflection - std::clamp<S>(deflection, -half, half);
  if (beyond == 0.0) return linear;
  const S contact = scale * (parameters_.omega * beyond + 2.0 * parameters_.zeta * rate);
  return linear - (beyond > 0.0 ? std::max<S>(0.0, contact) : std::min<S>(0.0, contact));
}

template TwoMassEquationsOf<double> two_mass_equations(const Loop&, const TwoMassParameters&);
template TwoMassEquationsOf<TwinDual> two_mass_equations(const LoopOf<TwinDual>&,
                                                         const TwoMassParametersOf<TwinDual>&);
template TwoMassEquationsOf<DriveDual> two_mass_equations(const LoopOf<DriveDual>&,
                                                          const TwoMassParametersOf<DriveDual>&);
template class TwoMassAxisOf<double>;
template class TwoMassAxisOf<TwinDual>;
template class TwoMassAxisOf<DriveDual>;

}  // namespace servotwin
