#include "diagnosis/evidence/command_lag.h"

#include <algorithm>
#include <cmath>

#include "diagnosis/statistics/text.h"
#include "twin/shown_units.h"

namespace servotwin {

CommandLag command_lag(std::span<const Segment> segments) {
  double ee = 0.0, ev = 0.0, vv = 0.0, count = 0.0;
  for (const Segment& s : segments) {
    for (Eigen::Index k = std::max<Eigen::Index>(1, s.lead); k + 1 < s.size(); ++k) {
      const double e = s.command(k) - s.actual(k);
      const double v = (s.command(k + 1) - s.command(k - 1)) / (2.0 * s.sample_time_s);
      ee += e * e, ev += e * v, vv += v * v, count += 1.0;
    }
  }
  CommandLag out;
  if (count == 0.0) return out;
  out.tracking_rms = std::sqrt(ee / count);
  if (!(vv > 0.0 && ee > 0.0)) return out;
  out.time_s = ev / vv;
  out.share = std::clamp(ev * ev / (vv * ee), 0.0, 1.0);
  return out;
}

std::string tracking_text(const CommandLag& lag, const std::string& axis, bool rotary) {
  return "The tracking error of axis " + axis + " is " + micro_text(lag.tracking_rms, rotary, 3) +
         " RMS on held-out motion";
}

std::string lag_text(const CommandLag& lag, const std::string& axis, bool rotary) {
  if (!std::isfinite(lag.tracking_rms)) return {};
  constexpr double kNamedShare = 0.5;  // of the squared error: the majority
  std::string out = tracking_text(lag, axis, rotary);
  if (!(lag.share >= kNamedShare && lag.time_s > 0.0)) return out + ".";
  out += text("; %.*f %% of its square is a lag of %.3g ms behind the command",
              lag.share > 0.99 ? 1 : 0, std::min(100.0 * lag.share, 99.9), 1e3 * lag.time_s);
  if (!lag.is_all()) return out + ".";
  return out +
         ", as in a drive without full velocity feed-forward: this is no fault, and feed-forward "
         "or a "
         "corrected command removes it.";
}

}  // namespace servotwin
