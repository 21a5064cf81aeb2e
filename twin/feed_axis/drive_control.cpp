#include "twin/feed_axis/drive_control.h"

#include <cmath>

#include "twin/linear_algebra.h"
#include "twin/two_pi.h"

namespace servotwin {

DriveControl::DriveControl(const ControlParts& parts, double radius)
    : step_s_(1.0 / parts.rate_hz),
      radius_(radius),
      position_gain_(parts.position_gain),
      velocity_gain_(parts.velocity_gain),
      integral_gain_(parts.velocity_gain * step_s_ / parts.reset_time) {
  for (const BandStop& stop : parts.band_stops) filters_.push_back(band_stop(stop, step_s_));
  if (parts.low_pass_hz) filters_.push_back(low_pass(*parts.low_pass_hz, step_s_));
  filters_.push_back(current_loop(parts, step_s_));
}

DriveControl::Filter DriveControl::low_pass(double frequency_hz, double step_s) {
  const double t = std::tan(kTwoPi * frequency_hz * step_s / 2.0);
  return {.b0 = t / (1.0 + t), .b1 = t / (1.0 + t), .a1 = (t - 1.0) / (1.0 + t)};
}

DriveControl::Filter DriveControl::band_stop(const BandStop& stop, double step_s) {
  const double w = kTwoPi * stop.frequency_hz, t = std::tan(w * step_s / 2.0),
               wide = t * stop.bandwidth_hz / stop.frequency_hz,
               left = t * stop.numerator_bandwidth_hz / stop.frequency_hz,
               norm = 1.0 + wide + t * t;
  return {.b0 = (1.0 + left + t * t) / norm,
          .b1 = 2.0 * (t * t - 1.0) / norm,
          .b2 = (1.0 - left + t * t) / norm,
          .a1 = 2.0 * (t * t - 1.0) / norm,
          .a2 = (1.0 - wide + t * t) / norm};
}

/// The lag answers within the cycle. With R and L: u = K (e + h / T_i sum e), i+ = a i + g u,
/// T = k (i + i+) / 2; from the command to the torque a filter of second order.
DriveControl::Filter DriveControl::current_loop(const ControlParts& parts, double step_s) {
  if (!parts.current_loop) {
    const double left = std::exp(-kTwoPi * parts.current_loop_hz * step_s);
    return {.b0 = 1.0 - left, .a1 = -left};
  }
  const CurrentLoopParts& loop = *parts.current_loop;
  const double a = std::exp(-loop.resistance / loop.inductance * step_s),
               g = (1.0 - a) / loop.resistance * loop.gain, r = step_s / loop.reset_time;
  // i / i* = g ((1 + r) z - 1) / ((z - a)(z - 1) + g ((1 + r) z - 1)), and (1 + z) / 2 of it.
  const double c = g * (1.0 + r) / 2.0, d = -g / 2.0;
  return {.b0 = c, .b1 = c + d, .b2 = d, .a1 = -(a + 1.0) + 2.0 * c, .a2 = a + 2.0 * d};
}

double DriveControl::Filter::step(double in) noexcept {
  const double out = b0 * in + s1;
  s1 = b1 * in - a1 * out + s2;
  s2 = b2 * in - a2 * out;
  return out;
}

void DriveControl::reset() noexcept {
  integral_ = 0.0;
  for (Filter& filter : filters_) filter.s1 = filter.s2 = 0.0;
}

double DriveControl::step(double command, double position, double velocity) noexcept {
  const double error = (position_gain_ * (command - position) - velocity) / radius_;
  integral_ += integral_gain_ * error;
  double torque = velocity_gain_ * error + integral_;
  for (Filter& filter : filters_) torque = filter.step(torque);
  return torque;
}

DriveControl::Linear DriveControl::linear() const {
  const auto size = static_cast<Eigen::Index>(1 + 2 * filters_.size());
  Linear out{Eigen::MatrixXd::Zero(size, size), Eigen::VectorXd::Zero(size),
             Eigen::RowVectorXd::Zero(size), (velocity_gain_ + integral_gain_) / radius_};
  out.a(0, 0) = out.c(0) = 1.0;
  out.b(0) = integral_gain_ / radius_;
  Eigen::Index i = 1;
  for (const Filter& f : filters_) {
    const double first = f.b1 - f.a1 * f.b0, second = f.b2 - f.a2 * f.b0;
    out.a.row(i) = first * out.c;
    out.a(i, i) -= f.a1;
    out.a(i, i + 1) = 1.0;
    out.a.row(i + 1) = second * out.c;
    out.a(i + 1, i) -= f.a2;
    out.b(i) = first * out.d;
    out.b(i + 1) = second * out.d;
    out.c *= f.b0;
    out.c(i) = 1.0;
    out.d *= f.b0;
    i += 2;
  }
  return out;
}

std::complex<double> DriveControl::Linear::at(std::complex<double> z) const {
  Eigen::MatrixXcd shifted = -a.cast<std::complex<double>>();
  shifted.diagonal().array() += z;
  return d + (c * solve_square(shifted, b.cast<std::complex<double>>()).x)(0);
}

}  // namespace servotwin
