// The force at the end of a step, or the forces on two masses, where motion and force depend on
// each other (docs/theory.md 2.3). Any thread; allocates nothing, throws nothing.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>

namespace servotwin {

/// The force at which `miss` is 0, sought from `first`, exact where that is it already. `slope` of
/// the miss by the force: as it was last, and as it is now.
template <class Miss>
double balanced(double first, double& slope, const Miss& miss_at) noexcept {
  const double tolerance = 1e-15 + 1e-13 * std::abs(first);
  double left = first, miss_left = miss_at(left);
  if (std::abs(miss_left) <= tolerance) return left;
  // Where the disturbance is smooth in the motion two secants from the last slope are enough.
  constexpr double kMinSlope = 0.2, kMaxSlope = 1e6;
  constexpr int kSecants = 5;
  for (int round = 0; round < kSecants; ++round) {
    const double next = left - miss_left / slope, miss_next = miss_at(next);
    if (std::abs(miss_next) <= tolerance) return next;
    const double now = (miss_next - miss_left) / (next - left);
    left = next, miss_left = miss_next;
    if (!(now > kMinSlope && now < kMaxSlope)) break;
    slope = now;
  }
  double right = left, miss_right = miss_left;
  // The first step is enough where the disturbance does not fall with the motion.
  for (double reach = 1.0; (miss_right > 0.0) == (miss_left > 0.0) && reach < 1e12; reach *= 2.0) {
    right = left - reach * miss_left;
    miss_right = miss_at(right);
    if (miss_right == 0.0) break;
  }
  // Bracketed secant (Illinois), halving where that is slow; forces that are piecewise linear in
  // the motion take a few rounds. The last point tried is the answer: its memory is kept.
  for (int round = 1; round <= 100 && std::abs(miss_right) > tolerance; ++round) {
    double next = (left * miss_right - right * miss_left) / (miss_right - miss_left);
    const auto [low, high] = std::minmax(left, right);
    if (round % 8 == 0 || !(next > low && next < high)) next = 0.5 * (left + right);
    if (next == left || next == right) break;
    const double miss_next = miss_at(next);
    if ((miss_next > 0.0) == (miss_right > 0.0)) {
      miss_left *= 0.5;
    } else {
      left = right, miss_left = miss_right;
    }
    right = next, miss_right = miss_next;
  }
  return right;
}

using ForcePair = std::array<double, 2>;
/// By row what one force changes with the misses of both: the inverse of their slopes.
using PairBySlopes = std::array<ForcePair, 2>;
inline constexpr PairBySlopes kApart{{{1.0, 0.0}, {0.0, 1.0}}};

/// Seeks two forces at which both misses are within `tolerance`, from `forces` by Broyden's method
/// (C. G. Broyden, Mathematics of Computation 19 (1965) 577); false where that does not settle in a
/// few trials. `inverse`: in, that of the step before, or kApart; out, that of this one. The last
/// pair tried is the answer.
template <class Miss>
bool balanced(ForcePair forces, PairBySlopes& inverse, double tolerance,
              const Miss& miss_at) noexcept {
  constexpr int kTrials = 12;
  constexpr double kMinAlong = 1e-9;  // of the step's square: below, the slopes are singular
  ForcePair &by_first = inverse[0], &by_second = inverse[1];
  const auto along = [&](const ForcePair& misses) {
    return ForcePair{by_first[0] * misses[0] + by_first[1] * misses[1],
                     by_second[0] * misses[0] + by_second[1] * misses[1]};
  };
  ForcePair miss = miss_at(forces);
  for (int trial = 0;; ++trial) {
    if (std::abs(miss[0]) <= tolerance && std::abs(miss[1]) <= tolerance) return true;
    if (trial == kTrials) return false;
    const ForcePair back = along(miss), step{-back[0], -back[1]};
    forces = {forces[0] + step[0], forces[1] + step[1]};
    const ForcePair next = miss_at(forces);
    const ForcePair expected = along({next[0] - miss[0], next[1] - miss[1]});
    const double product = step[0] * expected[0] + step[1] * expected[1];
    if (!(std::abs(product) > kMinAlong * (step[0] * step[0] + step[1] * step[1]))) return false;
    const ForcePair row{step[0] * by_first[0] + step[1] * by_second[0],
                        step[0] * by_first[1] + step[1] * by_second[1]};
    for (std::size_t i = 0; i < 2; ++i) {
      by_first[i] += (step[0] - expected[0]) / product * row[i];
      by_second[i] += (step[1] - expected[1]) / product * row[i];
    }
    miss = next;
  }
}

}  // namespace servotwin
