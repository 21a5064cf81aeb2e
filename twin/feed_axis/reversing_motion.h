// The test motion of paper 002 (2, fig. 3): to and fro, each way up to half of a speed, up to the
// speed, down to half and to rest, with one acceleration and the same time at each half.
//
// The travel is split evenly about the middle. Where it does not hold the two plateaus the speed is
// what it holds. Errors: std::invalid_argument for what is not positive. Allocates. Any thread.
#pragma once

#include <Eigen/Core>

namespace servotwin {

struct ReversingMotion {
  double speed = 0.0;          ///< most [m/s]
  double travel = 0.0;         ///< one way [m]
  double acceleration = 10.0;  ///< [m/s^2]
  double half_s = 0.06;        ///< at half of the speed, up and down
  double rest_s = 1.0;         ///< after each way
  int cycles = 1;
};

/// The commanded position from 0, rate [Hz]; the true motion at the samples, ends included.
[[nodiscard]] Eigen::ArrayXd sampled(const ReversingMotion& motion, double rate_hz);

}  // namespace servotwin
