// The linear answer of a drive to its command.
//
//   x = T(s) x_r,   T(s) = exp(-s tau) (1 - s N(s)/P(s) - (s | 1)/P(s) sum_i D_i(s))
//
// with P, N of the loop (twin/loop.h), tau the command's delay, and D_i what a mode of vibration
// (`compliance`) disturbs by per command. The parts of other effects that are linear count into the
// loop: viscous friction B' makes a1 + B' and c1 + B', feed-forward that is missing moves c1 and
// c0. What else an effect does is not linear and no part of T; virtual trials see it.
//
// T(0) = 1. Frequencies in rad/s. A mode that moves with position is taken where it is in the
// middle of the travel. Any thread.
#pragma once

#include <Eigen/Core>
#include <complex>
#include <vector>

#include "twin/model.h"

namespace servotwin {

struct Transfer {
  /// A table behind a spring: d = -(spring w + damper s) s^2 / (s^2 + 2 zeta w s + w^2) x_r.
  struct Table {
    double omega = 0.0, zeta = 0.0, spring = 0.0, damper = 0.0;
  };

  Loop loop;             ///< with the linear parts of the effects
  double delay_s = 0.0;  ///< tau; below 0: the record leads
  std::vector<Table> tables;

  [[nodiscard]] std::complex<double> at(double omega) const;
  /// From a disturbance to the tracking error, (s | 1)/P and the modes of vibration.
  [[nodiscard]] std::complex<double> compliance_at(double omega) const;
  /// The lag at constant speed, c_(n-1)/a_n + tau, and beta/omega^2 of every mode [s].
  [[nodiscard]] double lag_s() const;
};

/// Of a valid model (why_invalid is empty).
[[nodiscard]] Transfer transfer_of(const Model& model);

/// What the position does after the command of one sample alone was 1, straight lines between the
/// samples (first-order hold): the first column of the lifted T. Tables behind springs are left
/// out. A delay of whole and broken samples is taken by straight lines too. Allocates.
[[nodiscard]] Eigen::ArrayXd impulse_response(const Transfer& transfer, double h,
                                              Eigen::Index samples);

}  // namespace servotwin
