#include "tests/hidden_effects/floors.h"

#include <gtest/gtest.h>

namespace servotwin::hidden_effects {
namespace {

/// Of the development part: sampled every 0.6 to 4 ms, noise of 0.14 to 1 step.
class FloorOfAMachine : public testing::TestWithParam<int> {};

TEST_P(FloorOfAMachine, IsThatOfItsEncoder) {
  const FloorOfCase floor = floor_of(case_of_floor(Part::kDev, GetParam()));
  EXPECT_TRUE(floor.within()) << floor.name << ' ' << floor.found.rms / floor.reading_rms;
  EXPECT_TRUE(floor.in_interval()) << floor.name;
}

// A spring that swings at rest, a cut with a tone, lost samples, a tone, a clean machine.
INSTANTIATE_TEST_SUITE_P(Dev, FloorOfAMachine, testing::Values(4, 6, 7, 15, 23));

}  // namespace
}  // namespace servotwin::hidden_effects
