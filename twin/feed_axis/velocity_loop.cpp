#include "twin/feed_axis/velocity_loop.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <complex>
#include <numbers>

#include "twin/feed_axis/drive_control.h"
#include "twin/feed_axis/full_mechanics.h"
#include "twin/linear_algebra.h"

namespace servotwin {
namespace {

using Complex = std::complex<double>;

struct VelocityLoop {
  DriveControl::Linear control;
  HeldMechanics mechanics;
  Eigen::RowVectorXd velocity;  // the motor's, of (q, q') [m/s]
  double step_s = 0.0;
};

VelocityLoop loop_of(const FeedAxisParts& parts, double nut) {
  const BallScrew screw(parts);
  const DriveControl control(parts.control, screw.radius);
  Eigen::RowVectorXd velocity = Eigen::RowVectorXd::Zero(2 * screw.size());
  velocity.tail(screw.size()) = screw.radius * screw.motor.transpose();
  return {control.linear(), held(screw, nut, control.step_s()), velocity, control.step_s()};
}

/// L(z): open at the velocity's error.
Eigen::ArrayXcd open_loop(const VelocityLoop& loop, const Eigen::ArrayXd& frequency_hz) {
  // Triangular once; then every frequency is one substitution.
  const Eigen::ComplexSchur<Eigen::MatrixXcd> schur(loop.mechanics.phi.cast<Complex>());
  const Eigen::VectorXcd in = schur.matrixU().adjoint() * loop.mechanics.gain.col(0);
  const Eigen::RowVectorXcd out = loop.velocity * schur.matrixU();
  Eigen::ArrayXcd response(frequency_hz.size());
  Eigen::MatrixXcd shifted = -schur.matrixT();
  for (Eigen::Index k = 0; k < frequency_hz.size(); ++k) {
    const Complex z = std::polar(1.0, 2.0 * std::numbers::pi * frequency_hz(k) * loop.step_s);
    shifted.diagonal() = z - schur.matrixT().diagonal().array();
    const Eigen::VectorXcd state = shifted.triangularView<Eigen::Upper>().solve(in);
    response(k) = loop.control.at(z) * (out * state)(0);
  }
  return response;
}

bool stable(const VelocityLoop& loop) {
  constexpr double kRounding = 1e-7;  // the rigid position stays where it is: 1
  const DriveControl::Linear& control = loop.control;
  const Eigen::Index n = loop.mechanics.phi.rows(), m = control.a.rows();
  Eigen::MatrixXd closed(n + m, n + m);
  closed << loop.mechanics.phi - loop.mechanics.gain.col(0) * control.d * loop.velocity,
      loop.mechanics.gain.col(0) * control.c, -control.b * loop.velocity, control.a;
  return eigenvalues(closed).cwiseAbs().maxCoeff() < 1.0 + kRounding;
}

double decibels(double gain) { return 20.0 * std::log10(gain); }

/// Where a line between two points is 0, as a share of the way; their signs differ.
double crossing(double from, double to) { return from / (from - to); }

}  // namespace

Eigen::ArrayXcd closed_velocity_loop(const FeedAxisParts& parts, double nut,
                                     const Eigen::ArrayXd& frequency_hz) {
  const Eigen::ArrayXcd open = open_loop(loop_of(parts, nut), frequency_hz);
  return open / (1.0 + open);
}

LoopFigures velocity_loop_figures(const FeedAxisParts& parts, double nut) {
  constexpr Eigen::Index kFrequencies = 3000;
  const Eigen::ArrayXd f = logarithmic(1.0, 0.499 * parts.control.rate_hz, kFrequencies);
  const VelocityLoop loop = loop_of(parts, nut);
  const Eigen::ArrayXcd open = open_loop(loop, f), closed = open / (1.0 + open);
  const Eigen::ArrayXd gain = open.abs().log10() * 20.0, answer = closed.abs();
  LoopFigures out;
  out.stable = stable(loop);
  Eigen::Index highest = 0;
  out.peak_db = decibels(answer.maxCoeff(&highest));
  out.peak_hz = f(highest);
  const double half = std::sqrt(0.5);
  Eigen::Index below = 0;
  while (below < f.size() && answer(below) >= half) ++below;
  out.bandwidth_hz = f(std::min(below, f.size() - 1));
  const auto least = [](std::optional<double>& margin, double found) {
    margin = margin ? std::min(*margin, found) : found;
  };
  for (Eigen::Index k = 1; k < f.size(); ++k) {
    // -180 degrees: the imaginary part changes sign left of the origin.
    if ((open(k - 1).imag() < 0.0) != (open(k).imag() < 0.0)) {
      const double share = crossing(open(k - 1).imag(), open(k).imag());
      const double real = (1.0 - share) * open(k - 1).real() + share * open(k).real();
      if (real < 0.0 && (real > -1.0 || !out.stable)) least(out.gain_margin_db, -decibels(-real));
    }
    if ((gain(k - 1) < 0.0) != (gain(k) < 0.0)) {
      const double share = crossing(gain(k - 1), gain(k));
      const Complex at = (1.0 - share) * open(k - 1) + share * open(k);
      least(out.phase_margin_deg, std::abs(std::arg(-at)) * 180.0 / std::numbers::pi);
    }
  }
  return out;
}

Eigen::ArrayXd logarithmic(double from, double to, Eigen::Index count) {
  return Eigen::ArrayXd::LinSpaced(count, std::log(from), std::log(to)).exp();
}

}  // namespace servotwin
