// The linear loop of a servo drive, from command and disturbance to the tracking error.
//
// Order 3 (integral action; thesis eq. 3.8, docs/theory.md 1.1):
//   e = s (c0 s^2 + c1 s + c2) / P(s) x_r + s / P(s) d,   P = s^3 + a1 s^2 + a2 s + a3
// Order 2 (P position, P velocity control, no integrator; docs/theory.md 1.2):
//   e = s (c0 s + c1) / P(s) x_r + 1 / P(s) d,            P = s^2 + a1 s + a2
// d is the disturbance as an acceleration [m/s^2 | rad/s^2], positive when it resists positive
// motion.
#pragma once

#include <array>
#include <complex>

namespace servotwin {

inline constexpr int kMaxOrder = 3;

struct Loop {
  int order = 3;                                ///< 2 or 3
  std::array<double, kMaxOrder> denominator{};  ///< a1..an [1/s^i]
  std::array<double, kMaxOrder> numerator{};    ///< c0..c(n-1) [1/s^i]
};

/// The poles as the pole search names them: a real pole (order 3 only) and a pair, real where zeta
/// > 1.
struct PoleSet {
  double real = 0.0;   ///< p [rad/s], unused in order 2
  double omega = 0.0;  ///< natural frequency of the pair [rad/s]
  double zeta = 0.0;   ///< damping ratio of the pair
};

/// a1..an of (s + p)(s^2 + 2 zeta omega s + omega^2), or of the pair alone.
[[nodiscard]] std::array<double, kMaxOrder> denominator_of(const PoleSet& poles, int order);
/// The roots of P, the slowest real one first, pairs next to each other.
[[nodiscard]] std::array<std::complex<double>, kMaxOrder> roots_of(const Loop& loop);
/// All labels under which the loop's poles can be named: one for a complex pair, three for real
/// poles.
struct PoleLabels {
  int count = 0;
  std::array<PoleSet, 3> set{};
};
[[nodiscard]] PoleLabels labels_of(const Loop& loop);
/// Routh-Hurwitz: every pole left of the imaginary axis.
[[nodiscard]] bool stable(const Loop& loop);

}  // namespace servotwin
