// The test motion of Ferkl et al. 2021 (section 2, fig. 3): back and forth; each way accelerates to
// half of the speed, then to the speed, and decelerates to half and to rest, with one acceleration
// and the same time at each half speed.
//
// The travel is split evenly about the middle. If the travel is too short for the two plateaus, the
// speed is reduced to what it allows. SI units. Errors: std::invalid_argument for values that are
// not positive. Allocates. Any thread.
#pragma once

#include <Eigen/Core>

namespace servotwin {

struct ReversingMotion {
  double speed = 0.0;          ///< maximum [m/s]
  double travel = 0.0;         ///< one way [m]
  double acceleration = 10.0;  ///< [m/s^2]
  double half_s = 0.06;        ///< time at half speed, up and down [s]
  double rest_s = 1.0;         ///< after each way [s]
  int cycles = 1;
};

/// The commanded position [m], starting at 0, at `rate_hz`: the exact motion, both ends included.
[[nodiscard]] Eigen::ArrayXd sampled(const ReversingMotion& motion, double rate_hz);

}  // namespace servotwin
