#include "diagnosis/statistics/text.h"

#include <gtest/gtest.h>

namespace servotwin {
namespace {

TEST(Text, HasNoPowersOfTenThatAMachineNeeds) {
  EXPECT_EQ(text("%.3g um RMS instead of %.2g", 1170.0, 750.0), "1170 um RMS instead of 750");
  EXPECT_EQ(text("%.3g to %.3g", -54321.0, 0.000123), "-54300 to 0.000123");
  EXPECT_EQ(text("%.3g", 7.43e5), "7.43e+05");
  EXPECT_EQ(without_powers("the+02 e+03 1e+03"), "the+02 e+03 1000");
  EXPECT_EQ(without_powers("1.5e+0"), "1.5e+0");
}

}  // namespace
}  // namespace servotwin
