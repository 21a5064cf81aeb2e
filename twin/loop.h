// The linear loop of a servo drive, from command and disturbance to the tracking error.
//
// Order 3 (integral action; thesis eq. 3.8, docs/theory.md 1.1):
//   e = s (c0 s^2 + c1 s + c2) / P(s) x_r + s / P(s) d,   P = s^3 + a1 s^2 + a2 s + a3
// Order 2 (P position, P velocity control, no integrator; docs/theory.md 1.2):
//   e = s (c0 s + c1) / P(s) x_r + 1 / P(s) d,            P = s^2 + a1 s + a2
// d is the disturbance as an acceleration [m/s^2 | rad/s^2], positive when it resists positive
// motion.
//
// Flexible machines have modes of vibration beside it, each a pair of poles in parallel
// (docs/theory.md 1.5): with M = s^2 + 2 zeta omega s + omega^2, P as above, and G the (s | 1)/P of
// a disturbance,
//   e += (alpha s + beta) / M s x_r
//        + [gamma (s/M - s G - (a1 - 2 zeta omega) G) + delta (1/M - held/P - G)] d
// held is a3 / omega^2 with integral action, else 0. What is taken off leaves d the deceleration of
// what carries the encoder, and behind an integrator no constant force is felt.
//
// A mode of a machine whose stiffness depends on where its table stands moves with the commanded
// position x (docs/theory.md 1.6), xi from -1 to 1 over the travel and held beyond it:
//   omega(x) = omega exp(slope xi + curve xi^2),   zeta(x) = zeta exp(zeta_slope xi)
// What the control makes good at rest it does at any x: c(n-1) and, without an integrator, delta
// move with omega so that the lag at constant speed and the give under a constant force stay.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <complex>
#include <cstddef>
#include <vector>

namespace servotwin {

inline constexpr int kMaxOrder = 3;
inline constexpr std::size_t kMaxModes = 6;
/// Of slope and curve of a mode that moves: a factor of e.
inline constexpr double kMostModeTravel = 1.0;

/// A mode of vibration.
struct Mode {
  double omega = 0.0;       ///< natural frequency [rad/s], > 0
  double zeta = 0.0;        ///< damping ratio, 0 < zeta < 1
  double alpha = 0.0;       ///< of the command [-],
  double beta = 0.0;        ///< [1/s],
  double gamma = 0.0;       ///< of the disturbance [s],
  double delta = 0.0;       ///< [-], 1 where the disturbance acts on nothing but this mode
  double slope = 0.0;       ///< of log omega over half the travel [-],
  double curve = 0.0;       ///< and what it is more at both ends; omega is that in the middle [-]
  double zeta_slope = 0.0;  ///< of log zeta over half the travel [-]

  [[nodiscard]] bool moves() const noexcept {
    return slope != 0.0 || curve != 0.0 || zeta_slope != 0.0;
  }
};

/// Of the commanded position [m | rad].
struct Travel {
  double from = 0.0, to = 0.0;
  /// -1 at its beginning, 1 at its end, held beyond; 0 where there is none.
  [[nodiscard]] double place(double position) const noexcept {
    return to > from ? std::clamp((2.0 * position - from - to) / (to - from), -1.0, 1.0) : 0.0;
  }
};

struct Loop {
  int order = 3;                                ///< 2 or 3
  std::array<double, kMaxOrder> denominator{};  ///< a1..an [1/s^i]
  std::array<double, kMaxOrder> numerator{};    ///< c0..c(n-1) [1/s^i]
  std::vector<Mode> modes{};                    ///< at most kMaxModes
  Travel travel{};                              ///< over which modes move
};

/// omega(x) [rad/s], `place` that of x in the travel.
[[nodiscard]] inline double omega_at(const Mode& mode, double place) noexcept {
  return mode.omega * std::exp(place * (mode.slope + mode.curve * place));
}
/// A mode as it is at this place, where it does not move; `lag`: what c(n-1) is more there.
struct PlacedMode {
  Mode mode;
  double lag = 0.0;
};
[[nodiscard]] PlacedMode at_place(const Mode& mode, double place, int order,
                                  const std::array<double, kMaxOrder>& denominator) noexcept;
/// The loop of an axis that stays about this position: its modes are there and do not move.
[[nodiscard]] Loop at_position(const Loop& loop, double position);

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
/// What the modes leave of the loop's own (s | 1)/P for a disturbance [-]; 1 without modes.
[[nodiscard]] double disturbance_share(const std::array<double, kMaxOrder>& denominator,
                                       const std::vector<Mode>& modes);
/// Routh-Hurwitz: every pole left of the imaginary axis.
[[nodiscard]] bool stable(const Loop& loop);

}  // namespace servotwin
