// The linear loop of an axis as matrices, for programs that use a linear system (docs/theory.md
// 2.5).
//
//   w' = a w + b u,  out = c w + d u       u: command velocity, disturbance force per moved mass
//                                          out: tracking error, position, velocity of the axis
//   w_(n+1) = phi w_n + g u_n              u_n: velocity, acceleration and jerk of the command, the
//                                          disturbance and its rate, at the start of the cycle
//
// The states are those of the observer canonical form of P and of every mode, whose first states
// sum to the tracking error, and the commanded position. Exact if the command is a cubic and the
// disturbance a straight line over each cycle; columns 0 and 3 alone are the zero-order hold.
// Effects and the command's delay are not included.
//
// An axis of two masses (twin/two_mass_axis.h, without play) has two forces, on motor and load, in
// columns of their own, and two more outputs: the velocities of motor and load; those of the axis
// are of the recorded encoder. Its states are (e1, e1', q, q', I) and the commanded position. From
// the two rates the part is taken off that acceleration feed-forward gives at once: a constant
// times the command's velocity.
//
// Units: m | rad, s. Errors: none. Allocates; any thread.
#pragma once

#include <Eigen/Core>

#include "twin/two_mass_axis.h"

namespace servotwin {

struct StateSpace {
  Eigen::MatrixXd a, b, c, d;
  Eigen::MatrixXd phi, g;
};

/// `loop` is stable, sample_time_s > 0.
[[nodiscard]] StateSpace state_space(const Loop& loop, double sample_time_s);
/// `loop` is stable with these two masses.
[[nodiscard]] StateSpace state_space(const Loop& loop, const TwoMassParameters& two_masses,
                                     double sample_time_s);

}  // namespace servotwin
