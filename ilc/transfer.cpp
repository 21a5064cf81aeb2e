#include "ilc/transfer.h"

#include <cmath>
#include <numbers>

#include "twin/hold.h"

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

}  // namespace

Complex Transfer::compliance_at(double omega) const {
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
  Complex error = s * n / denominator_at(loop, s);
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
  Transfer out{model.loop, model.command_delay_s(), {}};
  for (const Effect& effect : model.effects) {
    std::size_t k = 0;
    for (const Parameter& p : coefficients_of(effect.kind)) {
      const double value = effect.coefficient[k++];
      // Beyond what the poles hold: coefficients that a free loop could have taken up.
      if (p.with_free_loop || p.name != kViscous.name) continue;
      out.loop.denominator[0] += value;
      out.loop.numerator[1] += value;
    }
    if (effect.kind == kind_of<FeedforwardMismatch>()) {
      out.loop.numerator[1] -= effect.coefficient[0];
      out.loop.numerator[0] -= effect.coefficient[1];
    }
    if (effect.kind == kind_of<Compliance>())
      out.tables.push_back({2.0 * std::numbers::pi * effect.shape[0], effect.shape[1],
                            effect.coefficient[0], effect.coefficient[1]});
  }
  return out;
}

Eigen::ArrayXd impulse_response(const Transfer& transfer, double h, Eigen::Index samples) {
  const Loop& loop = transfer.loop;
  const auto n = static_cast<Eigen::Index>(loop.order);
  Eigen::MatrixXd companion = Eigen::MatrixXd::Zero(n, n);
  for (Eigen::Index i = 0; i + 1 < n; ++i) companion(i, i + 1) = 1.0;
  // x = sum of b_k times the derivatives of y = x_r / P; of the highest, y^(n) = x_r - sum a_k ..
  Eigen::VectorXd output(n);
  const double direct = 1.0 - loop.numerator[0];
  for (Eigen::Index i = 0; i < n; ++i) {
    const auto power = static_cast<std::size_t>(n - 1 - i);  // a_(power + 1) stands at s^i
    companion(n - 1, i) = -loop.denominator[power];
    const double c = i == 0 ? 0.0 : loop.numerator[power + 1];
    output(i) = loop.denominator[power] - c - direct * loop.denominator[power];
  }
  const Hold hold = discretise(companion, Eigen::VectorXd::Unit(n, n - 1), h, 1);
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
  const double shift = std::max(0.0, transfer.delay_s) / h;
  const auto whole = static_cast<Eigen::Index>(shift);
  const double part = shift - static_cast<double>(whole);
  if (shift > 0.0) {
    Eigen::ArrayXd late = Eigen::ArrayXd::Zero(samples);
    for (Eigen::Index k = whole; k < samples; ++k) {
      late(k) += (1.0 - part) * out(k - whole);
      if (k > whole) late(k) += part * out(k - whole - 1);
    }
    out = late;
  }
  return out;
}

}  // namespace servotwin
