// The twin of one axis, stepped cycle by cycle in free simulation: it sees commands only.
//
// Source: exact filters (twin/hold.h), friction linear within the step and solved with it, so that
// any step is stable (docs/theory.md 2.3). Longer cycles are solved in parts, because friction
// turns within them. Trivially copyable; a copy is how one looks ahead. Any one thread; `step`,
// `follow` and `predict` allocate nothing, take no lock and throw nothing.
#pragma once

#include <array>
#include <cstdint>
#include <span>

#include "twin/hold.h"
#include "twin/model.h"
#include "twin/sample.h"

namespace servotwin {

/// The commanded motion at the start of one cycle, as a cubic over the cycle, and where it ends.
struct CommandPiece {
  double velocity = 0.0, acceleration = 0.0, jerk = 0.0;  ///< at the start of the cycle
  double end_position = 0.0, end_velocity = 0.0, end_acceleration = 0.0;
  double neighbour_acceleration = 0.0;  ///< of another axis, at the end of the cycle
  double in_cut = 0.0;                  ///< whether the tool cuts then
};

/// What a step is computed with, for those who take it elsewhere (docs/decisions/0009). One state
/// of the linear system: the command velocity through 1/P (order states), the disturbance through
/// 1/P, and the modes, which both drive, each as [its part of the error, (d/dt + 2 zeta omega) of
/// it].
struct StepConstants {
  static constexpr int kStates = 2 * kMaxOrder + 2 * static_cast<int>(kMaxModes);
  using State = std::array<double, kStates>;
  /// How a state follows from its block over one part of a cycle.
  struct Row {
    int first = 0, width = 0;                   ///< of the block
    std::array<double, kMaxOrder> phi{};        ///< of the block's states,
    std::array<double, 3> command{};            ///< of the command's velocity, acceleration, jerk,
    double force_begin = 0.0, force_end = 0.0;  ///< and of the force at both ends
  };
  /// The error or a derivative of it from the state and the inputs.
  struct Reading {
    State state{};
    double velocity = 0.0, acceleration = 0.0, force = 0.0;
    double force_end = 0.0;  ///< what the force at the end gives through the states
    [[nodiscard]] double at(const State& w, int states) const noexcept {
      double sum = 0.0;
      for (std::size_t i = 0; i < static_cast<std::size_t>(states); ++i) sum += state[i] * w[i];
      return sum;
    }
  };
  int order = 0;
  int states = 0;
  int parts = 1;                                                  ///< that a cycle is solved in
  double damping = 0.0, integral = 0.0, integral_velocity = 0.0;  ///< a1, a3, c2 of order 3
  std::array<Row, kStates> rows{};
  Reading error{}, rate{}, second{};
  State rest{};  ///< of a constant unit disturbance held at rest
};

class Twin {
 public:
  Twin() = default;
  /// Throws std::invalid_argument with why_invalid(model). Allocates while it discretises.
  explicit Twin(const Model& model);

  [[nodiscard]] bool loaded() const noexcept { return linear_.order > 0; }
  [[nodiscard]] double sample_time_s() const noexcept { return cycle_s_; }
  [[nodiscard]] double command_delay_s() const noexcept { return delay_s_; }
  [[nodiscard]] const StepConstants& step_constants() const noexcept { return linear_; }
  /// The simulated reading at the end of the last cycle [m | rad],
  [[nodiscard]] double position() const noexcept { return position_ + reading_; }
  /// the position of the loop, which effects on the reading alone are not part of,
  [[nodiscard]] double loop_position() const noexcept { return position_; }
  /// and velocity [m/s | rad/s].
  [[nodiscard]] double velocity() const noexcept { return velocity_; }
  /// What the control asks of the motor then, over the moved mass [m/s^2 | rad/s^2].
  [[nodiscard]] double demand() const noexcept { return demand_; }
  /// x'': the demand less all that disturbs [m/s^2 | rad/s^2].
  [[nodiscard]] double acceleration() const noexcept { return demand_ - force_; }

  /// Puts the axis at rest at this command, with constant forces already held by the loop.
  void start(double command, double time_s = 0.0) noexcept;
  /// Starts within a motion: the states of 1/P [its output and derivatives] whose free response the
  /// error then holds, and after them those of every mode's 1/M, whose output it holds.
  void start(double position, std::span<const double> free_response, double time_s = 0.0) noexcept;

  /// One cycle with the command's cubic given: returns the tracking error at its end [m | rad].
  double step(const CommandPiece& piece) noexcept;
  /// One cycle from samples alone: the cubic goes through the last four (delayed) commands.
  double follow(double command) noexcept;
  /// The errors of coming cycles, this twin unchanged; errors.size() >= commands.size().
  void predict(std::span<const double> commands, std::span<double> errors) const noexcept;

 private:
  using Memories = std::array<EffectMemory<double>, kMaxEffects>;
  void discretise_loop(const Loop& loop);
  /// The modes' part of linear_ for a cycle over which the command is there and at whose end it is
  /// here.
  void place_modes(double over, double at_end) noexcept;
  double advance(const CommandPiece& piece) noexcept;
  double disturbance(Motion& m, Memories& memory) const noexcept;
  double read(const Motion& m) noexcept;
  void copy_memories(const Memories& from, Memories& to) const noexcept;

  static constexpr int kHistory = 512;  // commands kept for a delay; power of two
  static_assert(kHistory >= kMaxDelayCycles + 8, "the interpolation reaches beyond the delay");

  int effect_count_ = 0;
  double cycle_s_ = 0.0;
  double h_ = 0.0;  // of a part
  double delay_s_ = 0.0;
  StepConstants linear_;
  // What the modes' part of it follows from, cycle by cycle where one of them moves.
  std::array<double, kMaxOrder> denominator_{}, numerator_{};
  std::array<Mode, kMaxModes> modes_{};
  Travel travel_{};
  bool moves_ = false;
  std::array<Effect, kMaxEffects>
      effects_{};  // the law of friction, other forces, those on the reading
  int reading_count_ = 0;

  StepConstants::State state_{};
  Memories memory_{};
  Memories trial_{};           // of a step that is being solved
  double force_ = 0.0;         // disturbance at the end of the cycle before,
  double force_change_ = 0.0;  // what it was less before that,
  double slope_ = 1.0;         // and how fast a force parted from the one that its motion gives
  double demand_ = 0.0;
  double position_ = 0.0;  // simulated position there
  double velocity_ = 0.0;
  double reading_ = 0.0;  // less the position
  double neighbour_acceleration_ = 0.0;
  double time_s_ = 0.0;
  std::array<double, kHistory> history_{};
  std::uint32_t newest_ = 0;
};

/// How much of a segment's beginning `simulate` uses of the encoder to find the starting state [s].
[[nodiscard]] double starting_state_s(const Model& model);
/// The same in samples of a segment; no part of what a prediction is judged by.
[[nodiscard]] Eigen::Index starting_state_samples(const Model& model, const Segment& segment);

/// Free simulation of a whole segment from its command and starting state alone: the tracking
/// error. The starting state is taken from the first `starting_state_s` of the encoder where
/// `actual` is there; else the axis starts at rest on its command.
[[nodiscard]] Eigen::ArrayXd simulate(const Model& model, const Segment& segment);

}  // namespace servotwin
