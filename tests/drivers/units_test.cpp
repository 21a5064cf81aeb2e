#include "drivers/common/units.h"

#include <gtest/gtest.h>

#include <numbers>

namespace servotwin {
namespace {

constexpr double kPi = std::numbers::pi;

struct Case {
  const char* text;
  Quantity quantity;
  double value;
  double in_si;
  const char* si;
};

class KnownUnit : public testing::TestWithParam<Case> {};

TEST_P(KnownUnit, ConvertsToSi) {
  const auto unit = parse_unit(GetParam().text);
  ASSERT_TRUE(unit);
  EXPECT_EQ(unit->quantity, GetParam().quantity);
  EXPECT_DOUBLE_EQ(unit->to_si(GetParam().value), GetParam().in_si);
  EXPECT_EQ(unit->si, GetParam().si);
}

INSTANTIATE_TEST_SUITE_P(
    Contract, KnownUnit,
    testing::Values(
        Case{"s", Quantity::kTime, 3, 3, "s"}, Case{"ms", Quantity::kTime, 3, 3e-3, "s"},
        Case{"us", Quantity::kTime, 3, 3e-6, "s"}, Case{"ns", Quantity::kTime, 3, 3e-9, "s"},
        Case{"m", Quantity::kLength, 7, 7, "m"}, Case{"mm", Quantity::kLength, 7, 7e-3, "m"},
        Case{"um", Quantity::kLength, 7, 7e-6, "m"},
        Case{"\u00b5m", Quantity::kLength, 7, 7e-6, "m"},
        Case{"nm", Quantity::kLength, 7, 7e-9, "m"}, Case{"in", Quantity::kLength, 2, 0.0508, "m"},
        Case{"rad", Quantity::kAngle, 2, 2, "rad"},
        Case{"deg", Quantity::kAngle, 90, kPi / 2, "rad"},
        Case{"rev", Quantity::kAngle, 0.5, kPi, "rad"}, Case{"N", Quantity::kTorque, 5, 5, "N"},
        Case{"kN", Quantity::kTorque, 5, 5000, "N"}, Case{"Nm", Quantity::kTorque, 5, 5, "Nm"},
        Case{"A", Quantity::kTorque, 5, 5, "A"}, Case{"V", Quantity::kTorque, 5, 5, "V"},
        Case{"%", Quantity::kTorque, 5, 5, "%"}, Case{"mm/s", Quantity::kVelocity, 4, 4e-3, "m/s"},
        Case{"m/min", Quantity::kVelocity, 6, 0.1, "m/s"},
        Case{"deg/s", Quantity::kAngularVelocity, 180, kPi, "rad/s"},
        Case{"rpm", Quantity::kAngularVelocity, 60, 2 * kPi, "rad/s"},
        // Counts of a file: 8192 to the revolution, a tenth of a micrometre each.
        Case{"rev/8192", Quantity::kAngle, 4096, kPi, "rad"},
        Case{"um*0.1", Quantity::kLength, 30, 3e-6, "m"},
        // Counts backwards.
        Case{"deg*-1", Quantity::kAngle, 180, -kPi, "rad"},
        Case{"rev/-8192", Quantity::kAngle, 4096, -kPi, "rad"}));

class UnknownUnit : public testing::TestWithParam<const char*> {};

TEST_P(UnknownUnit, IsNoUnit) { EXPECT_FALSE(parse_unit(GetParam())); }

INSTANTIATE_TEST_SUITE_P(Refused, UnknownUnit,
                         testing::Values("", "furlong", "MM", "mm ", "/", "mm/", "mm/h", "s/s",
                                         "N/s", "mm*s", "mm*0", "s*-1", "rev/nan", "rev/1e999",
                                         "8192"));

// One rounding, not two: 0.001 has no exact binary value.
TEST(Units, DecimalUnitsGiveTheNearestNumber) {
  for (const double millimetres : {910.000049, 0.3, 497.462284, 1e-6, 123456.789}) {
    EXPECT_EQ(parse_unit("mm")->to_si(millimetres), millimetres / 1000.0);
  }
}

}  // namespace
}  // namespace servotwin
