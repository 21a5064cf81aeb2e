// Repairs of positions, on motions whose true values are known because they were spoiled here.
#include "identification/recording/positions.h"

#include <gmock/gmock.h>

#include <cmath>
#include <numbers>

namespace servotwin {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

constexpr double kStep_s = 0.001;
constexpr double kTurn = 2.0 * std::numbers::pi;

/// Back and forth between rests over more than a turn, or over `travel`; the encoder lags 12 ms.
Recording motion(double travel, bool rotary) {
  Recording out;
  out.source = "made";
  AxisRecord axis;
  axis.name = "C";
  axis.rotary = rotary;
  const auto command = [travel](double t) {
    constexpr double kPeriod_s = 2.0, kRest_s = 0.5;
    const double whole = std::floor(t / kPeriod_s), part = t - kPeriod_s * whole;
    const double share = std::clamp((part - kRest_s) / (kPeriod_s - kRest_s), 0.0, 1.0);
    const double moved = share - std::sin(kTurn * share) / kTurn;
    const double from = std::sin(2.0 * whole), to = std::sin(2.0 * (whole + 1.0));
    return travel * (from + (to - from) * moved);
  };
  for (int k = 0; k < 12000; ++k) {
    out.time.push_back(k * kStep_s);
    axis.command.push_back(command(k * kStep_s));
    axis.actual.push_back(command(k * kStep_s - 0.012));
  }
  out.axes.push_back(axis);
  return out;
}

void wrap(std::vector<double>& values, double from, double period) {
  for (double& value : values) value -= period * std::floor((value - from) / period);
}

double greatest_difference(const std::vector<double>& a, const std::vector<double>& b) {
  double most = 0.0;
  for (std::size_t i = 0; i < a.size(); ++i) most = std::max(most, std::abs(a[i] - b[i]));
  return most;
}

double greatest_error_difference(const AxisRecord& a, const AxisRecord& b) {
  double most = 0.0;
  for (std::size_t i = 0; i < a.command.size(); ++i)
    most = std::max(most, std::abs((a.command[i] - a.actual[i]) - (b.command[i] - b.actual[i])));
  return most;
}

struct Wrapped {
  double travel;
  bool rotary;
  double from, period;
  const char* said;
};
class GoingRound : public testing::TestWithParam<Wrapped> {};

TEST_P(GoingRound, IsUnwrappedWhicheverChannelDoesIt) {
  const Wrapped& p = GetParam();
  const Recording whole = motion(p.travel, p.rotary);
  for (const int which : {1, 2, 3}) {
    Recording spoiled = whole;
    if (which & 1) wrap(spoiled.axes[0].command, p.from, p.period);
    if (which & 2) wrap(spoiled.axes[0].actual, p.from, p.period);
    EXPECT_THAT(mend_positions(spoiled), ElementsAre(HasSubstr(p.said))) << which;
    EXPECT_LT(greatest_error_difference(spoiled.axes[0], whole.axes[0]), 1e-9) << which;
    double step = 0.0;
    for (std::size_t i = 1; i < spoiled.time.size(); ++i)
      step = std::max(step, std::abs(spoiled.axes[0].actual[i] - spoiled.axes[0].actual[i - 1]));
    EXPECT_LT(step, 0.1 * p.period) << which << ": no jump is left";
  }
}
INSTANTIATE_TEST_SUITE_P(Axes, GoingRound,
                         testing::Values(Wrapped{6.0, true, 0.0, kTurn, "round at 360 deg"},
                                         Wrapped{6.0, true, -std::numbers::pi, kTurn,
                                                 "round at 360 deg"},
                                         Wrapped{6.0, true, 0.3, 0.5 * kTurn, "round at 180 deg"},
                                         Wrapped{0.05, false, 0.0, 0.02, "round at 20 mm"}));

TEST(Positions, AFlyBackAndAStepAreMotions) {
  Recording saw = motion(1.0, true);
  AxisRecord& axis = saw.axes[0];
  double actual = 0.0;
  for (std::size_t i = 0; i < axis.command.size(); ++i) {
    axis.command[i] = std::fmod(0.002 * static_cast<double>(i), kTurn);  // flies back by a turn
    actual += (axis.command[i] - actual) * 0.02;
    axis.actual[i] = actual;
  }
  const Recording as_it_was = saw;
  (void)mend_positions(saw);
  EXPECT_EQ(saw.axes[0].command, as_it_was.axes[0].command);
  for (std::size_t i = 0; i < axis.command.size(); ++i)
    axis.command[i] = i / 1500 % 2 == 0 ? 0.0 : 0.01;
  EXPECT_EQ(period_of(axis.command, false), 0.0) << "there is no motion before and after the jump";
}

TEST(Positions, SignRatioAndZeroOfTheEncoderAreRepaired) {
  const Recording whole = motion(0.3, false);
  Recording spoiled = whole;
  for (double& value : spoiled.axes[0].actual) value = -0.99 * value + 0.123;
  const std::vector<std::string> said = mend_positions(spoiled);
  EXPECT_THAT(said, ElementsAre(HasSubstr("counts against its command"),
                                HasSubstr("0.99 times as far"), HasSubstr("mm from that of")));
  EXPECT_LT(greatest_difference(spoiled.axes[0].actual, whole.axes[0].actual), 1e-9);
}

TEST(Positions, WhatAMachineDoesStaysAsItIs) {
  Recording real = motion(0.3, false);
  AxisRecord& axis = real.axes[0];
  double direction = 1.0;
  for (std::size_t i = 1; i < axis.actual.size(); ++i) {
    if (axis.command[i] != axis.command[i - 1])
      direction = axis.command[i] > axis.command[i - 1] ? 1.0 : -1.0;
    axis.actual[i] += 5e-4 * axis.actual[i]                     // an error of pitch
                      - 20e-6 * direction                       // play
                      + 2e-4 * static_cast<double>(i) / 12000;  // growth
  }
  const Recording as_it_was = real;
  EXPECT_THAT(mend_positions(real), IsEmpty());
  EXPECT_EQ(real.axes[0].actual, as_it_was.axes[0].actual);

  Recording grown = motion(0.3, false);  // warm before the recording began
  for (double& value : grown.axes[0].actual) value += 3e-4;
  EXPECT_THAT(mend_positions(grown), IsEmpty());
}

TEST(Positions, TheLagOfAnAxisThatNeverRestsIsNoRatioAndNoOffset) {
  for (const double hz : {0.0, 0.5, 3.0}) {  // 0: one direction
    Recording moving = motion(0.3, true);
    AxisRecord& axis = moving.axes[0];
    double actual = 0.0;
    for (std::size_t i = 0; i < axis.command.size(); ++i) {
      const double t = kStep_s * static_cast<double>(i);
      axis.command[i] = hz > 0.0 ? 0.05 * std::sin(kTurn * hz * t) : 3.0 * t;
      actual += (axis.command[i] - actual) * kStep_s / 0.02;
      axis.actual[i] = actual;
    }
    EXPECT_THAT(mend_positions(moving), IsEmpty()) << hz;
  }
}

TEST(Positions, AHeldEncoderIsSaidAndACoarseOneIsNot) {
  Recording held = motion(0.3, false);
  for (std::size_t i = 0; i < held.axes[0].actual.size(); ++i)
    held.axes[0].actual[i] = held.axes[0].actual[i - i % 14];
  EXPECT_THAT(mend_positions(held), ElementsAre(HasSubstr("refreshed every 14 ms only")));
  Recording coarse = motion(0.3, false);
  for (double& value : coarse.axes[0].actual) value = 2e-3 * std::round(value / 2e-3);
  EXPECT_THAT(mend_positions(coarse), IsEmpty());
  Recording steady = coarse;  // a coarse encoder at one speed changes at regular intervals, too
  AxisRecord& axis = steady.axes[0];
  for (std::size_t i = 0; i < axis.actual.size(); ++i) {
    axis.command[i] = 1e-4 * static_cast<double>(i);
    axis.actual[i] = 2e-3 * std::round((axis.command[i] - 1e-3) / 2e-3);
  }
  EXPECT_THAT(mend_positions(steady), IsEmpty());
}

TEST(Positions, AbsentValuesStayAbsent) {
  Recording gaps = motion(6.0, true);
  for (std::size_t i = 0; i < gaps.axes[0].actual.size(); i += 7) gaps.axes[0].actual[i] = kAbsent;
  const Recording whole = gaps;
  wrap(gaps.axes[0].actual, 0.0, kTurn);
  (void)mend_positions(gaps);
  for (std::size_t i = 0; i < gaps.axes[0].actual.size(); ++i) {
    if (i % 7 == 0) {
      EXPECT_TRUE(std::isnan(gaps.axes[0].actual[i]));
    } else {
      EXPECT_NEAR(gaps.axes[0].actual[i], whole.axes[0].actual[i], 1e-9);
    }
  }
  Recording nothing;
  EXPECT_THAT(mend_positions(nothing), IsEmpty());
  nothing.axes.emplace_back();
  EXPECT_THAT(mend_positions(nothing), IsEmpty());
}

}  // namespace
}  // namespace servotwin
