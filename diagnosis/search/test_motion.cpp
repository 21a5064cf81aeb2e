#include "diagnosis/search/test_motion.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "diagnosis/statistics/text.h"
#include "identification/recording/evidence.h"
#include "identification/recording/order_statistics.h"

namespace servotwin {

namespace {

// Time step of the differences, the same as for the acceleration in
// identification/recording/evidence.h.
constexpr double kDifference_s = 0.02;

/// The velocity profile of a leg: a ramp up to `peak`, constant velocity, and a ramp down.
struct Trapezoid {
  double distance = 0.0, ramp_s = 0.0, hold_s = 0.0, acceleration = 0.0, peak = 0.0;

  Trapezoid(double way, const TestLeg& leg) : distance(std::abs(way)) {
    acceleration = leg.acceleration;
    peak = std::min(leg.velocity, std::sqrt(acceleration * distance));
    ramp_s = peak / acceleration;
    hold_s = peak > 0.0 ? distance / peak - ramp_s : 0.0;
  }
  [[nodiscard]] double duration_s() const { return 2.0 * ramp_s + hold_s; }
  [[nodiscard]] double at(double t) const {
    if (t <= 0.0) return 0.0;
    if (t >= duration_s()) return distance;
    if (t < ramp_s) return 0.5 * acceleration * t * t;
    if (t < ramp_s + hold_s) return 0.5 * peak * ramp_s + peak * (t - ramp_s);
    const double left = duration_s() - t;
    return distance - 0.5 * acceleration * left * left;
  }
};

double peak_jerk(const std::vector<Segment>& segments) {
  std::vector<double> all;
  for (const Segment& s : segments) {
    const auto d = std::max<Eigen::Index>(
        1, static_cast<Eigen::Index>(std::lround(kDifference_s / s.sample_time_s)));
    const double span = static_cast<double>(d) * s.sample_time_s;
    const auto& x = s.command;
    for (Eigen::Index k = 0; k + 3 * d < s.size(); ++k) {
      const double j = std::abs(x(k + 3 * d) - 3.0 * x(k + 2 * d) + 3.0 * x(k + d) - x(k)) /
                       (span * span * span);
      if (j > 0.0) all.push_back(j);
    }
  }
  return quantile(std::move(all), kPeakQuantile);
}

}  // namespace

SeenMotion seen_motion(const std::vector<Segment>& segments) {
  SeenMotion out;
  if (segments.empty()) return out;
  out.low = 1e300, out.high = -1e300;
  for (const Segment& s : segments) {
    out.low = std::min(out.low, s.command.minCoeff());
    out.high = std::max(out.high, s.command.maxCoeff());
  }
  const MotionScale scale = motion_scale(segments);
  out.velocity = scale.velocity;
  out.acceleration = scale.acceleration;
  out.jerk = peak_jerk(segments);
  const Segment& last = segments.back();
  out.start = last.command(last.size() - 1);
  out.sample_time_s = last.sample_time_s;
  return out;
}

double TestMotion::duration_s() const {
  double sum = smoothing_s, from = start;
  for (const TestLeg& leg : legs) {
    sum += Trapezoid(leg.to - from, leg).duration_s() + leg.rest_s;
    from = leg.to;
  }
  return sum;
}

Eigen::ArrayXd TestMotion::command(double h) const {
  const auto window = std::max<Eigen::Index>(1, std::lround(smoothing_s / h));
  const auto n = static_cast<Eigen::Index>(std::ceil(duration_s() / h)) + window + 1;
  Eigen::ArrayXd sharp(n);
  Eigen::Index k = 0;
  double from = start, begin = 0.0;
  for (const TestLeg& leg : legs) {
    const Trapezoid move(leg.to - from, leg);
    const double end = begin + move.duration_s() + leg.rest_s, sign = leg.to < from ? -1.0 : 1.0;
    for (; k < n && static_cast<double>(k) * h < end; ++k)
      sharp(k) = from + sign * move.at(static_cast<double>(k) * h - begin);
    from = leg.to, begin = end;
  }
  sharp.tail(n - k).setConstant(from);
  Eigen::ArrayXd out(n);
  double sum = start * static_cast<double>(window);
  for (Eigen::Index i = 0; i < n; ++i) {
    sum += sharp(i) - (i >= window ? sharp(i - window) : start);
    out(i) = sum / static_cast<double>(window);
  }
  return out;
}

std::string gcode(const TestMotion& motion, const std::string& axis, bool rotary) {
  const double unit = rotary ? 180.0 / std::numbers::pi : 1e3;
  const char* length = rotary ? "deg" : "mm";
  double low = motion.start, high = motion.start, fastest = 0.0, hardest = 0.0;
  for (const TestLeg& leg : motion.legs) {
    low = std::min(low, leg.to), high = std::max(high, leg.to);
    fastest = std::max(fastest, leg.velocity), hardest = std::max(hardest, leg.acceleration);
  }
  std::string out =
      "(test motion of axis " + axis + ", " + text("%.0f s)\n", motion.duration_s()) +
      text("(from %.4f to %.4f %s, up to %.5g %s/min and %.4g %s/s^2: within the recorded %s)\n",
           unit * low, unit * high, length, 60.0 * unit * fastest, length, unit * hardest, length,
           motion.accelerates_more ? "travel and speed" : "motion") +
      text("(start position %.4f %s; record command and encoder throughout)\n", unit * motion.start,
           length) +
      "(G4 P is in seconds: convert it if the control uses another unit)\nG90 G94" +
      (rotary ? "\n" : " G21\n");
  // An axis name of one letter is an address word (X1.0); a longer name needs "=" (C1=1.0).
  const std::string address = axis.size() == 1 ? axis : axis + "=";
  const auto dwell = [&](double seconds) {
    if (seconds > 0.0) out += text("G4 P%.3f\n", seconds);
  };
  double acceleration = 0.0, place = motion.start;
  for (const TestLeg& leg : motion.legs) {
    if (!leg.shows.empty()) out += "(" + leg.shows + ")\n";
    if (leg.to != place) {
      if (leg.acceleration != acceleration)
        out += text("(axis acceleration %.4g %s/s^2, %.0f percent of the maximum)\n",
                    unit * leg.acceleration, length, 100.0 * leg.acceleration / hardest);
      acceleration = leg.acceleration;
      out += "G1 " + address + text("%.5f F%.4f\n", unit * leg.to, 60.0 * unit * leg.velocity);
      place = leg.to;
    }
    dwell(leg.rest_s);
  }
  return out + "M30\n";
}

}  // namespace servotwin
