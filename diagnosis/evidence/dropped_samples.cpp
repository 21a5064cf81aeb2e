#include "diagnosis/evidence/dropped_samples.h"

#include <algorithm>
#include <cmath>

namespace servotwin {

namespace {

// Speed of the command in encoder steps per sample above which a repeated value is suspicious.
constexpr double kMinStepsPerSample = 4.0;
// Share of the missed travel by which the value after the hold must jump.
constexpr double kMinJumpShare = 0.6;
constexpr Eigen::Index kMaxHeldSamples = 200;

/// Interpolates the held values of a segment, which `found` counts; `squares` adds up the squares
/// of their distances from the motion.
void bridge_held(Segment& s, double step, std::size_t& found, double& squares) {
  for (Eigen::Index k = 1; k + 1 < s.size(); ++k) {
    if (s.actual(k) != s.actual(k - 1)) continue;
    Eigen::Index end = k;  // the first that is not held
    while (end < s.size() && s.actual(end) == s.actual(k - 1)) ++end;
    if (end == s.size() || end - k > kMaxHeldSamples) {
      k = end;
      continue;
    }
    const double missed = s.command(end) - s.command(k - 1), made = s.actual(end) - s.actual(k - 1);
    const auto samples = static_cast<double>(end - k + 1);
    // A single repeated value may be quantisation; it counts only at five times the speed.
    const bool moves =
        std::abs(missed) >
        (end - k > 1 ? kMinStepsPerSample : 5.0 * kMinStepsPerSample) * step * samples;
    // The axis must have been moving in the same direction before: no start and no reversal.
    const double before = k >= 2 ? s.actual(k - 1) - s.actual(k - 2) : 0.0;
    const bool under_way =
        before * missed > 0.0 && std::abs(before) * samples > kMinJumpShare * std::abs(missed);
    if (moves && under_way && made / missed > kMinJumpShare) {
      for (Eigen::Index i = k; i < end; ++i) {
        const double away = made * static_cast<double>(i - k + 1) / samples;
        s.actual(i) = s.actual(k - 1) + away;
        squares += away * away;
        // What holds a row holds the motor's encoder as well.
        if (s.actual_motor.size() == s.size()) s.actual_motor(i) = kAbsent;
      }
      found += static_cast<std::size_t>(end - k);
    }
    k = end;
  }
}

}  // namespace

DroppedSamples bridge_dropped(SegmentedAxis& axis, double encoder_step) {
  DroppedSamples out;
  out.missing = axis.report.samples_bridged;
  const auto& splits = axis.report.splits;
  out.gaps =
      static_cast<std::size_t>(std::count_if(splits.begin(), splits.end(), [](const auto& split) {
        return split.length_s <= kLongestLoss_s;
      }));
  double squares = 0.0, samples = 0.0;
  for (Segment& s : axis.segments) {
    bridge_held(s, encoder_step, out.held, squares);
    samples += static_cast<double>(s.size());
  }
  out.held_rms = samples > 0.0 ? std::sqrt(squares / samples) : 0.0;
  return out;
}

}  // namespace servotwin
