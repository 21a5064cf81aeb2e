#include "identification/recording/spikes.h"

#include <algorithm>
#include <cmath>

#include "identification/recording/order_statistics.h"
#include "identification/recording/values.h"

namespace servotwin {

namespace {

using values::number;
using values::size_text;
using values::Values;

// 100 g: ten times what the fastest linear axes do, and what small motors do.
constexpr double kMaxAcceleration_m_s2 = 1e3, kMaxAcceleration_rad_s2 = 1e6;
// Spikes and their neighbours are rarer than one value in twenty; the others are far below.
constexpr double kTypicalQuantile = 0.95, kMinOverTypical = 30.0;
constexpr double kMinSteps = 20.0;  // of the encoder: a value that flickers by a count is none
constexpr double kSymmetry = 0.2;   // of d: deviation of the neighbours from -d/2
constexpr double kMaxSpikeShare = 0.0025;  // of the rows

}  // namespace

std::optional<std::string> leave_out_spikes(AxisRecord& axis, const std::vector<double>& time,
                                            double step_s) {
  const Values& x = axis.actual;
  if (x.size() < 5 || x.size() != time.size() || !(step_s > 0.0)) return std::nullopt;
  Values bends(x.size(), kAbsent);
  double encoder_step = HUGE_VAL;
  for (std::size_t k = 1; k + 1 < x.size(); ++k) {
    bends[k] = x[k] - 0.5 * (x[k - 1] + x[k + 1]);
    if (const double change = std::abs(x[k] - x[k - 1]); change > 0.0)
      encoder_step = std::min(encoder_step, change);
  }
  Values sizes = values::finite(bends);
  if (sizes.empty()) return std::nullopt;
  for (double& size : sizes) size = std::abs(size);
  // Away and back within a sample each: four times d over the square of the time.
  const double impossible =
      0.25 * step_s * step_s * (axis.rotary ? kMaxAcceleration_rad_s2 : kMaxAcceleration_m_s2);
  const double limit = std::max({impossible, kMinSteps * encoder_step,
                                 kMinOverTypical * quantile(std::move(sizes), kTypicalQuantile)});
  std::vector<std::size_t> found;
  double largest = 0.0;
  for (std::size_t k = 2; k + 2 < x.size(); ++k) {
    const double d = bends[k];
    const auto opposite = [&](double beside) {
      return std::abs(beside + 0.5 * d) <= kSymmetry * std::abs(d);
    };
    if (!(std::abs(d) > limit) || !opposite(bends[k - 1]) || !opposite(bends[k + 1])) continue;
    found.push_back(k);
    largest = std::max(largest, std::abs(d));
  }
  if (found.empty()) return std::nullopt;
  if (static_cast<double>(found.size()) > kMaxSpikeShare * static_cast<double>(x.size()))
    return std::to_string(found.size()) + " single values of the encoder are up to " +
           size_text(largest, axis.rotary) +
           " away from both neighbours: too many to be left out; look at the encoder, its cable or "
           "the recorder";
  for (const std::size_t k : found) axis.actual[k] = kAbsent;
  const bool one = found.size() == 1;
  return (one ? "one value" : std::to_string(found.size()) + " single values") +
         std::string(" of the encoder ") + (one ? "is " : "are up to ") +
         size_text(largest, axis.rotary) + " away from both neighbours, " +
         (one ? "at " : "the first at ") + number(time[found.front()]) +
         " s: left out, since no axis moves away and back within a sample";
}

}  // namespace servotwin
