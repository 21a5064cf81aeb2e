#include "twin/twin.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <type_traits>
#include <utility>

#include "twin/catalogue_steps.h"
#include "twin/force_balance.h"
#include "twin/resolution.h"

namespace servotwin {

static_assert(std::is_trivially_copyable_v<Twin>, "a twin crosses threads by value");

namespace {

/// A force that jumps within a part is taken for linear there, which is wrong by up to half of it
/// over the part [s]. On a rigid axis a cycle is one part up to here, so that the least squares
/// problem, whose columns know the cycle only, and the simulation are one scheme.
constexpr double kLongestPart_s = 1e-3;

/// The same where something vibrates: friction that sticks is a spring that follows the vibration,
/// and is curved within a millisecond (docs/decisions/0029-vibrations-are-solved-in-parts.md).
constexpr double kLongestPartOfVibration_s = 0.25e-3;

/// With play the spring's force is not part of the linear system but taken for linear within a
/// part, so that a part is short against its period [rad].
constexpr double kLargestStepInPlay_rad = 0.5;

template <std::size_t N>
Model values_of(const ModelOf<Dual<N>>& model) {
  Model out = empty_like<double>(model);
  each_parameter(out, model, [](double& value, const Dual<N>& x) { value = x.value; });
  return out;
}

/// Whether the load has all friction and keeps it.
bool is_all(double share) { return share == 1.0; }
template <std::size_t N>
bool is_all(const Dual<N>& share) {
  return share.value == 1.0 &&
         std::all_of(share.by.begin(), share.by.end(), [](double by) { return by == 0.0; });
}

}  // namespace

template <class S>
TwinOf<S>::TwinOf(const ModelOf<S>& model) {
  if constexpr (is_dual<S>) {
    leader_ = Twin(values_of(model));
    LoopOf<S> loop = model.loop;
    each_parameter(loop, model.loop, [&](const S& /*same*/, const S& x) {
      constant_lanes_ = lanes_with(x, constant_lanes_);
    });
    command_lanes_ = lanes_with(model.command_delay_s(), constant_lanes_);
    // Modes that move are placed by the command, which the delay moves.
    if (std::any_of(loop.modes.begin(), loop.modes.end(),
                    [](const ModeOf<S>& mode) { return mode.moves(); }))
      constant_lanes_ = command_lanes_;
  } else if (auto why = why_invalid(model); !why.empty()) {
    throw std::invalid_argument(why);
  }
  const EffectOf<S>* two_mass = two_mass_of(model);
  const bool vibrates = two_mass != nullptr || !model.loop.modes.empty();
  double longest_part_s = vibrates ? kLongestPartOfVibration_s : kLongestPart_s;
  if (plays(model))
    longest_part_s = std::min(
        longest_part_s, kLargestStepInPlay_rad / value_of(two_mass_parameters(*two_mass).omega));
  const bool is_linear =
      std::all_of(model.effects.begin(), model.effects.end(), [](const EffectOf<S>& effect) {
        return identity_of(effect.kind).acts == Acts::kCommandDelay;
      });
  linear_.parts =
      is_linear ? 1 : static_cast<int>(std::ceil(model.sample_time_s / longest_part_s - 1e-9));
  cycle_s_ = model.sample_time_s;
  h_ = cycle_s_ / linear_.parts;
  delay_s_ = model.command_delay_s();
  linear_.order = model.loop.order;
  if (linear_.order == 3) {
    linear_.damping = model.loop.denominator[0];
    linear_.integral = model.loop.denominator[2];
    linear_.integral_velocity = model.loop.numerator[2];
  }
  discretise_loop(model.loop);
  // Effects that change friction use the force of the friction law.
  const auto place_of = [](const EffectOf<S>& effect) {
    if (is_friction_law(effect.kind)) return 0;
    return identity_of(effect.kind).acts == Acts::kForce ? 1 : 2;
  };
  if (two_mass != nullptr) axis_.discretise(model.loop, two_mass_parameters(*two_mass), h_);
  const S on_load = axis_.parameters().friction_share;
  for (const int place : {0, 1, 2}) {
    for (const EffectOf<S>& effect : model.effects) {
      if (!acts_along_motion(identity_of(effect.kind).acts) || place_of(effect) != place) continue;
      if (place == 2) {
        effects_[static_cast<std::size_t>(effect_count_) +
                 static_cast<std::size_t>(reading_count_++)] = effect;
      } else if (!axis_.used() || acts_on(effect.kind) == ActsOn::kMotor) {
        add_force(effect, Body::kMotor, 1.0);
      } else if (acts_on(effect.kind) == ActsOn::kLoad || is_all(on_load)) {
        add_force(effect, Body::kLoad, 1.0);
      } else {
        add_force(effect, Body::kMotor, 1.0 - on_load);
        add_force(effect, Body::kLoad, on_load);
      }
    }
  }
  start(0.0);
}

template <class S>
void TwinOf<S>::add_force(const EffectOf<S>& effect, Body body, const S& share) noexcept {
  const auto at = static_cast<std::size_t>(effect_count_++);
  effects_[at] = effect;
  bodies_[at] = body;
  if (is_all(share)) return;
  for (S& coefficient : effects_[at].coefficient) coefficient *= share;
}

template <class S>
S TwinOf<S>::value_at(const typename StepConstantsOf<S>::Reading& reading,
                      const typename StepConstantsOf<S>::State& w) const noexcept {
  S sum = 0.0;
  for (std::size_t i = 0; i < static_cast<std::size_t>(linear_.states); ++i)
    add(sum, reading.state[i], w[i], lanes_of(i));
  return sum;
}

template <class S>
template <class Miss, class Settle>
S TwinOf<S>::solved(const S& first, double known, const Miss& miss, const Settle& settle) noexcept {
  if constexpr (is_dual<S>) {
    S force = unknown(known, kMotorLane);
    const Resolution resolve(miss(force));
    resolve(force);
    settle(resolve);
    return force;
  } else {
    return balanced(first, slope_, miss);
  }
}

template <class S>
void TwinOf<S>::resolve_memories(const Resolution& resolve, Body body) noexcept {
  for (std::size_t i = 0; i < static_cast<std::size_t>(effect_count_); ++i) {
    if (bodies_[i] != body) continue;
    if constexpr (is_dual<S>) each_value<S>(effects_[i].kind, memory_[i], resolve);
  }
}

template <class S>
typename TwinOf<S>::Memories& TwinOf<S>::tried(Body body) noexcept {
  if constexpr (is_dual<S>) {
    return memory_;
  } else {
    copy_memories(memory_, trial_, body);
    return trial_;
  }
}

template <class S>
void TwinOf<S>::keep_tried(Body body) noexcept {
  if constexpr (!is_dual<S>) copy_memories(trial_, memory_, body);
}

template <class S>
void TwinOf<S>::start(const S& command, double time_s) noexcept {
  double known = 0.0;
  if constexpr (is_dual<S>) {
    leader_.start(command.value, time_s);
    known = leader_.force_;
  }
  time_s_ = time_s;
  force_change_ = 0.0;
  slope_ = 1.0;
  for (int i = 0; i < effect_count_ + reading_count_; ++i) {
    const auto k = static_cast<std::size_t>(i);
    start_memory<S>(effects_[k].kind, effects_[k].shape.data(), memory_[k]);
    trial_[k] = memory_[k];
  }
  history_.fill(value_of(command));
  velocity_ = 0.0;
  neighbour_acceleration_ = neighbour_motion_acceleration_ = 0.0;
  if (axis_.used()) return start_two_masses(command);
  if (moves_) place_modes(command, command);
  MotionOf<S> rest;
  rest.step_s = h_;
  rest.time_s = time_s;
  // A standing loop already holds whatever force acts at rest; without an integrator it does so
  // away from the command.
  const S give = linear_.order == 2 ? value_at(linear_.error, linear_.rest) : S(0.0);
  const auto miss_at = [&](const S& trial) -> S {
    rest.tracking_error = give * trial;
    rest.position = command - give * trial;
    rest.demand = trial;
    return trial - disturbance(rest, tried());
  };
  force_ = solved(S(0.0), known, miss_at, [&](const auto& resolve) {
    resolve_motion(resolve, rest);
    resolve_memories(resolve, Body::kMotor);
  });
  keep_tried();
  for (std::size_t r = 0; r < state_.size(); ++r) state_[r] = linear_.rest[r] * force_;
  demand_ = force_;
  of_control_ = rest.of_control;
  position_ = command - (linear_.order == 2 ? value_at(linear_.error, state_) : S(0.0));
  rest.position = position_;
  reading_ = read(rest);
}

template <class S>
void TwinOf<S>::start(const S& position, std::span<const S> free_response, double time_s) noexcept {
  start(position, time_s);
  if constexpr (is_dual<S>) {
    std::array<double, StepConstants::kStates> values{};
    const std::size_t count = std::min(free_response.size(), values.size());
    for (std::size_t i = 0; i < count; ++i) values[i] = free_response[i].value;
    leader_.start(position.value, std::span<const double>(values.data(), count), time_s);
  }
  if (axis_.used()) {
    for (std::size_t r = 0; r < std::min(free_response.size(), axis_state_.size()); ++r)
      axis_state_[r] += free_response[r];
    contact_ = axis_.missing_contact(axis_state_);
    CommandPieceOf<S> still;
    still.end_position = position;
    const typename TwoMassAxisOf<S>::Ends now =
        axis_.ends_of(axis_state_, still, {force_ - contact_, load_force_ + contact_});
    motor_position_ = now.motor_position;
    load_position_ = now.load_position;
    position_ = position - now.recorded_error;
    return;
  }
  const auto n = static_cast<std::size_t>(linear_.order),
             states = static_cast<std::size_t>(linear_.states);
  for (std::size_t r = 0; r < free_response.size() && n + r < states; ++r) {
    state_[n + r] += free_response[r];
    // A mode's second state is the rate of the first and 2 zeta omega times it.
    if (r >= n && (r - n) % 2 == 1)
      state_[n + r] -= linear_.rate.state[n + r - 1] * free_response[r - 1];
  }
  position_ = position - value_at(linear_.error, state_);
}

template <class S>
void TwinOf<S>::start_filters(const S& velocity, const S& acceleration) noexcept {
  if constexpr (is_dual<S>) leader_.start_filters(velocity.value, acceleration.value);
  MotionOf<S> motion;
  motion.velocity = velocity;
  for (std::size_t i = 0; i < static_cast<std::size_t>(effect_count_); ++i) {
    constexpr std::size_t kFilter = kind_of<ControlFilter>();
    if (effects_[i].kind != kFilter) continue;
    std::get<kFilter>(memory_[i])
        .settle(effects_[i].shape.data(), velocity, acceleration, motion.direction());
    trial_[i] = memory_[i];
  }
}

template <class S>
void TwinOf<S>::copy_memories(const Memories& from, Memories& to, Body body) const noexcept {
  for (std::size_t i = 0; i < static_cast<std::size_t>(effect_count_); ++i) {
    if (bodies_[i] == body) copy_memory<S>(effects_[i].kind, from[i], to[i]);
  }
}

template <class S>
S TwinOf<S>::disturbance(MotionOf<S>& m, Memories& memory, Body body) const noexcept {
  S sum = 0.0;
  m.friction = kNoLaw;
  m.of_control = 0.0;
  std::array<S, kMaxCoefficients> force;  // each effect fills its part
  for (std::size_t i = 0; i < static_cast<std::size_t>(effect_count_); ++i) {
    if (bodies_[i] != body) continue;
    const EffectOf<S>& effect = effects_[i];
    unit_forces<S>(effect.kind, effect.shape.data(), memory[i], m, force.data());
    const std::size_t count = coefficients_of(effect.kind).size();
    for (std::size_t k = 0; k < count; ++k) sum += effect.coefficient[k] * force[k];
    if (identity_of(effect.kind).of_control) {
      for (std::size_t k = 0; k < count; ++k) m.of_control += effect.coefficient[k] * force[k];
    }
    if (is_friction_law(effect.kind)) m.friction = friction_of(effect, force.data());
  }
  return sum;
}

template <class S>
S TwinOf<S>::read(const MotionOf<S>& m) noexcept {
  S sum = 0.0;
  std::array<S, kMaxCoefficients> unit{};
  for (int i = effect_count_; i < effect_count_ + reading_count_; ++i) {
    const auto k = static_cast<std::size_t>(i);
    unit_forces<S>(effects_[k].kind, effects_[k].shape.data(), memory_[k], m, unit.data());
    for (std::size_t c = 0; c < coefficients_of(effects_[k].kind).size(); ++c)
      sum += effects_[k].coefficient[c] * unit[c];
  }
  return sum;
}

template <class S>
S TwinOf<S>::step(const CommandPieceOf<S>& whole) noexcept {
  const double commanded_before =
      std::exchange(neighbour_acceleration_, whole.neighbour_acceleration);
  const double moving_before =
      std::exchange(neighbour_motion_acceleration_, whole.neighbour_motion_acceleration);
  if (linear_.parts == 1) return advance(whole);
  CommandPieceOf<S> part = whole;
  for (int i = 1; i < linear_.parts; ++i) {
    const double to_end = h_ * (linear_.parts - i);
    part.end_acceleration = whole.end_acceleration - to_end * whole.jerk;
    part.end_velocity =
        whole.end_velocity - to_end * (whole.end_acceleration - to_end * whole.jerk / 2);
    part.end_position = whole.end_position -
                        to_end * (whole.end_velocity -
                                  to_end * (whole.end_acceleration / 2 - to_end * whole.jerk / 6));
    const auto between = [&](double before, double after) {
      return before + (after - before) * i / linear_.parts;
    };
    part.neighbour_acceleration = between(commanded_before, whole.neighbour_acceleration);
    part.neighbour_motion_acceleration =
        between(moving_before, whole.neighbour_motion_acceleration);
    advance(part);
    part.velocity = part.end_velocity;
    part.acceleration = part.end_acceleration;
  }
  part.end_position = whole.end_position;
  part.end_velocity = whole.end_velocity;
  part.end_acceleration = whole.end_acceleration;
  part.neighbour_acceleration = whole.neighbour_acceleration;
  part.neighbour_motion_acceleration = whole.neighbour_motion_acceleration;
  return advance(part);
}

template <class S>
S TwinOf<S>::advance(const CommandPieceOf<S>& piece) noexcept {
  double known = 0.0;
  if constexpr (is_dual<S>) {
    leader_.advance({piece.velocity.value, piece.acceleration.value, piece.jerk.value,
                     piece.end_position.value, piece.end_velocity.value,
                     piece.end_acceleration.value, piece.neighbour_acceleration,
                     piece.neighbour_motion_acceleration, piece.in_cut});
    known = leader_.force_;
  }
  if (axis_.used()) return advance_two_masses(piece);
  if (moves_) place_modes(piece.end_position - 0.5 * h_ * piece.end_velocity, piece.end_position);
  const auto states = static_cast<std::size_t>(linear_.states);
  typename StepConstantsOf<S>::State next;
  for (std::size_t r = 0; r < states; ++r) {
    const auto& row = linear_.rows[r];
    const std::size_t lanes = lanes_of(r);
    S sum = row.command[0] * piece.velocity;
    add(sum, row.command[1], piece.acceleration, command_lanes_);
    add(sum, row.command[2], piece.jerk, command_lanes_);
    add(sum, row.force_begin, force_, lanes);
    for (std::size_t c = 0; c < static_cast<std::size_t>(row.width); ++c)
      add(sum, row.phi[c], state_[static_cast<std::size_t>(row.first) + c], lanes);
    next[r] = sum;
  }
  // The demand of the control: the acceleration x_r'' - e'' of a motor without disturbance and
  // without limit; the disturbance itself is not part of it (docs/theory.md 3.11).
  const S error_free = value_at(linear_.error, next);
  const S rate_free = value_at(linear_.rate, next) + linear_.rate.velocity * piece.end_velocity;
  const S demand_free = piece.end_acceleration - value_at(linear_.second, next) -
                        linear_.second.velocity * piece.end_velocity -
                        linear_.second.acceleration * piece.end_acceleration;
  const S demand_given = 1.0 - linear_.second.force - linear_.second.force_end;

  // The motion at the end of the step and the force there depend on each other
  // (docs/theory.md 2.3):
  //   f = d(x_free - gamma_x f, v_free - gamma_v f),  gammas > 0
  // d is bounded and continuous, so that there is a solution for any step; where d does not fall
  // with the motion it is the only one.
  const S position_free = piece.end_position - error_free;
  const S velocity_free = piece.end_velocity - rate_free;
  MotionOf<S> m;
  m.step_s = h_;
  m.command_velocity = piece.end_velocity;
  m.command_acceleration = piece.end_acceleration;
  m.neighbour_acceleration = piece.neighbour_acceleration;
  m.neighbour_motion_acceleration = piece.neighbour_motion_acceleration;
  m.in_cut = piece.in_cut;
  time_s_ += h_;
  m.time_s = time_s_;
  const auto miss_at = [&](const S& trial) -> S {
    m.position = position_free - linear_.error.force_end * trial;
    m.velocity = velocity_free - linear_.rate.force_end * trial;
    m.displacement = m.position - position_;
    m.tracking_error = piece.end_position - m.position;
    m.demand = demand_free + demand_given * trial;
    m.acceleration = m.demand - trial;
    if (linear_.order == 3) {
      m.demand_rate =
          linear_.integral * m.tracking_error - linear_.integral_velocity * piece.end_velocity;
      m.demand_damping = linear_.damping * (piece.end_velocity - m.velocity);
    }
    return trial - disturbance(m, tried());
  };
  const S force = solved(force_ + force_change_, known, miss_at, [&](const auto& resolve) {
    resolve_motion(resolve, m);
    resolve_memories(resolve, Body::kMotor);
  });
  keep_tried();
  for (std::size_t r = 0; r < states; ++r) {
    state_[r] = next[r];
    add(state_[r], linear_.rows[r].force_end, force, lanes_of(r));
  }
  force_change_ = force - force_;
  force_ = force;
  position_ = m.position;
  velocity_ = m.velocity;
  demand_ = m.demand;
  of_control_ = m.of_control;
  reading_ = reading_count_ > 0 ? read(m) : S(0.0);
  return error_free + linear_.error.force_end * force - reading_;
}

template <class S>
S TwinOf<S>::follow(double command, double neighbour_acceleration) noexcept requires(!is_dual<S>) {
  // Clang 14 instantiates members whose constraints do not hold, with the class.
  if constexpr (is_dual<S>) {
    return S(command);
  } else {
    newest_ = (newest_ + 1) % kHistory;
    history_[newest_] = command;
    const auto past = [this](std::uint32_t back) {
      return history_[(newest_ + kHistory - back) % kHistory];
    };

    // The delayed commands at the end of this cycle and of the three before, by cubic interpolation
    // centred where later commands are known.
    std::array<double, 4> x{};
    const double h = cycle_s_;
    const double shift = delay_s_ / h;
    const auto whole = static_cast<std::uint32_t>(shift);
    const double t = shift - whole;  // the sought point lies t cycles before past(whole + i)
    for (std::uint32_t i = 0; i < 4; ++i) {
      if (t == 0.0) {
        x[i] = past(whole + i);
        continue;
      }
      const std::uint32_t first = whole + i >= 1 ? whole + i - 1 : 0;  // newest of the four nodes
      const double u = t + static_cast<double>(whole + i - first);  // position counted back from it
      const double a = past(first), b = past(first + 1), c = past(first + 2), d = past(first + 3);
      x[i] = -a * (u - 1) * (u - 2) * (u - 3) / 6 + b * u * (u - 2) * (u - 3) / 2 -
             c * u * (u - 1) * (u - 3) / 2 + d * u * (u - 1) * (u - 2) / 6;
    }
    // The cubic through x[3], x[2], x[1], x[0]; the cycle runs from x[1] to x[0].
    const double d1 = x[0] - x[1];
    const double d2 = x[0] - 2 * x[1] + x[2];
    const double d3 = x[0] - 3 * x[1] + 3 * x[2] - x[3];
    CommandPiece piece;
    piece.velocity = (d1 - d2 / 2 - d3 / 6) / h;
    piece.acceleration = d2 / (h * h);
    piece.jerk = d3 / (h * h * h);
    piece.end_position = x[0];
    piece.end_velocity = piece.velocity + h * (piece.acceleration + h * piece.jerk / 2);
    piece.end_acceleration = piece.acceleration + h * piece.jerk;
    piece.neighbour_acceleration = piece.neighbour_motion_acceleration = neighbour_acceleration;
    return step(piece) + (command - x[0]);
  }
}

template <class S>
void TwinOf<S>::predict(std::span<const double> commands, std::span<double> errors) const noexcept
    requires(!is_dual<S>) {
  if constexpr (!is_dual<S>) {
    TwinOf ahead = *this;
    for (std::size_t i = 0; i < commands.size() && i < errors.size(); ++i)
      errors[i] = ahead.follow(commands[i]);
  }
}

template class TwinOf<double>;
template class TwinOf<TwinDual>;

}  // namespace servotwin
