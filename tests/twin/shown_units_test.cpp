#include "twin/shown_units.h"

#include <gtest/gtest.h>

#include <limits>

namespace servotwin {
namespace {

TEST(ShownUnits, LargeFiguresAreWrittenWithoutAnExponent) {
  EXPECT_EQ(micro_text(1.5237e-3, false, 3), "1524 um");
  EXPECT_EQ(micro_text(-0.0891, true, 3), "-89100 urad");
  EXPECT_EQ(micro_text(999.7e-6, false, 3), "1000 um");  // rounded to 3 digits it is 1e+03
  EXPECT_EQ(micro_text(12.345e-6, false, 3), "12.3 um");
  EXPECT_EQ(micro_text(std::numeric_limits<double>::quiet_NaN(), false), "nan um");
}

}  // namespace
}  // namespace servotwin
