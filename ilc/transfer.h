// The linear response of a drive to its command.
//
//   x = T(s) x_r,   T(s) = exp(-s tau) (1 - s N(s)/P(s) - (s | 1)/P(s) sum_i D_i(s))
//
// P and N are those of the loop (twin/loop.h), tau is the command's delay, and D_i the disturbance
// per command of a mode of vibration (`compliance`). Linear parts of other effects are added to the
// loop: viscous friction B' makes a1 + B' and c1 + B', missing feed-forward changes c1 and c0.
// Nonlinear effects are not part of T; the trials on the twin include them.
//
// T of an axis of two masses is that of twin/two_mass_axis.h without play, with the spring's
// resonance in it and with viscous friction on the body on which it acts.
//
// T(0) = 1. Frequencies in rad/s, times in s. A mode that moves with position is taken at the
// middle of the travel. Errors: none. Any thread. Source: docs/theory.md 13.1.
#pragma once

#include <Eigen/Core>
#include <complex>
#include <optional>
#include <vector>

#include "twin/two_mass_axis.h"

namespace servotwin {

/// The widest band that a law of learning or a filter of feed-forward is given, as a share of the
/// Nyquist frequency.
inline constexpr double kMaxBandwidthOfNyquist = 0.8;

struct Transfer {
  /// A table behind a spring: d = -(spring w + damper s) s^2 / (s^2 + 2 zeta w s + w^2) x_r.
  struct Table {
    double omega = 0.0, zeta = 0.0, spring = 0.0, damper = 0.0;
  };

  Loop loop;             ///< with the linear parts of the effects
  double delay_s = 0.0;  ///< tau; below 0: the record leads
  std::vector<Table> tables;
  std::optional<TwoMassParameters> two_masses;
  double motor_viscous = 0.0, load_viscous = 0.0;  ///< of two masses, per moved mass of both [1/s]

  [[nodiscard]] std::complex<double> at(double omega) const;
  /// From a disturbance to the tracking error, (s | 1)/P and the modes of vibration; of two masses
  /// from one on the motor.
  [[nodiscard]] std::complex<double> compliance_at(double omega) const;
  /// Of two masses: from a disturbance on the load.
  [[nodiscard]] std::complex<double> load_compliance_at(double omega) const;
  /// The lag at constant speed [s]: c_(n-1)/a_n + tau plus beta/omega^2 of every mode.
  [[nodiscard]] double lag_s() const;
};

/// Of a valid model (why_invalid is empty).
[[nodiscard]] Transfer transfer_of(const Model& model);

/// Response of the position to a command that is 1 at one sample and 0 at all others, linear
/// between samples (first-order hold): the first column of the lifted T. Tables behind springs are
/// left out. A delay is interpolated linearly too. `h` [s] > 0. Allocates.
[[nodiscard]] Eigen::ArrayXd impulse_response(const Transfer& transfer, double h,
                                              Eigen::Index samples);

}  // namespace servotwin
