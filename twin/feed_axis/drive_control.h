// The cascade control of a drive: P position, PI velocity, filters of the torque command and
// current loop, all in one cycle (Ferkl et al. 2021, section 2; docs/theory.md 16.2).
//
//   v_c = K_p (x_r - x_m),   e = (v_c - v_m) / radius,   I += K_vp h / T_n e,   T_c = K_vp e + I
//   T = current loop of (band-stops, low-pass of T_c)
//
// x_m and v_m are those of the motor in the units of the table [m, m/s]. The current loop is a
// first-order lag, or PI on R and L if their data are given; its torque is the mean over the
// following cycle. Filters are discretised by Tustin's rule, exact at their own frequency.
//
// Errors: none. One thread; step() allocates nothing and throws nothing.
#pragma once

#include <Eigen/Core>
#include <complex>
#include <vector>

#include "twin/feed_axis/parts.h"

namespace servotwin {

class DriveControl {
 public:
  DriveControl(const ControlParts& parts, double radius);

  void reset() noexcept;
  /// One cycle: from command, position and velocity at its start [m, m/s] to the motor's torque
  /// during it [Nm].
  double step(double command, double position, double velocity) noexcept;

  /// From the velocity error [m/s] to the torque [Nm]: s <- A s + b e, T = c s + d e.
  struct Linear {
    Eigen::MatrixXd a;
    Eigen::VectorXd b;
    Eigen::RowVectorXd c;
    double d = 0.0;
    [[nodiscard]] std::complex<double> at(std::complex<double> z) const;
  };
  [[nodiscard]] Linear linear() const;
  [[nodiscard]] double step_s() const { return step_s_; }

 private:
  /// Transposed direct form II, of at most second order.
  struct Filter {
    double b0 = 1.0, b1 = 0.0, b2 = 0.0, a1 = 0.0, a2 = 0.0;
    double s1 = 0.0, s2 = 0.0;
    double step(double in) noexcept;
  };
  static Filter low_pass(double frequency_hz, double step_s);
  static Filter band_stop(const BandStop& stop, double step_s);
  static Filter current_loop(const ControlParts& parts, double step_s);

  double step_s_, radius_, position_gain_, velocity_gain_, integral_gain_;
  double integral_ = 0.0;
  std::vector<Filter> filters_;  // the last one is the current loop
};

}  // namespace servotwin
