// The twin of one axis, stepped cycle by cycle in free simulation: its only input is the command.
//
//   e = s N(s)/P(s) x_r(t - tau) + (x_r(t) - x_r(t - tau)) + (s | 1)/P(s) sum_i d_i f_i(motion)
//
// N, P and the modes of vibration: twin/loop.h; (s | 1): s with integral action, 1 without. The
// filters are exact (twin/hold.h). The friction force is interpolated linearly within the step and
// solved together with it, so any step is stable (docs/theory.md 2.3). Cycles above 1 ms, and above
// 0.25 ms where something vibrates, are solved in parts: friction may reverse within them. On an
// axis of two masses
// (twin/two_mass_axis.h) the forces on motor and load are solved in turns until they agree.
// Trivially copyable; looking ahead is done on a copy.
//
// Compiled for double, the twin that runs live, and for TwinDual (twin/dual.h): then a twin of
// double leads, with the values and the forces solved for, and the derivatives follow.
//
// Units: m | rad, s. Errors: std::invalid_argument from the constructor. Any one thread; `step`,
// `follow` and `predict` allocate nothing, take no lock and throw nothing. Source: docs/theory.md 1
// to 3.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <type_traits>

#include "twin/force_balance.h"
#include "twin/hold.h"
#include "twin/model.h"
#include "twin/sample.h"
#include "twin/two_mass_axis.h"

namespace servotwin {

class Resolution;

/// The commanded motion over one cycle, as a cubic from its start, and its values at the end.
template <class S>
struct CommandPieceOf {
  S velocity = 0.0, acceleration = 0.0, jerk = 0.0;  ///< at the start of the cycle
  S end_position = 0.0, end_velocity = 0.0, end_acceleration = 0.0;
  /// Of another axis at the end of the cycle, commanded and of its own motion.
  double neighbour_acceleration = 0.0, neighbour_motion_acceleration = 0.0;
  double in_cut = 0.0;  ///< 1 if the tool cuts then
};
using CommandPiece = CommandPieceOf<double>;

/// The constants of a step, for export (docs/decisions/0009-c-sources-of-the-unit.md). The state of
/// the linear system is: the command velocity through 1/P (order states), the disturbance through
/// 1/P, and the modes, driven by both, each as [its part of the error, (d/dt + 2 zeta omega) of
/// it].
template <class S>
struct StepConstantsOf {
  static constexpr int kStates = 2 * kMaxOrder + 2 * static_cast<int>(kMaxModes);
  using State = std::array<S, kStates>;
  /// Update of one state over one part of a cycle, from the states of its block.
  struct Row {
    int first = 0, width = 0;              ///< first state and size of the block
    std::array<S, kMaxOrder> phi{};        ///< factors of the block's states,
    std::array<S, 3> command{};            ///< of command velocity, acceleration and jerk,
    S force_begin = 0.0, force_end = 0.0;  ///< and of the force at begin and end
  };
  /// The error or a derivative of it from the state and the inputs.
  struct Reading {
    State state{};
    S velocity = 0.0, acceleration = 0.0, force = 0.0;
    S force_end = 0.0;  ///< contribution of the force at the end through the states
  };
  int order = 0;
  int states = 0;
  int parts = 1;                                             ///< parts in which a cycle is solved
  S damping = 0.0, integral = 0.0, integral_velocity = 0.0;  ///< a1, a3, c2 of order 3
  std::array<Row, kStates> rows{};
  Reading error{}, rate{}, second{};
  State rest{};  ///< state at rest under a constant unit disturbance
};
using StepConstants = StepConstantsOf<double>;

template <class S>
class TwinOf {
 public:
  TwinOf() = default;
  /// Throws std::invalid_argument with why_invalid(model). Allocates while it discretises.
  explicit TwinOf(const ModelOf<S>& model);

  [[nodiscard]] bool loaded() const noexcept { return linear_.order > 0; }
  [[nodiscard]] double sample_time_s() const noexcept { return cycle_s_; }
  [[nodiscard]] S command_delay_s() const noexcept { return delay_s_; }
  [[nodiscard]] const StepConstantsOf<S>& step_constants() const noexcept { return linear_; }
  /// The simulated encoder reading at the end of the last cycle [m | rad].
  [[nodiscard]] S position() const noexcept { return position_ + reading_; }
  /// The simulated position of the loop, without effects on the reading alone [m | rad].
  [[nodiscard]] S loop_position() const noexcept { return position_; }
  /// The simulated position of the motor; on a rigid axis that of the loop [m | rad].
  [[nodiscard]] S motor_position() const noexcept {
    return axis_.used() ? motor_position_ : position_;
  }
  /// The simulated velocity [m/s | rad/s].
  [[nodiscard]] S velocity() const noexcept { return velocity_; }
  /// That of the motor; on a rigid axis the same.
  [[nodiscard]] S motor_velocity() const noexcept {
    return axis_.used() ? motor_velocity_ : velocity_;
  }
  /// Force demanded by the control per moved mass, at the same time [m/s^2 | rad/s^2].
  [[nodiscard]] S demand() const noexcept { return demand_; }
  /// Force of the motor per moved mass, but for the viscous friction that is part of the loop: the
  /// demand without what the control does not give of it [m/s^2 | rad/s^2]. Of a loop with modes of
  /// vibration it lacks the inertia of what vibrates.
  [[nodiscard]] S motor_force() const noexcept { return demand_ - of_control_; }
  /// x'': the demand minus all disturbances [m/s^2 | rad/s^2]; of the body that carries the
  /// recorded encoder.
  [[nodiscard]] S acceleration() const noexcept {
    return axis_.used() ? acceleration_ : demand_ - force_;
  }
  /// How many states of the loop a start within a motion may set.
  [[nodiscard]] int free_states() const noexcept {
    return axis_.used() ? axis_.states() : linear_.states - linear_.order;
  }

  /// Starts at rest at this command, with constant forces already balanced by the loop.
  void start(const S& command, double time_s = 0.0) noexcept;
  /// Starts within a motion. `free_response`: the states of 1/P (output and derivatives) whose free
  /// response is added to the error, then those of 1/M of every mode, whose output is added. On an
  /// axis of two masses its states.
  void start(const S& position, std::span<const S> free_response, double time_s = 0.0) noexcept;

  /// After a start within a motion: filters of the control as if this motion had lasted.
  void start_filters(const S& velocity, const S& acceleration) noexcept;

  /// One cycle with the cubic of the command given. Returns the tracking error at its end [m |
  /// rad].
  S step(const CommandPieceOf<S>& piece) noexcept;
  /// One cycle from samples alone; the cubic passes through the last four (delayed) commands.
  /// `neighbour_acceleration`: of the axis that acts on this one, of its command or, for a model
  /// that is coupled by motion, of its motion [m/s^2 | rad/s^2]. Returns the tracking error [m |
  /// rad].
  S follow(double command, double neighbour_acceleration = 0.0) noexcept requires(!is_dual<S>);
  /// The tracking errors of the next cycles; this twin does not change. errors.size() >=
  /// commands.size().
  void predict(std::span<const double> commands, std::span<double> errors) const noexcept
      requires(!is_dual<S>);

 private:
  template <class>
  friend class TwinOf;
  struct Nobody {};
  // On an axis of two masses friction is there twice.
  static constexpr std::size_t kMaxEntries = kMaxEffects + kMaxFrictions;
  using Memories = std::array<EffectMemory<S>, kMaxEntries>;
  void discretise_loop(const LoopOf<S>& loop);
  /// Computes the modes' part of linear_ for a cycle during which the command is at `over` and at
  /// whose end it is at `at_end`.
  void place_modes(const S& over, const S& at_end) noexcept;
  S advance(const CommandPieceOf<S>& piece) noexcept;
  S advance_two_masses(const CommandPieceOf<S>& piece) noexcept;
  /// Solves the forces on motor and load and that of the play for a step of which this is the free
  /// state; from the forces as they are.
  void balance_two_masses(const typename TwoMassAxisOf<S>::State& free,
                          const CommandPieceOf<S>& piece, MotionOf<S>& motor,
                          MotionOf<S>& load) noexcept;
  void start_two_masses(const S& command) noexcept;
  enum class Body : std::uint8_t { kMotor, kLoad };
  void add_force(const EffectOf<S>& effect, Body body, const S& share) noexcept;
  S disturbance(MotionOf<S>& m, Memories& memory, Body body = Body::kMotor) const noexcept;
  S read(const MotionOf<S>& m) noexcept;
  void copy_memories(const Memories& from, Memories& to, Body body = Body::kMotor) const noexcept;
  /// How many derivatives of a state may not be 0.
  [[nodiscard]] std::size_t lanes_of(std::size_t state) const noexcept {
    if constexpr (is_dual<S>)
      return state < static_cast<std::size_t>(linear_.order) ? command_lanes_ : S::kLanes;
    return 0;
  }
  /// sum += constant * x, a state or input with so many derivatives.
  void add(S& sum, const S& constant, const S& x, std::size_t lanes) const noexcept {
    add_product(sum, constant, x, constant_lanes_, lanes);
  }
  [[nodiscard]] S value_at(const typename StepConstantsOf<S>::Reading& reading,
                           const typename StepConstantsOf<S>::State& w) const noexcept;
  /// The force at which `miss` is 0, from `first`. Derivatives: `known` is that force, and
  /// `settle(resolve)` has to call resolve(x) for everything that `miss` set.
  template <class Miss, class Settle>
  S solved(const S& first, double known, const Miss& miss, const Settle& settle) noexcept;
  void resolve_memories(const Resolution& resolve, Body body) noexcept;
  /// The memory for one trial of a step, and what keeps it: a step is tried many times, but once
  /// for its derivatives.
  [[nodiscard]] Memories& tried(Body body = Body::kMotor) noexcept;
  void keep_tried(Body body = Body::kMotor) noexcept;

  static constexpr int kHistory = 512;  // commands kept for a delay; power of two
  static_assert(kHistory >= kMaxDelayCycles + 8, "the interpolation reaches beyond the delay");

  int effect_count_ = 0;
  double cycle_s_ = 0.0;
  double h_ = 0.0;  // duration of a part
  S delay_s_ = 0.0;
  StepConstantsOf<S> linear_;
  // Derivatives: only the first so many parameters change the constants of a step, and those and
  // the delay the states that the command alone drives.
  std::size_t constant_lanes_ = 0, command_lanes_ = 0;
  // Input of place_modes, which runs every cycle if a mode moves.
  std::array<S, kMaxOrder> denominator_{}, numerator_{};
  std::array<ModeOf<S>, kMaxModes> modes_{};
  Travel travel_{};
  bool moves_ = false;
  std::array<EffectOf<S>, kMaxEntries>
      effects_{};  // order: friction law, other forces, effects on the reading
  std::array<Body, kMaxEntries> bodies_{};  // on which they act; the motor's, if there is one body
  int reading_count_ = 0;

  typename StepConstantsOf<S>::State state_{};
  Memories memory_{};
  Memories trial_{};      // memory of the step that is being solved; derivatives: not used
  S force_ = 0.0;         // disturbance at the end of the last cycle
  S force_change_ = 0.0;  // its change over the last cycle
  double slope_ = 1.0;    // last secant slope of force minus force of the resulting motion
  S demand_ = 0.0;
  S of_control_ = 0.0;  // of the disturbance
  S position_ = 0.0;    // simulated position at the end of the last cycle
  S velocity_ = 0.0;
  S reading_ = 0.0;  // reading minus position
  double neighbour_acceleration_ = 0.0, neighbour_motion_acceleration_ = 0.0;
  double time_s_ = 0.0;
  // An axis of two masses: its state, the force on the load with its slope as above (force_ is that
  // on the motor), and the force that the spring misses in the play.
  TwoMassAxisOf<S> axis_;
  typename TwoMassAxisOf<S>::State axis_state_{};
  S load_force_ = 0.0, load_force_change_ = 0.0;
  S contact_ = 0.0;
  double load_slope_ = 1.0, contact_slope_ = 1.0;
  PairBySlopes together_ = kApart;
  S motor_position_ = 0.0, load_position_ = 0.0, acceleration_ = 0.0, motor_velocity_ = 0.0;
  std::array<double, kHistory> history_{};
  std::uint32_t newest_ = 0;
  [[no_unique_address]] std::conditional_t<is_dual<S>, TwinOf<double>, Nobody> leader_;
};
using Twin = TwinOf<double>;

/// How much encoder data at the start of a segment `simulate` uses for the starting state [s].
[[nodiscard]] double starting_state_s(const Model& model);
/// The same in samples of a segment; they are not counted in the error of a prediction.
[[nodiscard]] Eigen::Index starting_state_samples(const Model& model, const Segment& segment);

/// What a simulation gives of every sample, in turns: the tracking error at the recorded encoder
/// [m | rad], then
struct Outputs {
  bool motor = false;   ///< that at the motor [m | rad]
  bool torque = false;  ///< the motor's force per moved mass [m/s^2 | rad/s^2] and its velocity
                        ///< [m/s | rad/s]
  [[nodiscard]] Eigen::Index per_sample() const noexcept {
    return 1 + (motor ? 1 : 0) + (torque ? 2 : 0);
  }
  /// Place of the motor's force among them; the velocity follows.
  [[nodiscard]] Eigen::Index torque_at() const noexcept { return motor ? 2 : 1; }
};

/// Free simulation of a whole segment from command and starting state: one value per sample and
/// output. If `actual` is present, the starting state is fitted to
/// the first `starting_state_s` of it; else the axis starts at rest on its command.
[[nodiscard]] Eigen::ArrayXd simulate(const Model& model, const Segment& segment,
                                      Outputs outputs = {});

/// The same with its derivatives: column i is d error / dt of the models model + t directions[i]. A
/// direction is a model of the same structure whose parameters are the rates of change.
struct Simulated {
  Eigen::ArrayXd error;
  Eigen::MatrixXd by;
};
[[nodiscard]] Simulated simulate(const Model& model, std::span<const Model> directions,
                                 const Segment& segment, Outputs outputs = {});

}  // namespace servotwin
