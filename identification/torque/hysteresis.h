// The virgin curve of friction from measured hysteresis, by halving its reversal branches.
//
// Friction with non-local memory leaves a reversal at (x_m, F_m) along
//   F = F_m - 2 f((x_m - x) / 2),      f: the virgin curve                      (Masing's rule)
// so half of the force over half of the travel since a reversal is the virgin curve, whatever the
// motion before, if the axis had been sliding long enough. The mean over branches of both
// directions does not depend on a constant load or on a difference between the directions. The
// effect of speed is not removed: reversals must be slow. Sources: Masing 1926; Al-Bender, Lampaert
// and Swevers 2005; thesis 4.4.2 (docs/theory.md 9.3 and Sources).
//
// Units: m or rad; the force as recorded. Allocates. Any thread.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "twin/sample.h"

namespace servotwin {

struct VirginCurve {
  Eigen::ArrayXd displacement;  ///< half of the travel since the reversal, rising from 0
  Eigen::ArrayXd force;         ///< mean over the branches
  Eigen::ArrayXd deviation;     ///< standard deviation of that mean
  int branches = 0;
};

/// From every reversal of the measured motion with at least `travel` [m | rad], > 0, before and
/// after it. `mass` is the moved mass in the unit of the torque per m/s^2. Throws
/// std::runtime_error where there is no such reversal or no torque.
[[nodiscard]] VirginCurve virgin_curve_of(const std::vector<Segment>& segments, double travel,
                                          double mass);

}  // namespace servotwin
