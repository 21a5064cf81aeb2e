#include "twin/force_balance.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <utility>

namespace servotwin {
namespace {

constexpr double kTolerance = 1e-12;

/// Forces that miss constant ones and what each takes of the other.
struct Coupled {
  ForcePair wanted{};
  ForcePair by_other{};

  ForcePair operator()(const ForcePair& forces) const {
    return {forces[0] - wanted[0] + by_other[0] * forces[1],
            forces[1] - wanted[1] + by_other[1] * forces[0]};
  }
};

TEST(ForcePair, OfALinearPairIsFoundInAFewTrialsAndInFewerWhenItsSlopesAreKnown) {
  // 0.4 of each force acts on the other: x = (3 - 0.4 * 1) / 0.84, y = (1 - 0.4 * 3) / 0.84.
  const Coupled pair{{3.0, 1.0}, {0.4, 0.4}};
  ForcePair last{};
  int trials = 0;
  const auto miss = [&](const ForcePair& forces) {
    last = forces;
    ++trials;
    return pair(forces);
  };
  PairBySlopes inverse = kApart;
  ASSERT_TRUE(balanced(ForcePair{0.0, 0.0}, inverse, kTolerance, miss));
  EXPECT_NEAR(last[0], 2.6 / 0.84, 1e-11);
  EXPECT_NEAR(last[1], -0.2 / 0.84, 1e-11);
  EXPECT_LE(trials, 6) << "Broyden's method ends after twice as many steps as there are unknowns";
  const int before = std::exchange(trials, 0);
  ASSERT_TRUE(balanced(ForcePair{10.0, -5.0}, inverse, kTolerance, miss));
  EXPECT_LT(trials, before);
}

TEST(ForcePair, OfFrictionThatSaturatesIsFound) {
  // x = clamp(2 - x, -0.8, 0.8) = 0.8; y = 0.5 x - y = 0.2.
  ForcePair last{};
  PairBySlopes inverse = kApart;
  ASSERT_TRUE(balanced(ForcePair{0.0, 0.0}, inverse, kTolerance, [&](const ForcePair& forces) {
    last = forces;
    return ForcePair{forces[0] - std::clamp(2.0 - forces[0], -0.8, 0.8),
                     2.0 * forces[1] - 0.5 * forces[0]};
  }));
  EXPECT_NEAR(last[0], 0.8, 1e-11);
  EXPECT_NEAR(last[1], 0.2, 1e-11);
}

TEST(ForcePair, ThatDoesNotExistIsSaidToBeNotFound) {
  PairBySlopes inverse = kApart;
  EXPECT_FALSE(balanced(ForcePair{0.0, 0.0}, inverse, kTolerance, [](const ForcePair& forces) {
    return ForcePair{1.0 + forces[0] * forces[0], forces[1]};
  }));
  // Misses that no force changes.
  EXPECT_FALSE(balanced(ForcePair{0.0, 0.0}, inverse = kApart, kTolerance, [](const ForcePair&) {
    return ForcePair{1.0, 1.0};
  }));
  for (const ForcePair none : {ForcePair{0.0, NAN}, ForcePair{NAN, 0.0}}) {
    EXPECT_FALSE(balanced(ForcePair{0.0, 0.0}, inverse = kApart, kTolerance,
                          [&](const ForcePair&) { return none; }));
  }
}

}  // namespace
}  // namespace servotwin
