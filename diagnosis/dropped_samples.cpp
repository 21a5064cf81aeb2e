#include "diagnosis/dropped_samples.h"

#include <algorithm>
#include <cmath>

namespace servotwin {

namespace {

constexpr double kMoves = 4.0;      // encoder steps of the command per sample
constexpr double kMakesGood = 0.6;  // share of what was missed that the next value brings
constexpr Eigen::Index kLongest = 200;

std::size_t bridge_held(Segment& s, double step) {
  std::size_t held = 0;
  for (Eigen::Index k = 1; k + 1 < s.size(); ++k) {
    if (s.actual(k) != s.actual(k - 1)) continue;
    Eigen::Index end = k;  // the first that is not held
    while (end < s.size() && s.actual(end) == s.actual(k - 1)) ++end;
    if (end == s.size() || end - k > kLongest) {
      k = end;
      continue;
    }
    const double missed = s.command(end) - s.command(k - 1), made = s.actual(end) - s.actual(k - 1);
    const auto samples = static_cast<double>(end - k + 1);
    // A single value may be a coarse encoder's noise, unless the axis is far too fast for that.
    const bool moves = std::abs(missed) > (end - k > 1 ? kMoves : 5.0 * kMoves) * step * samples;
    // The axis was under way before, and not about to turn or to start.
    const double before = k >= 2 ? s.actual(k - 1) - s.actual(k - 2) : 0.0;
    const bool under_way =
        before * missed > 0.0 && std::abs(before) * samples > kMakesGood * std::abs(missed);
    if (moves && under_way && made / missed > kMakesGood) {
      for (Eigen::Index i = k; i < end; ++i)
        s.actual(i) = s.actual(k - 1) + made * static_cast<double>(i - k + 1) / samples;
      held += static_cast<std::size_t>(end - k);
    }
    k = end;
  }
  return held;
}

}  // namespace

DroppedSamples bridge_dropped(SegmentedAxis& axis, double encoder_step) {
  DroppedSamples out;
  out.missing = axis.report.samples_bridged;
  out.gaps = axis.report.splits.size();
  for (Segment& s : axis.segments) out.held += bridge_held(s, encoder_step);
  return out;
}

}  // namespace servotwin
