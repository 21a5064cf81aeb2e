#include "twin/loop.h"

#include <cassert>

namespace servotwin {

std::array<double, kMaxOrder> denominator_of(const PoleSet& poles, int order) {
  assert(order == 2 || order == 3);
  const double damping = 2.0 * poles.zeta * poles.omega;
  const double stiffness = poles.omega * poles.omega;
  if (order == 2) return {damping, stiffness, 0.0};
  return {poles.real + damping, stiffness + damping * poles.real, poles.real * stiffness};
}

namespace {

using Complex = std::complex<double>;

/// The roots of s^2 + b s + c without cancellation.
std::array<Complex, 2> quadratic_roots(double b, double c) {
  const double discriminant = b * b / 4.0 - c;
  if (discriminant < 0.0)
    return {Complex(-b / 2.0, std::sqrt(-discriminant)),
            Complex(-b / 2.0, -std::sqrt(-discriminant))};
  const double far = -(b / 2.0 + std::copysign(std::sqrt(discriminant), b));
  return {far == 0.0 ? Complex(0.0) : Complex(c / far), Complex(far)};
}

/// A real root of the cubic: bisection to the last bit inside the bound of Cauchy.
double real_root(double a1, double a2, double a3) {
  const auto value = [&](double s) { return ((s + a1) * s + a2) * s + a3; };
  const double bound = 1.0 + std::max({std::abs(a1), std::abs(a2), std::abs(a3)});
  double low = -bound;
  double high = bound;
  while (true) {
    const double middle = low + (high - low) / 2.0;
    if (middle <= low || middle >= high) return middle;
    (value(middle) < 0.0 ? low : high) = middle;
  }
}

}  // namespace

std::array<Complex, kMaxOrder> roots_of(const Loop& loop) {
  const auto [a1, a2, a3] = loop.denominator;
  if (loop.order == 2) {
    const auto pair = quadratic_roots(a1, a2);
    return {pair[0], pair[1], Complex(0.0)};
  }
  const double real = real_root(a1, a2, a3);
  const double b = a1 + real;
  // Deflated from the end where it loses less.
  const double c = std::abs(real) > 1e-6 * std::abs(a1) ? -a3 / real : a2 + b * real;
  const auto pair = quadratic_roots(b, c);
  std::array<Complex, kMaxOrder> roots{Complex(real), pair[0], pair[1]};
  if (roots[1].imag() == 0.0) {
    std::sort(roots.begin(), roots.end(), [](Complex l, Complex r) { return l.real() > r.real(); });
  }
  return roots;
}

PoleLabels labels_of(const Loop& loop) {
  const auto roots = roots_of(loop);
  PoleLabels labels;
  const auto pair_of = [](Complex l, Complex r) {
    PoleSet set;
    set.omega = std::sqrt(std::max(0.0, (l * r).real()));
    set.zeta = set.omega > 0.0 ? -(l + r).real() / (2.0 * set.omega) : 0.0;
    return set;
  };
  if (loop.order == 2) {
    labels.set[static_cast<std::size_t>(labels.count++)] = pair_of(roots[0], roots[1]);
    return labels;
  }
  const int triples = roots[1].imag() != 0.0 ? 1 : 3;
  for (int i = 0; i < triples; ++i) {
    PoleSet set = pair_of(roots[static_cast<std::size_t>((i + 1) % 3)],
                          roots[static_cast<std::size_t>((i + 2) % 3)]);
    set.real = -roots[static_cast<std::size_t>(i)].real();
    labels.set[static_cast<std::size_t>(labels.count++)] = set;
  }
  return labels;
}

double disturbance_share(const std::array<double, kMaxOrder>& denominator,
                         const std::vector<Mode>& modes) {
  double share = 1.0;
  for (const Mode& m : modes)
    share -= m.gamma * (denominator[0] - 2.0 * m.zeta * m.omega) + m.delta;
  return share;
}

Loop at_position(const Loop& loop, double position) {
  Loop out = loop;
  for (Mode& mode : out.modes) {
    const PlacedMode<double> placed =
        at_place(mode, loop.travel.place(position), loop.order, loop.denominator);
    mode = placed.mode;
    out.numerator[static_cast<std::size_t>(loop.order - 1)] += placed.lag;
  }
  return out;
}

bool stable(const Loop& loop) {
  const auto [a1, a2, a3] = loop.denominator;
  if (loop.order == 2) return a1 > 0.0 && a2 > 0.0;
  return a1 > 0.0 && a2 > 0.0 && a3 > 0.0 && a1 * a2 > a3;
}

}  // namespace servotwin
