#include "twin/two_mass_axis.h"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <numbers>

#include "twin/hold.h"
#include "twin/linear_algebra.h"
#include "twin/twin.h"

namespace servotwin {

namespace {

// Places of the state.
constexpr int kError = 0, kRate = 1, kDeflection = 2, kDeflectionRate = 3, kIntegral = 4;

}  // namespace

const Effect* two_mass_of(const Model& model) {
  for (const Effect& effect : model.effects) {
    if (acts_on_axis(effect.kind)) return &effect;
  }
  return nullptr;
}

TwoMassParameters two_mass_parameters(const Effect& effect) {
  TwoMassParameters out;
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

Effect without_play(const Effect& effect) {
  Effect out = effect;
  visit_effect(effect.kind, [&]<class E, std::size_t>() {
    if constexpr (E::kIdentity.acts == Acts::kAxis)
      out.kind = kind_of<TwoMass<E::kEncoders, false>>();
  });
  return out;
}

namespace {

/// a2 in two parts: by the position of the loop's encoder, and by the motor's.
struct Stiffness {
  double by_loop = 0.0, by_motor = 0.0;
};
Stiffness stiffness_of(const Loop& loop, const TwoMassParameters& parameters) {
  const double a1 = loop.denominator[0], a2 = loop.denominator[1];
  if (parameters.encoders != Encoders::kLoad) return {0.0, a2};
  const double by_motor = loop.order == 3 ? std::min(a1 * parameters.reset, a2) : 0.0;
  return {a2 - by_motor, by_motor};
}

/// d state / dt by the state.
Eigen::MatrixXd dynamics_of(const Loop& loop, const TwoMassParameters& parameters) {
  const bool integrates = loop.order == 3, by_load = parameters.encoders == Encoders::kLoad;
  const auto [by_loop, by_motor] = stiffness_of(loop, parameters);
  const double share = parameters.load_share;
  const Eigen::Index n = integrates ? 5 : 4;
  // The demand by the states; the motor's acceleration is (demand - c - d1) / (1 - share).
  Eigen::RowVectorXd demand = Eigen::RowVectorXd::Zero(n), contact = demand;
  demand(kError) = by_motor + by_loop;
  demand(kRate) = loop.denominator[0];
  demand(kDeflection) = by_loop;
  if (integrates) demand(kIntegral) = 1.0;
  contact(kDeflection) = share * parameters.omega * parameters.omega;
  contact(kDeflectionRate) = share * 2.0 * parameters.zeta * parameters.omega;
  const Eigen::RowVectorXd motor = (demand - contact) / (1.0 - share);
  const Eigen::RowVectorXd load = contact / share;
  Eigen::MatrixXd a = Eigen::MatrixXd::Zero(n, n);
  a(kError, kRate) = 1.0;
  a.row(kRate) = -motor;
  a(kDeflection, kDeflectionRate) = 1.0;
  a.row(kDeflectionRate) = motor - load;
  if (integrates) {
    a(kIntegral, kError) = loop.denominator[2];
    if (by_load) a(kIntegral, kDeflection) = loop.denominator[2];
  }
  return a;
}

/// Units in which all states are of one size: rates by the fastest frequency, the integral by its
/// square.
double fastest_of(const Loop& loop, const TwoMassParameters& parameters) {
  return std::max(
      {parameters.omega, loop.denominator[0], std::sqrt(std::abs(loop.denominator[1]))});
}
Eigen::VectorXd units_of(Eigen::Index states, double fastest) {
  Eigen::VectorXd unit = Eigen::VectorXd::Ones(states);
  unit(kRate) = unit(kDeflectionRate) = fastest;
  if (states > kIntegral) unit(kIntegral) = fastest * fastest;
  return unit;
}

}  // namespace

bool stable(const Loop& loop, const TwoMassParameters& parameters) {
  const Eigen::MatrixXd a = dynamics_of(loop, parameters);
  const Eigen::VectorXd unit = units_of(a.rows(), fastest_of(loop, parameters));
  const Eigen::VectorXcd roots =
      eigenvalues(unit.cwiseInverse().asDiagonal() * a * unit.asDiagonal());
  return (roots.real().array() < 0.0).all();
}

void TwoMassAxis::discretise(const Loop& loop, const TwoMassParameters& parameters, double step_s) {
  const bool integrates = loop.order == 3;
  states_ = integrates ? 5 : 4;
  parameters_ = parameters;
  denominator_ = loop.denominator;
  numerator_ = loop.numerator;
  by_loop_ = stiffness_of(loop, parameters).by_loop;
  by_motor_ = stiffness_of(loop, parameters).by_motor;
  integral_ = integrates ? denominator_[2] : 0.0;
  integral_velocity_ = integrates ? numerator_[2] : 0.0;
  command_acceleration_ = 1.0 - numerator_[0];
  command_velocity_ = -numerator_[1];

  const Eigen::MatrixXd a = dynamics_of(loop, parameters);
  const Eigen::Index n = states_;
  Eigen::VectorXd velocity = Eigen::VectorXd::Zero(n), acceleration = velocity, on_motor = velocity,
                  on_load = velocity;
  const double light = 1.0 / (1.0 - parameters.load_share);
  velocity(kRate) = -light * command_velocity_;
  velocity(kDeflectionRate) = light * command_velocity_;
  if (integrates) velocity(kIntegral) = -integral_velocity_;
  acceleration(kRate) = 1.0 - light * command_acceleration_;
  acceleration(kDeflectionRate) = light * command_acceleration_;
  on_motor(kRate) = light;
  on_motor(kDeflectionRate) = -light;
  on_load(kDeflectionRate) = 1.0 / parameters.load_share;

  const double fastest = fastest_of(loop, parameters);
  const Eigen::VectorXd unit = units_of(n, fastest);
  const auto hold = [&](const Eigen::VectorXd& b, int m) {
    Hold out = discretise_alike(unit.cwiseInverse().asDiagonal() * a * unit.asDiagonal(),
                                unit.cwiseInverse().asDiagonal() * b, step_s, m, fastest);
    out.phi = unit.asDiagonal() * out.phi * unit.cwiseInverse().asDiagonal();
    out.g = unit.asDiagonal() * out.g;
    return out;
  };
  const Hold by_velocity = hold(velocity, 2), by_acceleration = hold(acceleration, 1),
             by_motor = hold(on_motor, 1), by_force = hold(on_load, 1);
  for (int r = 0; r < states_; ++r) {
    const auto at = static_cast<std::size_t>(r);
    for (int c = 0; c < states_; ++c) phi_[at][static_cast<std::size_t>(c)] = by_velocity.phi(r, c);
    command_[at] = {by_velocity.g(r, 0), by_velocity.g(r, 1) + by_acceleration.g(r, 0),
                    by_velocity.g(r, 2) + by_acceleration.g(r, 1)};
    motor_end_[at] = by_motor.g(r, 1) / step_s;
    motor_begin_[at] = by_motor.g(r, 0) - motor_end_[at];
    load_end_[at] = by_force.g(r, 1) / step_s;
    load_begin_[at] = by_force.g(r, 0) - load_end_[at];
  }
}

TwoMassAxis::State TwoMassAxis::at_rest(const Forces& forces) const noexcept {
  State out{};
  const double stiffness = parameters_.load_share * parameters_.omega * parameters_.omega;
  out[kDeflection] = forces.load / stiffness;
  if (parameters_.width > 0.0 && forces.load != 0.0)
    out[kDeflection] += std::copysign(0.5 * parameters_.width, forces.load);
  const double held = forces.motor + forces.load;
  const bool integrates = states_ == kStates;
  // With an integrator the loop has no error at rest; without one its error demands the force.
  const double loop_error = integrates ? 0.0 : held / denominator_[1];
  const bool by_load = parameters_.encoders == Encoders::kLoad;
  out[kError] = loop_error - (by_load ? out[kDeflection] : 0.0);
  if (integrates) out[kIntegral] = held - by_motor_ * out[kError];
  return out;
}

TwoMassAxis::State TwoMassAxis::free(const State& from, const CommandPiece& piece,
                                     const Forces& begin) const noexcept {
  State out{};
  const auto count = static_cast<std::size_t>(states_);
  for (std::size_t r = 0; r < count; ++r) {
    double sum = command_[r][0] * piece.velocity + command_[r][1] * piece.acceleration +
                 command_[r][2] * piece.jerk + motor_begin_[r] * begin.motor +
                 load_begin_[r] * begin.load;
    for (std::size_t c = 0; c < count; ++c) sum += phi_[r][c] * from[c];
    out[r] = sum;
  }
  return out;
}

TwoMassAxis::State TwoMassAxis::with(const State& free, const Forces& end) const noexcept {
  State out = free;
  for (std::size_t r = 0; r < static_cast<std::size_t>(states_); ++r)
    out[r] += motor_end_[r] * end.motor + load_end_[r] * end.load;
  return out;
}

TwoMassAxis::Ends TwoMassAxis::ends_of(const State& state, const CommandPiece& piece,
                                       const Forces& end) const noexcept {
  Ends out;
  const bool by_load = parameters_.encoders == Encoders::kLoad;
  out.motor_position = piece.end_position - state[kError];
  out.motor_velocity = piece.end_velocity - state[kRate];
  out.load_position = out.motor_position - state[kDeflection];
  out.load_velocity = out.motor_velocity - state[kDeflectionRate];
  out.loop_error = state[kError] + (by_load ? state[kDeflection] : 0.0);
  out.loop_rate = state[kRate];
  out.recorded_error =
      state[kError] + (parameters_.encoders == Encoders::kMotor ? 0.0 : state[kDeflection]);
  out.demand = command_acceleration_ * piece.end_acceleration +
               command_velocity_ * piece.end_velocity + denominator_[0] * state[kRate] +
               by_motor_ * state[kError] + by_loop_ * (state[kError] + state[kDeflection]) +
               (states_ == kStates ? state[kIntegral] : 0.0);
  if (states_ == kStates)
    out.demand_rate = integral_ * out.loop_error - integral_velocity_ * piece.end_velocity;
  const double contact =
      parameters_.load_share * parameters_.omega *
      (parameters_.omega * state[kDeflection] + 2.0 * parameters_.zeta * state[kDeflectionRate]);
  out.motor_acceleration = (out.demand - contact - end.motor) / (1.0 - parameters_.load_share);
  out.load_acceleration = (contact - end.load) / parameters_.load_share;
  return out;
}

double TwoMassAxis::missing_contact(double deflection, double rate) const noexcept {
  const double half = 0.5 * parameters_.width;
  if (half == 0.0) return 0.0;
  const double scale = parameters_.load_share * parameters_.omega;
  const double linear = scale * (parameters_.omega * deflection + 2.0 * parameters_.zeta * rate);
  const double beyond = deflection - std::clamp(deflection, -half, half);
  if (beyond == 0.0) return linear;
  const double contact = scale * (parameters_.omega * beyond + 2.0 * parameters_.zeta * rate);
  return linear - (beyond > 0.0 ? std::max(0.0, contact) : std::min(0.0, contact));
}

}  // namespace servotwin
