#include "identification/loop/two_mass_poles.h"

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "twin/linear_algebra.h"
#include "twin/two_mass_axis.h"

namespace servotwin {

namespace {

using Polynomial = Eigen::VectorXd;  // coefficients, from the highest power on

Polynomial product(const Polynomial& l, const Polynomial& r) {
  Polynomial out = Polynomial::Zero(l.size() + r.size() - 1);
  for (Eigen::Index i = 0; i < l.size(); ++i) out.segment(i, r.size()) += l(i) * r;
  return out;
}

/// Gains and parts of an axis whose drive has a position gain and a PI velocity loop.
struct Drive {
  double velocity_gain, position_gain, omega, motor_share, reset;

  static constexpr Eigen::Index kCount = 5;  // reset last: it is 0 in a loop of order 2
  [[nodiscard]] static Drive from(const Eigen::VectorXd& x, bool integral) {
    return {std::exp(x(0)), std::exp(x(1)), std::exp(x(2)), 1.0 / (1.0 + std::exp(-x(3))),
            integral ? std::exp(x(4)) : 0.0};
  }
  [[nodiscard]] std::array<double, kMaxOrder> denominator(bool integral) const {
    return {velocity_gain, velocity_gain * (position_gain + reset),
            integral ? velocity_gain * reset * position_gain : 0.0};
  }
};

/// The characteristic polynomial of the loop of two masses (twin/two_mass_axis.h), monic.
Polynomial poles_of(const Drive& drive, double zeta, Encoders encoders, bool integral) {
  const double m = drive.motor_share, spring = drive.omega * drive.omega,
               damper = 2.0 * zeta * drive.omega;
  const Eigen::Vector3d swings(1.0, damper, spring);
  const Eigen::Vector3d pulls(0.0, damper, spring);  // the load follows the motor by their ratio
  const auto gain = drive.denominator(integral);
  // By powers of s: the motor's own mass and velocity loop, and the position control.
  Eigen::VectorXd motor = Eigen::VectorXd::Zero(integral ? 4 : 3), position = motor, load = motor;
  motor(0) = m;
  motor(1) = gain[0];
  load(0) = 1.0 - m;
  const double with_motor = integral ? drive.velocity_gain * drive.reset : 0.0;
  motor(2) = with_motor;
  position(2) = gain[1] - with_motor;
  if (integral) position(3) = gain[2];
  const bool by_load = encoders == Encoders::kLoad;
  Polynomial out =
      product(motor, swings) + product(load, pulls) + product(position, by_load ? pulls : swings);
  return out / out(0);
}

/// The drive whose loop has this polynomial, by Newton's method from several springs and masses: a
/// spring in the loop and its vibration can be far apart. As many equations as unknowns.
std::optional<Drive> drive_with(const Polynomial& wanted, const Drive& from, double zeta,
                                Encoders encoders, bool integral) {
  constexpr int kMaxSteps = 60;
  constexpr double kLongestStep = 0.5, kDifference = 1e-6, kFound = 1e-6;  // of the logarithms
  const Eigen::Index count = integral ? Drive::kCount : Drive::kCount - 1;
  const auto missed = [&](const Eigen::VectorXd& x) -> Eigen::VectorXd {
    const Polynomial has = poles_of(Drive::from(x, integral), zeta, encoders, integral);
    return (has.tail(count).array() / wanted.tail(count).array()).log().matrix();
  };
  for (const double softer : {1.0, 0.6, 1.6}) {
    for (const double share : {0.5, 0.25, 0.75}) {
      Eigen::VectorXd x(count);
      x.head(4) << std::log(from.velocity_gain), std::log(from.position_gain),
          std::log(softer * from.omega), std::log(share / (1.0 - share));
      if (integral) x(4) = std::log(from.reset);
      for (int step = 0; step < kMaxSteps; ++step) {
        const Eigen::VectorXd now = missed(x);
        if (!now.allFinite()) break;
        if (now.norm() < kFound) return Drive::from(x, integral);
        Eigen::MatrixXd slopes(count, count);
        for (Eigen::Index k = 0; k < count; ++k) {
          Eigen::VectorXd beside = x;
          beside(k) += kDifference;
          slopes.col(k) = (missed(beside) - now) / kDifference;
        }
        if (!slopes.allFinite()) break;
        const Eigen::VectorXd newton = least_squares(slopes, -now);
        x += newton * std::min(1.0, kLongestStep / newton.cwiseAbs().maxCoeff());
      }
    }
  }
  return std::nullopt;
}

}  // namespace

std::optional<Model> two_masses_with_poles_of(const Model& vibrating, const Model& rigid,
                                              std::size_t kind) {
  const Effect* mode = vibrating.find(kind_of<Compliance>());
  if (mode == nullptr || vibrating.loop.order != rigid.loop.order) return std::nullopt;
  const bool integral = rigid.loop.order == 3;
  const double omega = 2.0 * std::numbers::pi * mode->shape[0];
  Eigen::VectorXd loop = Eigen::VectorXd::Ones(rigid.loop.order + 1);
  for (int i = 0; i < rigid.loop.order; ++i)
    loop(i + 1) = vibrating.loop.denominator[static_cast<std::size_t>(i)];
  const Polynomial wanted =
      product(loop, Eigen::Vector3d(1.0, 2.0 * mode->shape[1] * omega, omega * omega));
  if (!(wanted.minCoeff() > 0.0)) return std::nullopt;

  Effect effect;
  effect.kind = kind;
  std::size_t i = 0;
  for (const Parameter& p : shapes_of(kind)) effect.shape[i++] = p.start;
  const double zeta = effect.shape[1];
  if (two_mass_parameters(effect).width > 0.0) return std::nullopt;
  const Encoders encoders = two_mass_parameters(effect).encoders;
  // With an integrator only the sum of position gain and reset is near what the loop has: halves.
  const double gain = (integral ? 0.5 : 1.0) * loop(2) / loop(1);
  const auto found =
      drive_with(wanted, {loop(1), gain, omega, 0.5, gain}, zeta, encoders, integral);
  if (!found) return std::nullopt;
  const Drive& drive = *found;
  effect.shape[0] = drive.omega / (2.0 * std::numbers::pi);
  effect.shape[2] = 1.0 - drive.motor_share;
  if (integral && encoders == Encoders::kLoad)
    effect.shape[TwoMassLoadEncoder::kResetAt] = drive.reset;
  i = 0;
  for (const Parameter& p : shapes_of(kind)) {
    if (!(effect.shape[i] >= p.lower && effect.shape[i] <= p.upper)) return std::nullopt;
    ++i;
  }
  Model out = rigid;
  const auto last = static_cast<std::size_t>(rigid.loop.order - 1);
  out.loop.denominator = drive.denominator(integral);
  // Of the error at constant speed (order 2), of its growth with acceleration (order 3), and of the
  // force: all are relative to the last coefficient.
  const double stiffer = out.loop.denominator[last] / rigid.loop.denominator[last];
  for (std::size_t k = 1; k <= last; ++k) out.loop.numerator[k] *= stiffer;
  for (Effect& one : out.effects) {
    if (!is_friction(one.kind)) continue;
    for (double& c : one.coefficient) c *= stiffer;
  }
  out.effects.push_back(effect);
  return why_invalid(out).empty() ? std::optional(out) : std::nullopt;
}

}  // namespace servotwin
