// The acceleration of one axis as it acts on another: that of its command, from the last four of
// them, or of its motion, as its own twin predicts it.
//
// Where two axes act on each other by their motion, the one whose turn comes first needs the motion
// of the other in a cycle that is not predicted yet. Copies of both twins are stepped for it by
// turns. To let the other one accelerate as in the cycle before instead changes the damping of what
// vibrates (docs/decisions/0028-axes-by-each-others-motion.md).
//
// A twin that has just started, or whose axis got a command that no axis follows, predicts no
// motion that others should follow: until it has settled its command stands in for it.
//
// Units: m | rad, s. Errors: none. Any thread; allocates nothing.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <span>

#include "daemon/between/cycle_row.h"
#include "twin/sample.h"

namespace servotwin::daemon {

/// The last cycles of an axis; NaN: there was none, or nothing is predicted.
struct LastCycles {
  std::array<double, 4> command{kAbsent, kAbsent, kAbsent, kAbsent};  ///< the newest first
  double acceleration = kAbsent;  ///< predicted, of the newest cycle that is predicted
  bool predicted = false;         ///< so is the newest cycle

  /// A new cycle, of which nothing is predicted so far.
  void add(double of_command) noexcept {
    std::shift_right(command.begin(), command.end(), 1);
    command[0] = of_command;
    predicted = false;
  }
  void predict(double of_motion) noexcept {
    acceleration = of_motion;
    predicted = true;
  }
  /// Whether all commands are there and an axis can follow them.
  [[nodiscard]] bool sane() const noexcept {
    // [m | rad]: ten times what the fastest axis does in four cycles of 5 ms; more is a wrong
    // value.
    constexpr double kMaxTravel = 1.0;
    const auto [least, most] = std::minmax_element(command.begin(), command.end());
    return std::all_of(command.begin(), command.end(), [](double x) { return std::isfinite(x); }) &&
           *most - *least < kMaxTravel;
  }
  /// Of the cubic through the commands, at the newest; 0 where they are not sane.
  [[nodiscard]] double commanded(double cycle_s) const noexcept {
    if (!sane()) return 0.0;
    return (2 * command[0] - 5 * command[1] + 4 * command[2] - command[3]) / (cycle_s * cycle_s);
  }
};

/// An axis and its twin, as the others see them.
struct SeenAxis {
  const TwinInForce* model = nullptr;  ///< null: it predicts no motion that others should follow
  const Twin* twin = nullptr;          ///< at the newest cycle that is predicted
  LastCycles last;
};

/// By how many copies the motion of an axis that is not predicted yet is sought.
inline constexpr int kCopies = 2;

/// What acts on an axis with this model in the newest cycle [m/s^2 | rad/s^2]; without a model of
/// the other axis that of its command. `axis(i)`: the i-th axis as a SeenAxis.
template <class AxisAt>
[[nodiscard]] double acting_on(const TwinInForce& model, const AxisAt& axis,
                               int copies = kCopies) noexcept {
  if (model.neighbour < 0) return 0.0;
  const SeenAxis& other = axis(model.neighbour);
  const double commanded = other.last.commanded(model.twin.sample_time_s());
  if (!model.by_motion || other.model == nullptr) return commanded;
  double acceleration = other.last.acceleration;
  if (!other.last.predicted && copies > 0) {
    Twin ahead = *other.twin;
    (void)ahead.follow(other.last.command[0], acting_on(*other.model, axis, copies - 1));
    acceleration = ahead.acceleration();
  }
  return std::isfinite(acceleration) ? acceleration : commanded;
}

}  // namespace servotwin::daemon
