#include "identification/torque/hysteresis.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "twin/hold.h"

namespace servotwin {

namespace {

constexpr int kPoints = 50;

/// The samples at which the motion turns, if it went at least `travel` each way.
std::vector<Eigen::Index> turns_of(const Eigen::ArrayXd& x, double travel) {
  std::vector<Eigen::Index> turns;
  Eigen::Index low = 0, high = 0;  // the extremes since the last turn
  int direction = 0;
  for (Eigen::Index k = 1; k < x.size(); ++k) {
    if (x(k) > x(high)) high = k;
    if (x(k) < x(low)) low = k;
    if (direction >= 0 && x(high) - x(k) >= travel) {
      if (direction > 0) turns.push_back(high);
      direction = -1;
      low = k;
    } else if (direction <= 0 && x(k) - x(low) >= travel) {
      if (direction < 0) turns.push_back(low);
      direction = 1;
      high = k;
    }
  }
  return turns;
}

}  // namespace

VirginCurve virgin_curve_of(const std::vector<Segment>& segments, double travel, double mass) {
  if (!(travel > 0.0)) throw std::runtime_error("the travel of a reversal must be positive");
  std::vector<Eigen::ArrayXd> branches;
  for (const Segment& s : segments) {
    if (s.torque.size() == 0) continue;
    const Spline position = Spline::through(s.actual, s.sample_time_s);
    const Eigen::ArrayXd friction = s.torque - mass * position.second;
    for (const Eigen::Index turn : turns_of(s.actual, travel)) {
      // The force where the travel passes each point, between the samples beside it.
      Eigen::ArrayXd branch(kPoints + 1);
      branch(0) = 0.0;
      int filled = 0;
      const auto gone = [&](Eigen::Index k) { return std::abs(s.actual(k) - s.actual(turn)); };
      Eigen::Index turns_within = 1;
      for (Eigen::Index k = turn + 1; k < s.size() && filled < kPoints; ++k) {
        turns_within = k - turn;
        while (filled < kPoints && gone(k) >= travel * (filled + 1) / kPoints) {
          const double want = travel * (filled + 1) / kPoints, before = gone(k - 1);
          const double share =
              gone(k) > before ? std::clamp((want - before) / (gone(k) - before), 0.0, 1.0) : 1.0;
          branch(++filled) = friction(k - 1) + share * (friction(k) - friction(k - 1));
        }
      }
      if (filled < kPoints || !branch.isFinite().all()) continue;
      branch.tail(kPoints) -= friction(turn);
      // Friction rises towards where the axis travels.
      const Eigen::Index next = std::min<Eigen::Index>(turn + turns_within, s.size() - 1);
      branches.push_back(s.actual(next) > s.actual(turn) ? branch : Eigen::ArrayXd(-branch));
    }
  }
  if (branches.empty()) {
    throw std::runtime_error(
        "there is no reversal with torque and enough travel on both sides of it: move back and "
        "forth slowly, by more than the travel in which friction builds up");
  }
  VirginCurve curve;
  curve.branches = static_cast<int>(branches.size());
  curve.displacement = 0.5 * Eigen::ArrayXd::LinSpaced(kPoints + 1, 0.0, travel);
  curve.force = curve.deviation = Eigen::ArrayXd::Zero(kPoints + 1);
  const auto count = static_cast<double>(branches.size());
  for (const Eigen::ArrayXd& branch : branches) curve.force += 0.5 * branch / count;
  for (const Eigen::ArrayXd& branch : branches)
    curve.deviation += (0.5 * branch - curve.force).square() / (count * std::max(1.0, count - 1.0));
  curve.deviation = curve.deviation.sqrt();
  return curve;
}

}  // namespace servotwin
