// The linear loop of a servo drive: tracking error from command and disturbance.
//
// Order 3 (integral action; thesis eq. 3.10, docs/theory.md 1.1):
//   e = s (c0 s^2 + c1 s + c2) / P(s) x_r + s / P(s) d,   P = s^3 + a1 s^2 + a2 s + a3
// Order 2 (P position, P velocity control, no integrator; docs/theory.md 1.2):
//   e = s (c0 s + c1) / P(s) x_r + 1 / P(s) d,            P = s^2 + a1 s + a2
// d is the disturbance as an acceleration [m/s^2 | rad/s^2], positive if it resists positive
// motion.
//
// Modes of vibration of a flexible machine are pairs of poles in parallel (docs/theory.md 1.5).
// With M = s^2 + 2 zeta omega s + omega^2, P as above, and G the (s | 1)/P of a disturbance,
//   e += (alpha s + beta) / M s x_r
//        + [gamma (s/M - s G - (a1 - 2 zeta omega) G) + delta (1/M - held/P - G)] d
// held is a3 / omega^2 with integral action, else 0. The subtracted terms make d the deceleration
// of the body that carries the encoder, and remove the effect of a constant force behind an
// integrator.
//
// A mode moves if the stiffness of the machine depends on the position of its table. It follows the
// commanded position x (docs/theory.md 1.6), with xi from -1 to 1 over the travel and held beyond:
//   omega(x) = omega exp(slope xi + curve xi^2),   zeta(x) = zeta exp(zeta_slope xi)
// What the control corrects at rest does not depend on x: c(n-1) and, without an integrator, delta
// change with omega so that the lag at constant speed and the deflection under a constant force
// stay the same.
//
// Errors: none; a model is checked by why_invalid (twin/model.h). Any thread.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <complex>
#include <cstddef>
#include <vector>

#include "twin/dual.h"

namespace servotwin {

inline constexpr int kMaxOrder = 3;
inline constexpr std::size_t kMaxModes = 6;
/// Bound of slope, curve and zeta_slope of a mode that moves: a factor of e.
inline constexpr double kMaxModeTravel = 1.0;

/// A mode of vibration.
template <class S>
struct ModeOf {
  S omega = 0.0;       ///< natural frequency [rad/s], > 0
  S zeta = 0.0;        ///< damping ratio, 0 < zeta < 1
  S alpha = 0.0;       ///< coefficients of the command: [-]
  S beta = 0.0;        ///< and [1/s]
  S gamma = 0.0;       ///< coefficients of the disturbance: [s]
  S delta = 0.0;       ///< and [-]; 1 if the disturbance acts on this mode alone
  S slope = 0.0;       ///< change of log omega over half the travel [-]
  S curve = 0.0;       ///< its increase at both ends; omega is that of the middle [-]
  S zeta_slope = 0.0;  ///< change of log zeta over half the travel [-]

  [[nodiscard]] bool moves() const noexcept {
    return slope != 0.0 || curve != 0.0 || zeta_slope != 0.0;
  }
};
using Mode = ModeOf<double>;

/// The range of the commanded position [m | rad].
struct Travel {
  double from = 0.0, to = 0.0;
  /// xi: -1 at `from`, 1 at `to`, held beyond; 0 if the range is empty.
  template <class S>
  [[nodiscard]] S place(const S& position) const noexcept {
    return to > from ? std::clamp<S>((2.0 * position - from - to) / (to - from), -1.0, 1.0)
                     : S(0.0);
  }
};

template <class S>
struct LoopOf {
  int order = 3;                           ///< 2 or 3
  std::array<S, kMaxOrder> denominator{};  ///< a1..an [1/s^i]
  std::array<S, kMaxOrder> numerator{};    ///< c0..c(n-1) [1/s^i]
  std::vector<ModeOf<S>> modes{};          ///< at most kMaxModes
  Travel travel{};                         ///< range over which modes move
};
using Loop = LoopOf<double>;

/// omega(x) [rad/s]; `place` is xi of x.
template <class S>
[[nodiscard]] S omega_at(const ModeOf<S>& mode, const S& place) noexcept {
  using std::exp;
  return mode.omega * exp(place * (mode.slope + mode.curve * place));
}
/// A mode at one place, constant there; `lag` is the change of c(n-1) there.
template <class S>
struct PlacedMode {
  ModeOf<S> mode;
  S lag = 0.0;
};
template <class S>
[[nodiscard]] PlacedMode<S> at_place(const ModeOf<S>& mode, const S& place, int order,
                                     const std::array<S, kMaxOrder>& denominator) noexcept {
  using std::exp;
  PlacedMode<S> out{mode, 0.0};
  if (!mode.moves()) return out;
  const S& last = denominator[static_cast<std::size_t>(order - 1)];
  const S middle = mode.omega * mode.omega;
  out.mode.omega = omega_at(mode, place);
  out.mode.zeta = mode.zeta * exp(mode.zeta_slope * place);
  out.mode.slope = out.mode.curve = out.mode.zeta_slope = 0.0;
  const S here = out.mode.omega * out.mode.omega;
  out.lag = last * mode.beta * (1.0 / middle - 1.0 / here);
  // delta (1 / omega^2 - 1 / a2) stays; a mode as slow as the loop itself has no such delta.
  constexpr double kMaxChange = 2.0;
  const S before = middle - last, after = here - last;
  if (order == 2 && before * after > 0.0)
    out.mode.delta *= std::clamp<S>(before / after * here / middle, 1.0 / kMaxChange, kMaxChange);
  return out;
}
/// The loop of an axis near this position: its modes are those of the position and do not move.
[[nodiscard]] Loop at_position(const Loop& loop, double position);

/// The poles as a real pole (order 3 only) and a pair, which is two real poles if zeta > 1.
struct PoleSet {
  double real = 0.0;   ///< p [rad/s], unused in order 2
  double omega = 0.0;  ///< natural frequency of the pair [rad/s]
  double zeta = 0.0;   ///< damping ratio of the pair
};

/// a1..an of (s + p)(s^2 + 2 zeta omega s + omega^2), or of the pair alone.
[[nodiscard]] std::array<double, kMaxOrder> denominator_of(const PoleSet& poles, int order);
/// The roots of P, the slowest real one first, pairs next to each other.
[[nodiscard]] std::array<std::complex<double>, kMaxOrder> roots_of(const Loop& loop);
/// All pole sets that describe the same loop: one for a complex pair, three for three real poles.
struct PoleLabels {
  int count = 0;
  std::array<PoleSet, 3> set{};
};
[[nodiscard]] PoleLabels labels_of(const Loop& loop);
/// The factor of the loop's own (s | 1)/P for a disturbance beside its modes [-]; 1 without modes.
[[nodiscard]] double disturbance_share(const std::array<double, kMaxOrder>& denominator,
                                       const std::vector<Mode>& modes);
/// Routh-Hurwitz: every pole left of the imaginary axis.
[[nodiscard]] bool stable(const Loop& loop);

}  // namespace servotwin
