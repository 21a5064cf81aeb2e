// One step of a mode of vibration in closed form, cheap enough to recompute every cycle for a mode
// that moves. Allocates nothing, throws nothing; any thread. Source: docs/theory.md 1.6.
//
//   w' = A w + b u,   A = [-damping, 1; -stiffness, 0],   u = sum_k u^(k) s^k / k!
//   w(h) = phi_0 w + sum_k h^(k+1) phi_(k+1) b u^(k),   phi_j = sum_i (h A)^i / (i + j)!
//
// Every phi_j is p_j + q_j A, because A^2 = -damping A - stiffness (Cayley and Hamilton), and phi_j
// = 1 / j! + h A phi_(j+1) gives them from the last one down.
#pragma once

#include <array>
#include <cstddef>

namespace servotwin {

template <class S>
class ModeStepOf {
 public:
  /// `damping`: 2 zeta omega [1/s], `stiffness`: omega^2 [1/s^2].
  ModeStepOf(const S& damping, const S& stiffness, double step_s) noexcept
      : damping_(damping), stiffness_(stiffness) {
    const bool slow = stiffness * step_s * step_s < kMaxSmallStep_rad2;
    const int terms = slow ? kTermsOfSmallStep : kTerms;
    double term =
        slow ? one_over_factorial(kTermsOfSmallStep) : one_over_factorial(kTerms);  // 1 / j!
    S p = term, q = 0.0;
    for (int j = terms - 1; j >= 0; --j) {
      term *= j + 1;
      const S above = p;
      p = term - step_s * stiffness * q;
      q = step_s * (above - damping * q);
      if (j < kInputs) p_[static_cast<std::size_t>(j)] = p, q_[static_cast<std::size_t>(j)] = q;
    }
  }

  /// phi_j times the vector (first, second), j from 0 to 3.
  [[nodiscard]] std::array<S, 2> times(std::size_t j, const S& first,
                                       const S& second) const noexcept {
    return {p_[j] * first + q_[j] * (second - damping_ * first),
            p_[j] * second - q_[j] * stiffness_ * first};
  }

 private:
  static constexpr int kInputs = 4;
  // The truncation error is below 1e-12 for steps of up to half a period, and with the fewer terms
  // for steps of up to half a radian.
  static constexpr int kTerms = 24, kTermsOfSmallStep = 13;
  static constexpr double kMaxSmallStep_rad2 = 0.25;
  static constexpr double one_over_factorial(int of) {
    double out = 1.0;
    for (int j = 2; j <= of; ++j) out /= j;
    return out;
  }
  S damping_, stiffness_;
  std::array<S, kInputs> p_{}, q_{};
};
using ModeStep = ModeStepOf<double>;

}  // namespace servotwin
