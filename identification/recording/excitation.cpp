#include "identification/recording/excitation.h"

#include <algorithm>
#include <cmath>
#include <sstream>

#include "identification/recording/order_statistics.h"
#include "twin/hold.h"

namespace servotwin {

Excitation excitation_of(const std::vector<Segment>& segments) {
  Excitation out;
  std::vector<double> accelerations;
  double low = 1e300, high = -1e300;
  Eigen::Index rows = 0, forward = 0, backward = 0;
  std::vector<Spline> motions;
  for (const Segment& s : segments) {
    if (s.size() < 8) continue;
    motions.push_back(Spline::through(s.command, s.sample_time_s));
    low = std::min(low, s.command.minCoeff());
    high = std::max(high, s.command.maxCoeff());
    out.peak_velocity = std::max(out.peak_velocity, motions.back().first.abs().maxCoeff());
    rows += s.size();
  }
  if (rows == 0) return out;
  out.travel = high - low;
  for (const Spline& m : motions) {
    int direction = 0;
    for (Eigen::Index i = 0; i < m.first.size(); ++i) {
      accelerations.push_back(std::abs(m.second(i)));
      const double v = m.first(i);
      if (std::abs(v) <= 0.02 * out.peak_velocity) continue;
      const int now = v > 0.0 ? 1 : -1;
      (now > 0 ? forward : backward) += 1;
      if (direction != 0 && now != direction) ++out.reversals;
      direction = now;
    }
  }
  out.peak_acceleration = quantile(std::move(accelerations), kPeakQuantile);
  out.forward_share = static_cast<double>(forward) / static_cast<double>(rows);
  out.backward_share = static_cast<double>(backward) / static_cast<double>(rows);
  out.rest_share = 1.0 - out.forward_share - out.backward_share;
  return out;
}

std::vector<std::string> missing_motion(const Excitation& e, bool rotary) {
  const char* length = rotary ? "rad" : "m";
  std::vector<std::string> out;
  const auto add = [&out](const auto&... parts) {
    std::ostringstream line;
    line.precision(3);
    (line << ... << parts);
    out.push_back(line.str());
  };
  if (e.reversals < 2 || e.forward_share < 0.02 || e.backward_share < 0.02) {
    add("friction is not excited: it needs motion in both directions, the recording has ",
        e.reversals, " reversals and ", 100.0 * std::min(e.forward_share, e.backward_share),
        " % of the time in the less frequent direction; move there and back at least twice");
  }
  // The loop is excited where the command accelerates; production moves use ten times this limit.
  if (e.peak_velocity > 0.0 && e.peak_acceleration < 0.2 * e.peak_velocity) {
    add("poles and tracking numerator are not excited: accelerations reach ", e.peak_acceleration,
        " ", length, "/s^2 at a speed of ", e.peak_velocity, " ", length,
        "/s; add moves that reach this speed within a second or less");
  }
  return out;
}

}  // namespace servotwin
