#include "ilc/transfer.h"

#include <cmath>
#include <numbers>
#include <vector>

#include "twin/hold.h"
#include "twin/state_space.h"

namespace servotwin {
namespace {

using Complex = std::complex<double>;

/// s^n + a1 s^(n-1) + ... + an
Complex denominator_at(const Loop& loop, Complex s) {
  Complex p = 1.0;
  for (int i = 0; i < loop.order; ++i) p = p * s + loop.denominator[static_cast<std::size_t>(i)];
  return p;
}

/// s^2 + 2 zeta omega s + omega^2
Complex denominator_at(const Mode& mode, Complex s) {
  return s * s + 2.0 * mode.zeta * mode.omega * s + mode.omega * mode.omega;
}

/// The tracking error of two masses by command and forces: the equations of twin/two_mass_axis.h in
/// s, times s with integral action.
struct TwoMassResponse {
  Complex command, motor_force, load_force;
};
TwoMassResponse response_of(const Transfer& transfer, Complex s) {
  const TwoMassParameters& two = *transfer.two_masses;
  const auto& [a1, a2, a3] = transfer.loop.denominator;
  const auto& [c0, c1, c2] = transfer.loop.numerator;
  const bool integrates = transfer.loop.order == 3, by_load = two.encoders == Encoders::kLoad;
  const Complex times = integrates ? s : 1.0;
  const double integral = integrates ? a3 : 0.0, integral_velocity = integrates ? c2 : 0.0;
  const auto [by_loop, by_motor] = position_gain_of(transfer.loop, two);
  const Complex contact = two.load_share * two.omega * (two.omega + 2.0 * two.zeta * s),
                load = (two.load_share * s + transfer.load_viscous) * s + contact,
                follows = contact / load,  // x2 by x1
      loop_gain = times * by_loop + integral;
  const Complex wanted =
      times * (((1.0 - c0) * s + a1 - c1) * s + a2) + integral - integral_velocity * s;
  const Complex inertia =
      ((1.0 - two.load_share) * s + transfer.motor_viscous) * s + contact * (1.0 - follows);
  const Complex p =
      times * (inertia + a1 * s + by_motor) + loop_gain * (by_load ? follows : Complex(1.0));
  const Complex given = by_load ? loop_gain / load : 0.0;
  TwoMassResponse x{wanted / p, -times / p, (given - times * follows) / p};  // of x1
  if (two.encoders != Encoders::kMotor)
    x = {follows * x.command, follows * x.motor_force, follows * x.load_force - 1.0 / load};
  return {1.0 - x.command, -x.motor_force, -x.load_force};
}

}  // namespace

Complex Transfer::load_compliance_at(double omega) const {
  return response_of(*this, Complex(0.0, omega)).load_force;
}

Complex Transfer::compliance_at(double omega) const {
  if (two_masses) return response_of(*this, Complex(0.0, omega)).motor_force;
  const Complex s(0.0, omega), p = denominator_at(loop, s), direct = loop.order == 3 ? s : 1.0;
  Complex out = disturbance_share(loop.denominator, loop.modes) * direct / p;
  for (const Mode& mode : loop.modes) {
    const Complex m = denominator_at(mode, s);
    const double held = loop.order == 3 ? loop.denominator[2] / (mode.omega * mode.omega) : 0.0;
    out += mode.gamma * (s / m - s * direct / p) + mode.delta * (1.0 / m - held / p);
  }
  return out;
}

Complex Transfer::at(double omega) const {
  const Complex s(0.0, omega);
  Complex n = 0.0;
  for (int i = 0; i < loop.order; ++i) n = n * s + loop.numerator[static_cast<std::size_t>(i)];
  Complex error = two_masses ? response_of(*this, s).command : s * n / denominator_at(loop, s);
  for (const Mode& mode : loop.modes)
    error += s * (mode.alpha * s + mode.beta) / denominator_at(mode, s);
  for (const Table& mode : tables) {
    const Complex force = -(mode.spring * mode.omega + mode.damper * s) * s * s /
                          (s * s + 2.0 * mode.zeta * mode.omega * s + mode.omega * mode.omega);
    error += compliance_at(omega) * force;
  }
  return std::polar(1.0, -omega * delay_s) * (1.0 - error);
}

double Transfer::lag_s() const {
  const auto last = static_cast<std::size_t>(loop.order - 1);
  double lag = loop.numerator[last] / loop.denominator[last] + delay_s;
  for (const Mode& mode : loop.modes) lag += mode.beta / (mode.omega * mode.omega);
  return lag;
}

Transfer transfer_of(const Model& model) {
  Transfer out;
  out.loop = model.loop;
  out.delay_s = model.command_delay_s();
  if (const Effect* two_mass = two_mass_of(model)) out.two_masses = two_mass_parameters(*two_mass);
  for (const Effect& effect : model.effects) {
    std::size_t k = 0;
    for (const Parameter& p : coefficients_of(effect.kind)) {
      const double value = effect.coefficient[k++];
      // Beyond what the poles hold: coefficients that a free loop could have taken up.
      if (p.with_free_loop || p.name != kViscous.name) continue;
      if (out.two_masses) {
        out.motor_viscous += (1.0 - out.two_masses->friction_share) * value;
        out.load_viscous += out.two_masses->friction_share * value;
        continue;
      }
      out.loop.denominator[0] += value;
      out.loop.numerator[1] += value;
    }
    if (effect.kind == kind_of<FeedforwardMismatch>()) {
      out.loop.numerator[1] -= effect.coefficient[0];
      out.loop.numerator[0] -= effect.coefficient[1];
    }
    if (adds_poles(effect.kind))
      out.tables.push_back({2.0 * std::numbers::pi * effect.shape[0], effect.shape[1],
                            effect.coefficient[0], effect.coefficient[1]});
  }
  return out;
}

namespace {

/// Of an axis of two masses, without the delay. Between samples the command's velocity is constant.
Eigen::ArrayXd two_mass_impulse(const Transfer& transfer, double h, Eigen::Index samples) {
  const StateSpace s = state_space(transfer.loop, *transfer.two_masses, h);
  // Viscous friction is a force by the velocities of motor and load.
  const Eigen::VectorXd on_motor = transfer.motor_viscous * s.b.col(1),
                        on_load = transfer.load_viscous * s.b.col(2);
  const Hold hold = discretise(s.a + on_motor * s.c.row(3) + on_load * s.c.row(4),
                               s.b.col(0) + on_motor * s.d(3, 0) + on_load * s.d(4, 0), h, 0);
  Eigen::ArrayXd out(samples);
  Eigen::VectorXd state = hold.g.col(0) / h;
  for (Eigen::Index k = 0; k < samples; ++k) {
    out(k) = s.c.row(1).dot(state);
    state = (hold.phi * state).eval();
    if (k == 0) state -= hold.g.col(0) / h;
  }
  return out;
}

using Polynomial = std::vector<double>;  // the coefficient of s^0 first

Polynomial product(const Polynomial& a, const Polynomial& b) {
  Polynomial out(a.size() + b.size() - 1, 0.0);
  for (std::size_t i = 0; i < a.size(); ++i) {
    for (std::size_t k = 0; k < b.size(); ++k) out[i + k] += a[i] * b[k];
  }
  return out;
}

/// x / x_r without delay and modes of the loop; both polynomials have the same length.
struct Rational {
  Polynomial over, under;
};
Rational without_modes(const Transfer& transfer) {
  const Loop& loop = transfer.loop;
  Polynomial under(static_cast<std::size_t>(loop.order) + 1, 1.0), over(under.size());
  for (std::size_t i = 0; i < under.size(); ++i) {
    const std::size_t power = under.size() - 2 - i;  // a_(power + 1) stands at s^i
    if (i + 1 < under.size()) under[i] = loop.denominator[power];
    const double c = i == 0 ? 0.0 : loop.numerator[power + 1];
    over[i] = under[i] - c;
  }
  const double share = disturbance_share(loop.denominator, loop.modes);
  for (const Transfer::Table& table : transfer.tables) {
    const Polynomial poles{table.omega * table.omega, 2.0 * table.zeta * table.omega, 1.0};
    // The force -(spring omega + damper s) s^2 / poles behind (s | 1) / P, of the axis and not of
    // its error; `under` has P and the poles of the tables before.
    Polynomial others{1.0};
    for (const Transfer::Table* before = transfer.tables.data(); before != &table; ++before)
      others =
          product(others, {before->omega * before->omega, 2.0 * before->zeta * before->omega, 1.0});
    Polynomial force{0.0, 0.0, share * table.spring * table.omega, share * table.damper};
    if (loop.order == 3) force.insert(force.begin(), 0.0);
    force = product(force, others);
    over = product(over, poles);
    under = product(under, poles);
    for (std::size_t i = 0; i < force.size(); ++i) over[i] += force[i];
  }
  return {over, under};
}

/// `out` later by this many samples.
Eigen::ArrayXd delayed(const Eigen::ArrayXd& out, double shift) {
  const auto whole = static_cast<Eigen::Index>(shift);
  const double part = shift - static_cast<double>(whole);
  Eigen::ArrayXd late = Eigen::ArrayXd::Zero(out.size());
  for (Eigen::Index k = whole; k < out.size(); ++k) {
    late(k) += (1.0 - part) * out(k - whole);
    if (k > whole) late(k) += part * out(k - whole - 1);
  }
  return late;
}

}  // namespace

Eigen::ArrayXd impulse_response(const Transfer& transfer, double h, Eigen::Index samples) {
  const double shift = std::max(0.0, transfer.delay_s) / h;
  if (transfer.two_masses) return delayed(two_mass_impulse(transfer, h, samples), shift);
  const Loop& loop = transfer.loop;
  const Rational whole = without_modes(transfer);
  const auto n = static_cast<Eigen::Index>(whole.under.size()) - 1;
  // x = sum of b_k times the derivatives of y = x_r / under; the k-th derivative is stored over
  // rate^k, so that numbers of one size stand in the matrix.
  const double rate = std::pow(whole.under.front(), 1.0 / static_cast<double>(n)),
               direct = whole.over.back();
  Eigen::MatrixXd companion = Eigen::MatrixXd::Zero(n, n);
  Eigen::VectorXd output(n);
  double scale = 1.0;
  for (Eigen::Index i = 0; i < n; ++i) {
    const double under = whole.under[static_cast<std::size_t>(i)];
    if (i + 1 < n) companion(i, i + 1) = rate;
    companion(n - 1, i) -= under * scale / std::pow(rate, n - 1);
    output(i) = (whole.over[static_cast<std::size_t>(i)] - direct * under) * scale;
    scale *= rate;
  }
  const Hold hold =
      discretise(companion, Eigen::VectorXd::Unit(n, n - 1) / std::pow(rate, n - 1), h, 1);
  const Eigen::VectorXd g_end = hold.g.col(1) / h, g_begin = hold.g.col(0) - g_end;

  // Of a mode the error has alpha at once and the rest through its two states.
  struct Vibration {
    Hold hold;
    Eigen::RowVector2d output;
    Eigen::Vector2d y;
  };
  std::vector<Vibration> vibrations;
  double at_once = direct;
  for (const Mode& mode : loop.modes) {
    const double damping = 2.0 * mode.zeta * mode.omega, stiffness = mode.omega * mode.omega;
    Eigen::Matrix2d a;
    a << 0.0, 1.0, -stiffness, -damping;
    Vibration v{discretise(a, Eigen::Vector2d(0.0, 1.0), h, 1),
                {mode.alpha * stiffness, damping * mode.alpha - mode.beta},
                {}};
    v.y = v.hold.g.col(1) / h;
    at_once -= mode.alpha;
    vibrations.push_back(v);
  }

  Eigen::ArrayXd out(samples);
  Eigen::VectorXd y = g_end;  // at the sample of the command itself: it rose over the step before
  for (Eigen::Index k = 0; k < samples; ++k) {
    out(k) = output.dot(y) + (k == 0 ? at_once : 0.0);
    y = hold.phi * y + (k == 0 ? g_begin : Eigen::VectorXd::Zero(n));
    for (Vibration& v : vibrations) {
      out(k) += v.output * v.y;
      v.y = v.hold.phi * v.y;
      if (k == 0) v.y += v.hold.g.col(0) - v.hold.g.col(1) / h;
    }
  }
  return shift > 0.0 ? delayed(out, shift) : out;
}

}  // namespace servotwin
