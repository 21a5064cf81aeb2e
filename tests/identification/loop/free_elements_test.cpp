#include "identification/loop/free_elements.h"

#include <gtest/gtest.h>

#include <array>
#include <functional>
#include <numeric>

namespace servotwin {
namespace {

/// Displacement after which the last element slides [m].
double last_of(const FreeElements& elements) {
  return std::accumulate(elements.shapes.begin(), elements.shapes.end(), 1.0,
                         std::multiplies<double>());
}

// The start slides where the law before slides, whatever the form of its virgin curve.
TEST(FreeElements, SlideAfterTheTravelOfTheLawBefore) {
  const std::array presliding{2e-5, 0.5}, dahl{3e-6, 0.0};
  const std::array<double, 6> free{1e-6, 2.0, 2.0, 1.5, 1.5, 3.0};
  for (const double form : kFormsOfFreeElements) {
    const FreeElements from = free_elements(kind_of<Presliding>(), presliding.data(), form);
    EXPECT_NEAR(last_of(from), 2e-5, 1e-12) << form;
    EXPECT_NEAR(std::accumulate(from.levels.begin(), from.levels.end(), 0.0), 1.0, 1e-12);
    for (const double level : from.levels) EXPECT_GT(level, 0.0);
    EXPECT_NEAR(last_of(free_elements(kind_of<Dahl>(), dahl.data(), form)), 1.2e-5, 1e-12);
    EXPECT_NEAR(last_of(free_elements(kind_of<MaxwellSlip>(), free.data(), form)), 2.7e-5, 1e-12);
  }
}

// A first element below the bound is raised to it, and the others stay where they are.
TEST(FreeElements, ABoundMovesNoOtherElement) {
  const std::array tiny{1e-6, 0.5};
  const FreeElements from = free_elements(kind_of<Presliding>(), tiny.data(), 0.85);
  EXPECT_EQ(from.shapes.front(), shapes_of(kind_of<MaxwellSlip>()).front().lower);
  EXPECT_NEAR(last_of(from), 1e-6, 1e-12);
}

}  // namespace
}  // namespace servotwin
