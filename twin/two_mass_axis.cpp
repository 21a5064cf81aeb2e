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

/// a2 in two parts: by the position of the loop's encoder, and by the motor's.
template <class S>
struct Stiffness {
  S by_loop = 0.0, by_motor = 0.0;
};
template <class S>
Stiffness<S> stiffness_of(const LoopOf<S>& loop, const TwoMassParametersOf<S>& parameters) {
  const S &a1 = loop.denominator[0], &a2 = loop.denominator[1];
  if (parameters.encoders != Encoders::kLoad) return {0.0, a2};
  const S by_motor = loop.order == 3 ? std::min<S>(a1 * parameters.reset, a2) : S(0.0);
  return {a2 - by_motor, by_motor};
}

template <class S>
using Dynamics = SquareOf<S, TwoMassAxis::kStates>;

/// d state / dt by the state.
template <class S>
Dynamics<S> dynamics_of(const LoopOf<S>& loop, const TwoMassParametersOf<S>& parameters) {
  const bool integrates = loop.order == 3, by_load = parameters.encoders == Encoders::kLoad;
  const auto [by_loop, by_motor] = stiffness_of(loop, parameters);
  const S& share = parameters.load_share;
  const std::size_t n = integrates ? 5 : 4;
  // The demand by the states; the motor's acceleration is (demand - c - d1) / (1 - share).
  std::array<S, TwoMassAxis::kStates> demand{}, contact{};
  demand[kError] = by_motor + by_loop;
  demand[kRate] = loop.denominator[0];
  demand[kDeflection] = by_loop;
  if (integrates) demand[kIntegral] = 1.0;
  contact[kDeflection] = share * parameters.omega * parameters.omega;
  contact[kDeflectionRate] = share * 2.0 * parameters.zeta * parameters.omega;
  Dynamics<S> a{};
  a[kError][kRate] = 1.0;
  a[kDeflection][kDeflectionRate] = 1.0;
  for (std::size_t i = 0; i < n; ++i) {
    const S motor = (demand[i] - contact[i]) / (1.0 - share);
    const S load = contact[i] / share;
    a[kRate][i] = -motor;
    a[kDeflectionRate][i] = motor - load;
  }
  if (integrates) {
    a[kIntegral][kError] = loop.denominator[2];
    if (by_load) a[kIntegral][kDeflection] = loop.denominator[2];
  }
  return a;
}

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

bool stable(const Loop& loop, const TwoMassParameters& parameters) {
  const Dynamics<double> dynamics = dynamics_of(loop, parameters);
  const Eigen::Index n = loop.order == 3 ? 5 : 4;
  Eigen::MatrixXd a(n, n);
  for (Eigen::Index r = 0; r < n; ++r) {
    for (Eigen::Index c = 0; c < n; ++c)
      a(r, c) = dynamics[static_cast<std::size_t>(r)][static_cast<std::size_t>(c)];
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
  by_loop_ = stiffness_of(loop, parameters).by_loop;
  by_motor_ = stiffness_of(loop, parameters).by_motor;
  integral_ = integrates ? denominator_[2] : S(0.0);
  integral_velocity_ = integrates ? numerator_[2] : S(0.0);
  command_acceleration_ = 1.0 - numerator_[0];
  command_velocity_ = -numerator_[1];

  const Dynamics<S> a = dynamics_of(loop, parameters);
  State velocity{}, acceleration{}, on_motor{}, on_load{};
  const S light = 1.0 / (1.0 - parameters.load_share);
  velocity[kRate] = -light * command_velocity_;
  velocity[kDeflectionRate] = light * command_velocity_;
  if (integrates) velocity[kIntegral] = -integral_velocity_;
  acceleration[kRate] = 1.0 - light * command_acceleration_;
  acceleration[kDeflectionRate] = light * command_acceleration_;
  on_motor[kRate] = light;
  on_motor[kDeflectionRate] = -light;
  on_load[kDeflectionRate] = 1.0 / parameters.load_share;

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
        states_, a, b,
        [&](const Eigen::MatrixXd& system, const Eigen::VectorXd& input) {
          return in_units(discretise_alike(square(system), column(input), step_s, m, fastest));
        },
        [&](const Eigen::MatrixXd& system, const Eigen::VectorXd& input, const Eigen::MatrixXd& da,
            const Eigen::VectorXd& db) {
          return in_units(discretise_alike_derivative(square(system), column(input), square(da),
                                                      column(db), step_s, m, fastest));
        });
  };
  const auto by_velocity = hold(velocity, 2), by_acceleration = hold(acceleration, 1),
             by_motor = hold(on_motor, 1), by_force = hold(on_load, 1);
  for (std::size_t at = 0; at < static_cast<std::size_t>(states_); ++at) {
    for (std::size_t c = 0; c < static_cast<std::size_t>(states_); ++c)
      phi_[at][c] = by_velocity.phi[at][c];
    command_[at] = {by_velocity.g[at][0], by_velocity.g[at][1] + by_acceleration.g[at][0],
                    by_velocity.g[at][2] + by_acceleration.g[at][1]};
    motor_end_[at] = by_motor.g[at][1] / step_s;
    motor_begin_[at] = by_motor.g[at][0] - motor_end_[at];
    load_end_[at] = by_force.g[at][1] / step_s;
    load_begin_[at] = by_force.g[at][0] - load_end_[at];
  }
  for (std::size_t r = 0; r < kStates; ++r) {
    for (const auto& some : {phi_[r], motor_begin_, motor_end_, load_begin_, load_end_}) {
      for (const S& x : some) lanes_ = lanes_with(x, lanes_);
    }
    for (const S& x : command_[r]) lanes_ = lanes_with(x, lanes_);
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
  if (integrates) out[kIntegral] = held - by_motor_ * out[kError];
  return out;
}

template <class S>
typename TwoMassAxisOf<S>::State TwoMassAxisOf<S>::free(const State& from,
                                                        const CommandPieceOf<S>& piece,
                                                        const Forces& begin) const noexcept {
  State out{};
  const auto count = static_cast<std::size_t>(states_);
  for (std::size_t r = 0; r < count; ++r) {
    S sum = command_[r][0] * piece.velocity;
    add(sum, command_[r][1], piece.acceleration);
    add(sum, command_[r][2], piece.jerk);
    add(sum, motor_begin_[r], begin.motor);
    add(sum, load_begin_[r], begin.load);
    for (std::size_t c = 0; c < count; ++c) add(sum, phi_[r][c], from[c]);
    out[r] = sum;
  }
  return out;
}

template <class S>
typename TwoMassAxisOf<S>::State TwoMassAxisOf<S>::with(const State& free,
                                                        const Forces& end) const noexcept {
  State out = free;
  for (std::size_t r = 0; r < static_cast<std::size_t>(states_); ++r) {
    S both = motor_end_[r] * end.motor;
    add(both, load_end_[r], end.load);
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
               by_motor_ * state[kError] + by_loop_ * (state[kError] + state[kDeflection]) +
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

template class TwoMassAxisOf<double>;
template class TwoMassAxisOf<TwinDual>;

}  // namespace servotwin
