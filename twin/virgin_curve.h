// The virgin curve of presliding friction (force of the first travel from rest) with three
// parameters: breakaway force, breakaway displacement and shape factor (thesis 4.3;
// docs/theory.md 3.6).
//
//   x(tau) = tau^2 [(3 + S - 8 phi) + (16 phi - 3 S - 2) tau + (2 S - 8 phi) tau^2]
//   f(tau) = 1 - x(1 - tau),  0 <= tau <= 1
//
// x is displacement over breakaway displacement, f is force over breakaway force. The curve starts
// vertically, ends horizontally and passes ((1 - phi)/2, (1 + phi)/2): phi = 0 is a straight line,
// phi -> 1 a step. S(phi) is the length of the end tangents. It is chosen so that the curve is
// concave for every phi, which makes the stiffness of all Maxwell-slip elements positive.
//
// Any thread; allocates nothing, throws nothing.
#pragma once

#include <algorithm>

#include "twin/maxwell_slip.h"

namespace servotwin {

/// Shape factors for which a concave curve of this form exists.
inline constexpr double kMinShape = 0.002, kMaxShape = 0.938;

/// S(phi), with which the curve is concave from kMinShape to kMaxShape. From 0.3875 to 0.875 it
/// is the smallest S whose curve stays in the unit square, the criterion of thesis eq. 4.8. Below
/// 0.3875 smaller S would stay in it too (S = 0 up to phi = 0.375), but S = 0 does not start
/// vertically; 0.1, or 8 phi where that is less, is concave. Above 0.875 the curve with the
/// smallest S would turn back.
template <class T>
T spline_length(const T& phi) noexcept {
  if (phi <= 0.0125) return 8.0 * phi;
  if (phi <= 0.3875) return T(0.1);
  if (phi <= 0.875) return 8.0 * phi - 3.0;
  return 4.0 + 14.19 * (phi - 0.875);
}

/// x(tau) for the shape factor phi and S.
template <class T>
T virgin_displacement(const T& phi, const T& length, double tau) noexcept {
  return tau * tau *
         ((3.0 + length - 8.0 * phi) + (16.0 * phi - 3.0 * length - 2.0) * tau +
          (2.0 * length - 8.0 * phi) * tau * tau);
}

/// N Maxwell-slip elements whose sum is the polygon through the curve's nodes, uniform in tau. They
/// are sorted by the displacement at which they slide; their levels sum to 1.
template <std::size_t N, class T>
MaxwellElements<T, N> reduced_elements(const T& breakaway_displacement, const T& phi) noexcept {
  const T length = spline_length(phi);
  std::array<T, N + 1> x{}, slope{};
  x[0] = T(0.0);
  T force_before = T(0.0);
  for (std::size_t j = 1; j <= N; ++j) {
    const double tau = static_cast<double>(j) / static_cast<double>(N);
    x[j] = j == N ? T(1.0) : virgin_displacement(phi, length, tau);
    const T force = j == N ? T(1.0) : 1.0 - virgin_displacement(phi, length, 1.0 - tau);
    slope[j - 1] = (force - force_before) / (x[j] - x[j - 1]);
    force_before = force;
  }
  slope[N] = T(0.0);
  MaxwellElements<T, N> out;
  for (std::size_t j = 0; j < N; ++j) {
    const T stiffness = slope[j] - slope[j + 1];
    out.stiffness[j] = stiffness / breakaway_displacement;
    out.level[j] = stiffness * x[j + 1];
  }
  return out;
}

}  // namespace servotwin
