// A step of an axis of two masses: the forces on motor and load and that of the play.
#include <algorithm>
#include <cmath>

#include "twin/force_balance.h"
#include "twin/resolution.h"
#include "twin/twin.h"

namespace servotwin {

namespace {

/// Where forces on motor and load are not found together they are solved in turns, until a turn
/// changes them by less [m/s^2 | rad/s^2], or for so many turns: with a stiff spring and friction
/// on both not every step gets there; what is missing then is far below the friction.
constexpr double kSmallestTurn = 1e-11;
/// Found together they miss by no more than this [m/s^2 | rad/s^2]: some times the rounding.
constexpr double kLargestMiss = 1e-13;
/// A step that ends on the edge of a gap misses its contact's force by more than this share of what
/// the spring has over the gap, and the edge by less than this share of the gap.
constexpr double kEdgeTolerance = 1e-6;
constexpr int kMostTurns = 12;

/// The deflection beyond the nearer edge of a gap. There the contact's damper sets in at once, and
/// a step may end on the edge with any part of its force.
template <class S>
S beyond_edge(const typename TwoMassAxisOf<S>::State& state, const S& width) noexcept {
  const S& deflection = state[2];
  return deflection - (deflection > 0.0 ? 0.5 : -0.5) * width;
}

}  // namespace

template <class S>
void TwinOf<S>::balance_two_masses(const typename TwoMassAxisOf<S>::State& free,
                                   const CommandPieceOf<S>& piece, MotionOf<S>& motor,
                                   MotionOf<S>& load) noexcept {
  using Forces = typename TwoMassAxisOf<S>::Forces;
  const auto ends = [&] {
    const Forces end{force_ - contact_, load_force_ + contact_};
    return axis_.ends_of(axis_.with(free, end), piece, end);
  };
  const auto set = [&](const typename TwoMassAxisOf<S>::Ends& now, Body body, MotionOf<S>& m) {
    const bool on_load = body == Body::kLoad;
    m.position = on_load ? now.load_position : now.motor_position;
    m.velocity = on_load ? now.load_velocity : now.motor_velocity;
    m.acceleration = on_load ? now.load_acceleration : now.motor_acceleration;
    m.displacement = m.position - (on_load ? load_position_ : motor_position_);
    m.tracking_error = now.loop_error;
    m.demand = now.demand;
    if (linear_.order == 3) {
      m.demand_rate = now.demand_rate;
      m.demand_damping = linear_.damping * now.loop_rate;
    }
  };
  const bool plays = axis_.parameters().width > 0.0;
  if constexpr (is_dual<S>) {
    force_ = unknown(leader_.force_, kMotorLane);
    load_force_ = unknown(leader_.load_force_, kLoadLane);
    contact_ = unknown(leader_.contact_, kContactLane);
    const Forces all{force_ - contact_, load_force_ + contact_};
    const typename TwoMassAxisOf<S>::State state = axis_.with(free, all);
    const typename TwoMassAxisOf<S>::Ends now = axis_.ends_of(state, piece, all);
    set(now, Body::kMotor, motor);
    set(now, Body::kLoad, load);
    S contact_miss = plays ? contact_ - axis_.missing_contact(state) : contact_;
    if (plays) {
      const TwoMassParametersOf<S>& gap = axis_.parameters();
      const S beyond = beyond_edge<S>(state, gap.width);
      const double force = value_of(gap.load_share * gap.omega * gap.omega * gap.width);
      if (std::abs(contact_miss.value) > kEdgeTolerance * force &&
          std::abs(beyond.value) < kEdgeTolerance * gap.width.value)
        contact_miss = beyond;
    }
    const Resolution resolve({force_ - disturbance(motor, memory_, Body::kMotor),
                              load_force_ - disturbance(load, memory_, Body::kLoad), contact_miss});
    for (S* x : {&force_, &load_force_, &contact_}) resolve(*x);
    resolve_motion(resolve, motor);
    resolve_motion(resolve, load);
    for (const Body body : {Body::kMotor, Body::kLoad}) resolve_memories(resolve, body);
  } else {
    const auto miss_of = [&](Body body, MotionOf<S>& m, S& force) {
      return [&, body](const S& trial) -> S {
        force = trial;
        set(ends(), body, m);
        return trial - disturbance(m, tried(body), body);
      };
    };
    const auto end = bodies_.begin() + effect_count_;
    const bool motor_feels = std::find(bodies_.begin(), end, Body::kMotor) != end;
    const auto balance_contact = [&] {
      if (!plays) return;
      contact_ = balanced(contact_, contact_slope_, [&](double trial) {
        contact_ = trial;
        return trial -
               axis_.missing_contact(axis_.with(free, {force_ - trial, load_force_ + trial}));
      });
    };
    if (plays || motor_feels) {
      const std::array before{force_, load_force_, contact_};
      const bool found =
          balanced(ForcePair{force_, load_force_}, together_, kLargestMiss,
                   [&](const ForcePair& trial) -> ForcePair {
                     force_ = trial[0], load_force_ = trial[1];
                     balance_contact();
                     const typename TwoMassAxisOf<S>::Ends now = ends();
                     set(now, Body::kMotor, motor);
                     set(now, Body::kLoad, load);
                     return {force_ - disturbance(motor, tried(Body::kMotor), Body::kMotor),
                             load_force_ - disturbance(load, tried(Body::kLoad), Body::kLoad)};
                   });
      if (found) return;
      together_ = kApart;
      force_ = before[0], load_force_ = before[1], contact_ = before[2];
    }
    for (int turn = 0; turn < kMostTurns; ++turn) {
      const double motor_before = force_, contact_before = contact_;
      balance_contact();
      load_force_ = balanced(load_force_, load_slope_, miss_of(Body::kLoad, load, load_force_));
      force_ = balanced(force_, slope_, miss_of(Body::kMotor, motor, force_));
      if (!plays && !motor_feels) break;
      if (std::abs(force_ - motor_before) <= kSmallestTurn &&
          std::abs(contact_ - contact_before) <= kSmallestTurn)
        break;
    }
  }
}

template <class S>
void TwinOf<S>::start_two_masses(const S& command) noexcept {
  force_ = load_force_ = contact_ = 0.0;
  load_force_change_ = 0.0;
  load_slope_ = contact_slope_ = 1.0;
  together_ = kApart;
  CommandPieceOf<S> still;
  still.end_position = command;
  MotionOf<S> rest;
  rest.step_s = h_;
  rest.time_s = time_s_;
  // A standing loop holds whatever forces act at rest; they may depend on where it stands.
  for (int turn = 0; turn < kMostTurns; ++turn) {
    axis_state_ = axis_.at_rest({force_, load_force_});
    contact_ = axis_.missing_contact(axis_state_);
    const typename TwoMassAxisOf<S>::Ends now =
        axis_.ends_of(axis_state_, still, {force_ - contact_, load_force_ + contact_});
    motor_position_ = now.motor_position;
    load_position_ = now.load_position;
    position_ = command - now.recorded_error;
    demand_ = now.demand;
    const S motor_before = force_, load_before = load_force_;
    for (const Body body : {Body::kMotor, Body::kLoad}) {
      rest.position = body == Body::kLoad ? load_position_ : motor_position_;
      rest.tracking_error = now.loop_error;
      rest.demand = now.demand;
      copy_memories(memory_, trial_, body);
      (body == Body::kLoad ? load_force_ : force_) = disturbance(rest, trial_, body);
      if (body == Body::kMotor) of_control_ = rest.of_control;
    }
    // Derivatives settle later than values, which may be 0 from the start.
    if (!is_dual<S> && std::abs(value_of(force_ - motor_before)) <= kSmallestTurn &&
        std::abs(value_of(load_force_ - load_before)) <= kSmallestTurn)
      break;
  }
  for (const Body body : {Body::kMotor, Body::kLoad}) copy_memories(trial_, memory_, body);
  acceleration_ = 0.0;
  motor_velocity_ = 0.0;
  rest.position = position_;
  reading_ = read(rest);
}

template <class S>
S TwinOf<S>::advance_two_masses(const CommandPieceOf<S>& piece) noexcept {
  time_s_ += h_;
  const S motor_before = force_, load_before = load_force_;
  const typename TwoMassAxisOf<S>::State free =
      axis_.free(axis_state_, piece, {force_ - contact_, load_force_ + contact_});
  MotionOf<S> motor;
  motor.step_s = h_;
  motor.time_s = time_s_;
  motor.command_velocity = piece.end_velocity;
  motor.command_acceleration = piece.end_acceleration;
  motor.neighbour_acceleration = piece.neighbour_acceleration;
  motor.neighbour_motion_acceleration = piece.neighbour_motion_acceleration;
  motor.in_cut = piece.in_cut;
  MotionOf<S> load = motor;
  force_ += force_change_;
  load_force_ += load_force_change_;
  balance_two_masses(free, piece, motor, load);
  for (const Body body : {Body::kMotor, Body::kLoad}) keep_tried(body);
  const typename TwoMassAxisOf<S>::Forces end{force_ - contact_, load_force_ + contact_};
  axis_state_ = axis_.with(free, end);
  const typename TwoMassAxisOf<S>::Ends now = axis_.ends_of(axis_state_, piece, end);
  force_change_ = force_ - motor_before;
  load_force_change_ = load_force_ - load_before;
  motor_position_ = now.motor_position;
  motor_velocity_ = now.motor_velocity;
  load_position_ = now.load_position;
  demand_ = now.demand;
  of_control_ = motor.of_control;
  const bool at_load = axis_.parameters().encoders != Encoders::kMotor;
  position_ = at_load ? now.load_position : now.motor_position;
  velocity_ = at_load ? now.load_velocity : now.motor_velocity;
  acceleration_ = at_load ? now.load_acceleration : now.motor_acceleration;
  if (reading_count_ > 0) reading_ = read(at_load ? load : motor);
  return now.recorded_error - reading_;
}

template void TwinOf<double>::start_two_masses(const double& command) noexcept;
template void TwinOf<TwinDual>::start_two_masses(const TwinDual& command) noexcept;
template double TwinOf<double>::advance_two_masses(const CommandPiece& piece) noexcept;
template TwinDual TwinOf<TwinDual>::advance_two_masses(
    const CommandPieceOf<TwinDual>& piece) noexcept;

}  // namespace servotwin
