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

constexpr double kStartOfFrictionShare = 0.9;  // on the load: within its bounds

using Polynomial = Eigen::VectorXd;  // coefficients, from the highest power on

Polynomial product(const Polynomial& l, const Polynomial& r) {
  Polynomial out = Polynomial::Zero(l.size() + r.size() - 1);
  for (Eigen::Index i = 0; i < l.size(); ++i) out.segment(i, r.size()) += l(i) * r;
  return out;
}

/// Gains of the loop, and the parts of the axis.
struct Drive {
  std::array<double, kMaxOrder> gain{};  // a1, a2, a3
  double omega, motor_share, reset = 0.0;

  /// Logarithms of a1, the position gain, omega, the ratio of the masses and, with an integrator,
  /// its reset rate. Where the motor's encoder closes the loop, gain and reset cannot be told from
  /// each other: a2 / a1 and a3 / a2 in their place.
  [[nodiscard]] static Drive from(const Eigen::VectorXd& x, bool integral, bool by_load) {
    Drive out{{}, std::exp(x(2)), 1.0 / (1.0 + std::exp(-x(3)))};
    const double a1 = std::exp(x(0)), position = std::exp(x(1)),
                 last = integral ? std::exp(x(4)) : 0.0;
    if (by_load) {
      out.reset = last;
      out.gain = {a1, a1 * (position + last), a1 * position * last};
    } else {
      out.gain = {a1, a1 * position, a1 * position * last};
    }
    return out;
  }
  static constexpr Eigen::Index kCount = 5;  // of the unknowns; one less without an integrator
};

/// The characteristic polynomial of the loop of two masses (twin/two_mass_axis.h), monic.
Polynomial poles_of(const Drive& drive, double zeta, Encoders encoders, bool integral) {
  const double m = drive.motor_share, spring = drive.omega * drive.omega,
               damper = 2.0 * zeta * drive.omega;
  const Eigen::Vector3d swings(1.0, damper, spring);
  const Eigen::Vector3d pulls(0.0, damper, spring);  // the load follows the motor by their ratio
  // By powers of s: the motor's own mass and velocity loop, and the position control.
  Eigen::VectorXd motor = Eigen::VectorXd::Zero(integral ? 4 : 3), position = motor, load = motor;
  motor(0) = m;
  motor(1) = drive.gain[0];
  load(0) = 1.0 - m;
  const double with_motor = drive.gain[0] * drive.reset;
  motor(2) = with_motor;
  position(2) = drive.gain[1] - with_motor;
  if (integral) position(3) = drive.gain[2];
  const bool by_load = encoders == Encoders::kLoad;
  Polynomial out =
      product(motor, swings) + product(load, pulls) + product(position, by_load ? pulls : swings);
  return out / out(0);
}

/// The drive whose loop has this polynomial, by Newton's method from the gains of `loop`, a rigid
/// one, and several springs and masses: a spring in the loop and its vibration, `omega`, can be far
/// apart. As many equations as unknowns.
std::optional<Drive> drive_with(const Polynomial& wanted, const Polynomial& loop, double omega,
                                double zeta, Encoders encoders) {
  constexpr int kMaxSteps = 60;
  constexpr double kLongestStep = 0.5, kDifference = 1e-6, kFound = 1e-6;  // of the logarithms
  const bool integral = loop.size() > kMaxOrder, by_load = encoders == Encoders::kLoad;
  const Eigen::Index count = integral ? Drive::kCount : Drive::kCount - 1;
  const auto missed = [&](const Eigen::VectorXd& x) -> Eigen::VectorXd {
    const Polynomial has = poles_of(Drive::from(x, integral, by_load), zeta, encoders, integral);
    return (has.tail(count).array() / wanted.tail(count).array()).log().matrix();
  };
  for (const double softer : {1.0, 0.6, 1.6}) {
    for (const double share : {0.5, 0.25, 0.75}) {
      Eigen::VectorXd x(count);
      // Of position gain and reset the sum is near what the loop has: halves.
      const double half = integral && by_load ? 0.5 : 1.0;
      x.head(4) << std::log(loop(1)), std::log(half * loop(2) / loop(1)), std::log(softer * omega),
          std::log(share / (1.0 - share));
      if (integral) x(4) = by_load ? x(1) : std::log(loop(3) / loop(2));
      for (int step = 0; step < kMaxSteps; ++step) {
        const Eigen::VectorXd now = missed(x);
        if (!now.allFinite()) break;
        if (now.norm() < kFound) return Drive::from(x, integral, by_load);
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
  if (mode == nullptr || two_mass_of(vibrating) != nullptr) return std::nullopt;
  return two_masses_with_poles(vibrating.loop, {mode->shape[0], mode->shape[1]}, rigid, kind);
}

std::optional<Model> two_masses_with_poles(const Loop& beside, const PolePair& pair,
                                           const Model& rigid, std::size_t kind) {
  if (beside.order != rigid.loop.order) return std::nullopt;
  const double omega = 2.0 * std::numbers::pi * pair.frequency_hz;
  Eigen::VectorXd loop = Eigen::VectorXd::Ones(rigid.loop.order + 1);
  for (int i = 0; i < rigid.loop.order; ++i)
    loop(i + 1) = beside.denominator[static_cast<std::size_t>(i)];
  const Polynomial wanted =
      product(loop, Eigen::Vector3d(1.0, 2.0 * pair.damping * omega, omega * omega));
  if (!(wanted.minCoeff() > 0.0)) return std::nullopt;

  Effect effect;
  effect.kind = kind;
  std::size_t i = 0;
  for (const Parameter& p : shapes_of(kind)) effect.shape[i++] = p.start;
  const double zeta = effect.shape[1];
  if (two_mass_parameters(effect).width > 0.0) return std::nullopt;
  const Encoders encoders = two_mass_parameters(effect).encoders;
  const auto found = drive_with(wanted, loop, omega, zeta, encoders);
  if (!found) return std::nullopt;
  const Drive& drive = *found;
  effect.shape[0] = drive.omega / (2.0 * std::numbers::pi);
  effect.shape[2] = 1.0 - drive.motor_share;
  effect.shape[3] = kStartOfFrictionShare;
  if (drive.reset > 0.0) effect.shape[TwoMassLoadEncoder::kResetAt] = drive.reset;
  i = 0;
  for (const Parameter& p : shapes_of(kind)) {
    if (!(effect.shape[i] >= p.lower && effect.shape[i] <= p.upper)) return std::nullopt;
    ++i;
  }
  Model out = rigid;
  const auto last = static_cast<std::size_t>(rigid.loop.order - 1);
  out.loop.denominator = drive.gain;
  // Lag at constant speed and error by a constant force (order 2), lag at constant acceleration and
  // the area of the error after a step of force (order 3) are relative to the last coefficient.
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
