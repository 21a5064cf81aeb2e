// The residual of a simulation, divided by the regime of the commanded motion.
//
//   residual r = measured - predicted tracking error [m | rad]
//   share      = sum of r^2 in a regime / sum of all
//
// The regime is determined from the command over a span of +-kRegimeSpan_s, so that a quantised
// command does not look like acceleration. It is the first of these whose condition holds:
//
// - saturation: the motor is at its torque limit, where that is known.
// - reversal: within 50 ms of a reversal of the command; after a longer stop, of the restart.
// - standstill: |v| is at most 0.5 % of the peak speed.
// - constant speed: |a| is at most 5 % of the peak acceleration, or too small to change the speed
//   by 0.1 % of its peak over the span.
// - acceleration: the rest.
//
// Samples whose command or residual is not finite, and those too close to the ends of a stretch to
// have a velocity, belong to no regime and are not counted. Any thread.
#pragma once

#include <Eigen/Core>
#include <array>
#include <span>
#include <string_view>

namespace servotwin {

enum class Regime { kStandstill, kConstantSpeed, kAcceleration, kReversal, kSaturation };
inline constexpr std::size_t kRegimes = 5;
inline constexpr double kRegimeSpan_s = 0.008;  // a 1 um step then makes only 0.016 m/s^2
inline constexpr double kReversalWindow_s =
    0.05;  // several time constants of a usual position loop

[[nodiscard]] std::string_view name_of(Regime regime);  ///< "standstill", "constant_speed", ...

struct RegimeShare {
  Regime regime = Regime::kStandstill;
  Eigen::Index samples = 0;
  double rms = 0.0;         ///< of the residual [m | rad]
  double max = 0.0;         ///< of its absolute value
  double time_share = 0.0;  ///< of the samples counted
  double share = 0.0;       ///< of the sum of squares; 0 where the residual is 0 everywhere
};
using RegimeShares = std::array<RegimeShare, kRegimes>;  ///< in the order of the enumeration

/// An uninterrupted stretch of motion with the residual of the model; both have the same length.
struct ResidualStretch {
  Eigen::ArrayXd command;
  Eigen::ArrayXd residual;
  double h = 0.0;        ///< sampling time [s] > 0
  double start_s = 0.0;  ///< of its first sample in the recording
  /// 1 where the motor is at its torque limit, else 0; empty: not known.
  Eigen::ArrayXd saturated = {};
};

/// 1 where a recorded torque is clipped at its largest or smallest value: in runs of that value of
/// at least 3 samples and 3 ms. At the peak of a coarsely rounded sine there are up to 2.4 times as
/// many samples as one digit below it; a value counts as a limit with at least 5 times as many. A
/// value below half of the largest torque in either direction is no limit. Empty where nothing is
/// clipped.
[[nodiscard]] Eigen::ArrayXd at_limit(const Eigen::ArrayXd& torque, double h);

/// Velocity and acceleration of the command over +-kRegimeSpan_s; NaN where the span leaves the
/// stretch or the command has a hole.
struct CommandMotion {
  Eigen::ArrayXd velocity, acceleration;
};
[[nodiscard]] CommandMotion motion_of(const ResidualStretch& stretch);

/// The shares of the regimes. Peak speed and peak acceleration are those of all stretches together.
/// Throws std::invalid_argument where a stretch's arrays differ in length or its h is not positive.
[[nodiscard]] RegimeShares by_regime(std::span<const ResidualStretch> stretches);
[[nodiscard]] RegimeShares by_regime(const Eigen::ArrayXd& command, const Eigen::ArrayXd& residual,
                                     double h);

}  // namespace servotwin
