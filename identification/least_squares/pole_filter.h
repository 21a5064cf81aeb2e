// One pole, or one pair of them, stepped exactly along an input (docs/theory.md 15.3).
//
//   y = u / M,   M = s + omega   or   s^2 + 2 zeta omega s + omega^2
//   g = y / M behind it, where derivatives by the pole are wanted
//
// States: y and, of a pair, y'; then g and g'. The input is a cubic or a straight line over every
// step (twin/hold.h). Any thread.
#pragma once

#include <Eigen/Core>
#include <cmath>

#include "twin/hold.h"

namespace servotwin {

class PoleFilter {
 public:
  /// `value`: log omega and, of a pair, log zeta; h [s].
  PoleFilter(bool pair, const double* value, double h, bool derivatives)
      : pair_(pair), states_((pair ? 2 : 1) * (derivatives ? 2 : 1)) {
    omega_ = std::exp(value[0]);
    a_ = 2.0 * (pair ? std::exp(value[1]) : 1.0) * omega_;
    b_ = omega_ * omega_;
    const int n = width();
    Eigen::MatrixXd system = Eigen::MatrixXd::Zero(states_, states_);
    for (int first = 0; first < states_; first += n) {
      if (pair) {
        system(first, first + 1) = 1.0;
        system(first + 1, first) = -b_;
        system(first + 1, first + 1) = -a_;
      } else {
        system(first, first) = -omega_;
      }
    }
    if (derivatives) system(states_ - 1, 0) = 1.0;
    Eigen::VectorXd input = Eigen::VectorXd::Zero(states_);
    input(n - 1) = 1.0;
    const Hold hold = discretise(system, input, h, 2);
    phi_.topLeftCorner(states_, states_) = hold.phi;
    gain_.topRows(states_) = hold.g;
  }

  [[nodiscard]] int width() const { return pair_ ? 2 : 1; }
  [[nodiscard]] double omega() const { return omega_; }
  [[nodiscard]] double a() const { return a_; }
  [[nodiscard]] double b() const { return b_; }

  /// Calls put(k, state) for every sample of the response from rest.
  template <class Put>
  void answer(const Spline& u, Eigen::Index count, Put put) const {
    Eigen::Vector4d w = Eigen::Vector4d::Zero();
    for (Eigen::Index k = 0; k < count; ++k) {
      put(k, w);
      w = (phi_ * w + gain_ * Eigen::Vector3d(u.value(k), u.first(k), u.second(k))).eval();
    }
  }
  /// The same for the free response from a unit value of one state.
  template <class Put>
  void free_motion(int start, Eigen::Index count, Put put) const {
    Eigen::Vector4d w = Eigen::Vector4d::Zero();
    w(start) = 1.0;
    for (Eigen::Index k = 0; k < count; ++k) {
      put(k, w);
      w = (phi_ * w).eval();
    }
  }

 private:
  bool pair_;
  int states_;
  double omega_ = 0.0, a_ = 0.0, b_ = 0.0;
  Eigen::Matrix4d phi_ = Eigen::Matrix4d::Zero();
  Eigen::Matrix<double, 4, 3> gain_ = Eigen::Matrix<double, 4, 3>::Zero();
};

}  // namespace servotwin
