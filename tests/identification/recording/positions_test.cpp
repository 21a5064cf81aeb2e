// Repairs of positions, on motions whose true values are known because they were spoiled here.
#include "identification/recording/positions.h"

#include <gmock/gmock.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>

#include "identification/recording/turns.h"

namespace servotwin {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

constexpr double kCycle_s = 0.001;
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
    out.time.push_back(k * kCycle_s);
    axis.command.push_back(command(k * kCycle_s));
    axis.actual.push_back(command(k * kCycle_s - 0.012));
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

/// In one direction with a changing speed of `speed` per second at most; the encoder lags 12 ms.
Recording one_way(double speed, bool rotary, int rows = 60000) {
  Recording out = motion(1.0, rotary);
  AxisRecord& axis = out.axes[0];
  out.time.clear(), axis.command.clear(), axis.actual.clear();
  const auto command = [speed](double t) {
    return 0.5 * speed * (t - std::sin(kTurn * t / 7.0) * 7.0 / kTurn);
  };
  for (int k = 0; k < rows; ++k) {
    out.time.push_back(k * kCycle_s);
    axis.command.push_back(command(k * kCycle_s));
    axis.actual.push_back(command(k * kCycle_s - 0.012));
  }
  return out;
}

class Periods : public testing::TestWithParam<double> {};

TEST_P(Periods, APeriodThatIsNoRoundNumberDoesNotAddUpOverManyTurns) {
  const double period = GetParam(), turns = 150.0;
  std::mt19937 random(7);
  std::normal_distribution<double> noise(0.0, 1e-6);
  for (const int which : {1, 2}) {
    Recording whole = one_way(2.0 * turns * period / 60.0, false);
    for (double& value : whole.axes[0].actual) value += noise(random);
    Recording spoiled = whole;
    wrap(which == 1 ? spoiled.axes[0].command : spoiled.axes[0].actual, 0.0, period);
    EXPECT_THAT(mend_positions(spoiled), ElementsAre(HasSubstr("round at"))) << which;
    EXPECT_LT(greatest_error_difference(spoiled.axes[0], whole.axes[0]), 2e-6) << which;
  }
  // Where both wrap, an error of the period moves both.
  const Recording whole = one_way(2.0 * turns * period / 60.0, false);
  Recording both = whole;
  wrap(both.axes[0].command, 0.0, period);
  wrap(both.axes[0].actual, 0.0, period);
  EXPECT_THAT(mend_positions(both), ElementsAre(HasSubstr("round at")));
  EXPECT_LT(greatest_error_difference(both.axes[0], whole.axes[0]), 0.002 * period);
}
INSTANTIATE_TEST_SUITE_P(Pitches, Periods, testing::Values(0.00508, 0.008192, 0.065536, 0.0123457));

TEST(Positions, AFollowingErrorThatIsNoLagDoesNotSpoilThePeriod) {
  for (const double period : {0.02, 0.0254}) {
    Recording whole = motion(0.05, false);
    AxisRecord& axis = whole.axes[0];
    for (std::size_t i = 1; i < axis.actual.size(); ++i)  // stiffness against a force by place
      axis.actual[i] += 40e-6 * std::sin(90.0 * axis.command[i]);
    Recording spoiled = whole;
    wrap(spoiled.axes[0].actual, 0.0, period);
    EXPECT_THAT(mend_positions(spoiled), ElementsAre(HasSubstr("the encoder goes round at")));
    EXPECT_LT(greatest_error_difference(spoiled.axes[0], whole.axes[0]), 1e-9) << period;
  }
}

TEST(Positions, ARatioIsFoundBehindAPeriodThatOnlyTheCommandHas) {
  Recording whole = motion(0.05, false), spoiled = whole;
  wrap(spoiled.axes[0].command, 0.0, 0.02);
  for (double& value : spoiled.axes[0].actual) value *= 0.99;
  EXPECT_THAT(mend_positions(spoiled),
              ElementsAre(HasSubstr("round at 20 mm"), HasSubstr("0.99 times as far")));
}

TEST(Positions, NoiseAndReversalsAtTheWrapAreUnwrapped) {
  for (const bool rotary : {true, false}) {
    const double period = rotary ? kTurn : 0.02;
    for (const int which : {1, 2, 3}) {
      Recording whole = motion(0.6 * period, rotary);  // rests and reverses at multiples, too
      AxisRecord& axis = whole.axes[0];
      std::mt19937 random(11);
      std::normal_distribution<double> noise(0.0, 1e-3 * period);
      for (double& value : axis.actual) value += noise(random);
      Recording spoiled = whole;
      const double from = axis.command[250];  // where it rests for half a second
      if (which & 1) wrap(spoiled.axes[0].command, from, period);
      if (which & 2) wrap(spoiled.axes[0].actual, from, period);
      EXPECT_THAT(mend_positions(spoiled), ElementsAre(HasSubstr("round at"))) << rotary << which;
      EXPECT_LT(greatest_error_difference(spoiled.axes[0], whole.axes[0]), 1e-3 * period)
          << rotary << which;
    }
  }
}

/// Steps by `step` every half second; the encoder follows with a time constant of 30 ms.
Recording indexing(double step) {
  Recording out = motion(1.0, true);
  AxisRecord& axis = out.axes[0];
  double actual = 0.0;
  for (std::size_t i = 0; i < axis.command.size(); ++i) {
    const std::size_t steps = i / 500;
    axis.command[i] = step * static_cast<double>(steps);
    actual += (axis.command[i] - actual) * kCycle_s / 0.03;
    axis.actual[i] = actual;
  }
  return out;
}

TEST(Positions, AnIndexingTableIsUnwrapped) {
  for (const double degrees : {45.0, 90.0, -120.0}) {
    for (const int which : {1, 2, 3}) {
      const Recording whole = indexing(degrees * std::numbers::pi / 180.0);
      Recording spoiled = whole;
      if (which & 1) wrap(spoiled.axes[0].command, -0.1, kTurn);
      if (which & 2) wrap(spoiled.axes[0].actual, -0.1, kTurn);
      const std::vector<std::string> said = mend_positions(spoiled);
      ASSERT_THAT(said, testing::Not(IsEmpty())) << degrees << which;
      EXPECT_THAT(said[0], HasSubstr("round at 360 deg")) << degrees << which;
      EXPECT_LT(greatest_error_difference(spoiled.axes[0], whole.axes[0]), 1e-9)
          << degrees << which;
    }
  }
}

TEST(Positions, GapsOfEitherChannelLoseNoTurn) {
  for (const int gap : {1, 2}) {
    for (const int which : {1, 2, 3}) {
      const Recording whole = one_way(12.0, true, 12000);  // up to two turns per second
      Recording spoiled = whole;
      AxisRecord& axis = spoiled.axes[0];
      if (which & 1) wrap(axis.command, 0.0, kTurn);
      if (which & 2) wrap(axis.actual, 0.0, kTurn);
      std::vector<double>& values = gap == 1 ? axis.command : axis.actual;
      std::fill(values.begin() + 3000, values.begin() + 3900, kAbsent);
      EXPECT_THAT(mend_positions(spoiled), ElementsAre(HasSubstr("round at 360 deg")))
          << gap << which;
      for (std::size_t i = 0; i < axis.command.size(); ++i) {
        if (i >= 3000 && i < 3900) continue;
        ASSERT_NEAR(axis.command[i] - axis.actual[i],
                    whole.axes[0].command[i] - whole.axes[0].actual[i], 1e-9)
            << gap << which << " row " << i;
      }
    }
  }
}

TEST(Positions, AnAxisThatMovesMoreThanHalfATurnPerRowIsUnwrappedByItsCommand) {
  const Recording fast = one_way(50.0, true);
  Recording whole = fast;
  AxisRecord& axis = whole.axes[0];
  whole.time.clear(), axis.command.clear(), axis.actual.clear();
  for (std::size_t i = 0; i < fast.time.size(); i += 100) {  // 5 rad per row
    whole.time.push_back(fast.time[i]);
    axis.command.push_back(fast.axes[0].command[i]);
    axis.actual.push_back(fast.axes[0].actual[i]);
  }
  Recording spoiled = whole;
  wrap(spoiled.axes[0].actual, 0.0, kTurn);
  EXPECT_THAT(mend_positions(spoiled), ElementsAre(HasSubstr("the encoder goes round at 360")));
  EXPECT_LT(greatest_error_difference(spoiled.axes[0], whole.axes[0]), 1e-9);
}

TEST(Positions, AFlyBackAndAStepAreMotions) {
  Recording saw = motion(1.0, true);
  AxisRecord& axis = saw.axes[0];
  double actual = 0.0;
  for (std::size_t i = 0; i < axis.command.size(); ++i) {
    axis.command[i] = std::fmod(0.002 * static_cast<double>(i), kTurn);  // flies back by a turn
    actual += (axis.command[i] - actual) * 0.02;
    axis.actual[i] = actual;
  }
  const Recording flies_back = saw;
  EXPECT_THAT(mend_positions(saw), IsEmpty());
  EXPECT_EQ(saw.axes[0].command, flies_back.axes[0].command);
  EXPECT_EQ(saw.axes[0].actual, flies_back.axes[0].actual);

  Recording steps = motion(1.0, false);
  AxisRecord& stepped = steps.axes[0];
  actual = 0.0;
  for (std::size_t i = 0; i < stepped.command.size(); ++i) {
    stepped.command[i] = i / 1500 % 2 == 0 ? 0.0 : 0.01;
    actual += (stepped.command[i] - actual) * 0.02;
    stepped.actual[i] = actual;
  }
  EXPECT_EQ(period_of(stepped.command, false), 0.0)
      << "there is no motion before and after the jump";
  const Recording steps_as_they_were = steps;
  EXPECT_THAT(mend_positions(steps), IsEmpty());
  EXPECT_EQ(steps.axes[0].command, steps_as_they_were.axes[0].command);
  EXPECT_EQ(steps.axes[0].actual, steps_as_they_were.axes[0].actual);
}

TEST(Positions, AFalseValueIsNoTurn) {
  Recording false_value = motion(1.0, true);
  for (double& value : false_value.axes[0].command) value += 5.0;
  for (double& value : false_value.axes[0].actual) value += 5.0;
  for (const std::size_t i : {4300UL, 8100UL}) false_value.axes[0].actual[i] = 0.0;
  const Recording as_it_was = false_value;
  EXPECT_THAT(mend_positions(false_value), ElementsAre(HasSubstr("2 single values")));
  for (std::size_t i = 0; i < as_it_was.time.size(); ++i) {
    if (i == 4300 || i == 8100) continue;
    EXPECT_EQ(false_value.axes[0].actual[i], as_it_was.axes[0].actual[i]) << i;
  }
}

TEST(Positions, AWrapThatCannotBeUndoneIsSaid) {
  Recording other = motion(6.0, true);  // the command of another axis
  for (std::size_t i = 0; i < other.time.size(); ++i)
    other.axes[0].command[i] = 2.0 * std::sin(7.0 * other.time[i]);
  wrap(other.axes[0].actual, 0.0, kTurn);
  const Recording as_it_was = other;
  EXPECT_THAT(mend_positions(other), ElementsAre(HasSubstr("left as recorded")));
  EXPECT_EQ(other.axes[0].actual, as_it_was.axes[0].actual);
}

TEST(Positions, OneChannelAloneIsUnwrappedAtATurnOnly) {
  for (const bool command : {true, false}) {
    for (const bool absent_rows : {true, false}) {
      Recording whole = motion(6.0, true);
      const auto remove = [&](std::vector<double>& values) {
        if (absent_rows) {
          std::fill(values.begin(), values.end(), kAbsent);
        } else {
          values.clear();
        }
      };
      remove(command ? whole.axes[0].actual : whole.axes[0].command);
      Recording spoiled = whole;
      const auto channel = [&](Recording& of) -> std::vector<double>& {
        return command ? of.axes[0].command : of.axes[0].actual;
      };
      wrap(channel(spoiled), channel(whole)[0] - 0.5, kTurn);
      EXPECT_THAT(mend_positions(spoiled),
                  ElementsAre(HasSubstr(command ? "the command goes round at 360 deg"
                                                : "the encoder goes round at 360 deg")));
      EXPECT_LT(greatest_difference(channel(spoiled), channel(whole)), 1e-9);

      Recording linear = motion(0.05, false);
      remove(command ? linear.axes[0].actual : linear.axes[0].command);
      wrap(channel(linear), 0.0, 0.02);
      const std::vector<double> wrapped = channel(linear);
      EXPECT_THAT(mend_positions(linear), IsEmpty()) << "it may fly back";
      EXPECT_EQ(channel(linear), wrapped);
    }
  }
}

TEST(Positions, AFewRowsAreNoReasonForARepair) {
  for (const std::size_t rows : {0UL, 1UL, 5UL}) {
    for (const bool rotary : {true, false}) {
      Recording few = motion(0.3, rotary);
      few.time.resize(rows);
      few.axes[0].command.resize(rows);
      few.axes[0].actual.resize(rows);
      for (double& value : few.axes[0].actual) value += 0.05;
      const Recording as_it_was = few;
      EXPECT_THAT(mend_positions(few), IsEmpty()) << rows;
      EXPECT_EQ(few.axes[0].actual, as_it_was.axes[0].actual) << rows;
    }
  }
}

TEST(Positions, EachAxisIsRepairedByItselfAndTheRepairsAreKept) {
  Recording machine = motion(0.3, false);
  machine.notes = {"time is repaired"};
  machine.axes[0].name = "X";
  machine.axes.push_back(motion(6.0, true).axes[0]);
  machine.axes.push_back(machine.axes[0]);
  machine.axes[2].name = "Y";
  const Recording whole = machine;
  wrap(machine.axes[1].command, 0.0, kTurn);
  for (double& value : machine.axes[0].actual) value = -value;
  for (double& value : machine.axes[2].actual) value += 0.2;
  const Recording spoiled = machine;
  const std::vector<std::string> said = mend_positions(machine);
  EXPECT_THAT(said, ElementsAre(HasSubstr("X: the encoder counts against"),
                                HasSubstr("C: the command goes round at 360"),
                                HasSubstr("Y: the zero of the encoder is 200 mm")));
  EXPECT_THAT(machine.notes, ElementsAre("time is repaired", said[0], said[1], said[2]));
  for (std::size_t k = 0; k < 3; ++k)
    EXPECT_LT(greatest_error_difference(machine.axes[k], whole.axes[k]), 1e-9) << k;

  machine = spoiled;  // the encoders of the neighbours of an axis are repaired without a word
  EXPECT_THAT(mend_positions(machine, "Y"),
              ElementsAre(HasSubstr("C: the command goes"), HasSubstr("Y: the zero")));
  for (std::size_t k = 0; k < 3; ++k)
    EXPECT_LT(greatest_error_difference(machine.axes[k], whole.axes[k]), 1e-9) << k;
}

TEST(Positions, AnErrorAtRestIsNamedAndOnlyAnotherZeroIsSubtracted) {
  struct Zero {
    double error;
    bool rotary, subtracted;
  };
  for (const Zero& c : {Zero{4e-3, false, false}, Zero{-9e-3, false, false},
                        Zero{0.05, false, true}, Zero{0.1, true, false}, Zero{0.3, true, true}}) {
    Recording stands = motion(c.rotary ? 3.0 : 0.3, c.rotary);
    for (double& value : stands.axes[0].actual) value += c.error;
    const Recording as_it_was = stands;
    const std::vector<std::string> said = mend_positions(stands);
    EXPECT_THAT(said, ElementsAre(HasSubstr(c.subtracted ? "subtracted" : "left as it is")))
        << c.error;
    EXPECT_EQ(stands.axes[0].actual == as_it_was.axes[0].actual, !c.subtracted) << c.error;
  }
  Recording stands = motion(0.3, false);
  for (double& value : stands.axes[0].actual) value += 4.2e-3;
  EXPECT_THAT(mend_positions(stands),
              ElementsAre(HasSubstr("stands 4.2 mm from its command at rest")));
}

/// Back and forth over 0.3 m at 30 mm/s with rests of half a second; a first-order loop of this Kv.
Recording slow_loop(double kv_per_s, double noise_m) {
  Recording out = motion(0.3, false);
  AxisRecord& axis = out.axes[0];
  constexpr double kSlower = 4.0, kMove_s = 10.0, kRest_s = 0.5, kTravel_m = 0.3;
  std::mt19937 random(3);
  std::normal_distribution<double> noise(0.0, 1.0);
  double actual = 0.0;
  for (std::size_t i = 0; i < axis.command.size(); ++i) {
    out.time[i] *= kSlower;
    const double part = std::fmod(out.time[i], 2.0 * (kMove_s + kRest_s));
    const double there = std::clamp(part / kMove_s, 0.0, 1.0);
    const double back = std::clamp((part - kMove_s - kRest_s) / kMove_s, 0.0, 1.0);
    axis.command[i] = kTravel_m * (there - back);
    actual += (axis.command[i] - actual) * kSlower * kCycle_s * kv_per_s;
    axis.actual[i] = actual + noise_m * noise(random);
  }
  return out;
}

TEST(Positions, ASlowAxisThatStillSettlesIsNoRatio) {
  for (const double kv_per_s : {5.0, 10.0, 30.0}) {
    for (const double noise_m : {0.0, 2e-6, 20e-6}) {
      Recording slow = slow_loop(kv_per_s, noise_m);
      EXPECT_THAT(mend_positions(slow), IsEmpty()) << kv_per_s << " " << noise_m;
    }
  }
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

TEST(Positions, ADiameterIsTwiceTheRadius) {
  const Recording whole = motion(0.3, false);
  for (const double ratio : {2.0, 0.5}) {
    Recording spoiled = whole;
    for (double& value : spoiled.axes[0].actual) value *= ratio;
    EXPECT_THAT(mend_positions(spoiled),
                ElementsAre(HasSubstr("times as far as its command (gear ratio, unit or pitch")));
    EXPECT_LT(greatest_difference(spoiled.axes[0].actual, whole.axes[0].actual), 1e-9);
  }
}

TEST(Positions, TheMotorsEncoderIsRepairedLikeThatOfTheLoadButForItsZero) {
  const AxisRecord whole = motion(2.0, true).axes[0];
  Recording turned = motion(2.0, true), spoiled = turned;
  spoiled.axes[0].actual_motor = whole.actual;
  spoiled.axes[0].actual_motor[700] += 0.5;
  wrap(spoiled.axes[0].actual_motor, 0.0, kTurn);
  EXPECT_THAT(mend_positions(spoiled),
              ElementsAre(HasSubstr("C.actual_motor: the encoder goes round"),
                          HasSubstr("C.actual_motor: one value of the encoder")));
  EXPECT_TRUE(std::isnan(spoiled.axes[0].actual_motor[700]));
  spoiled.axes[0].actual_motor[700] = whole.actual[700];
  EXPECT_LT(greatest_difference(spoiled.axes[0].actual_motor, whole.actual), 1e-9);
  EXPECT_EQ(spoiled.axes[0].actual, whole.actual);
  EXPECT_EQ(spoiled.axes[0].command, whole.command);

  for (const double value : whole.actual) turned.axes[0].actual_motor.push_back(-value - 0.7);
  EXPECT_THAT(mend_positions(turned), ElementsAre(HasSubstr("C.actual_motor: the encoder counts")));
  for (double& value : turned.axes[0].actual_motor) value -= 0.7;
  EXPECT_LT(greatest_difference(turned.axes[0].actual_motor, whole.actual), 1e-9);
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
      const double t = kCycle_s * static_cast<double>(i);
      axis.command[i] = hz > 0.0 ? 0.05 * std::sin(kTurn * hz * t) : 3.0 * t;
      actual += (axis.command[i] - actual) * kCycle_s / 0.02;
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
  Recording stepped = motion(0.3, false);
  for (std::size_t i = 0; i < stepped.axes[0].command.size(); ++i)
    stepped.axes[0].command[i] = stepped.axes[0].command[i - i % 8];
  EXPECT_THAT(mend_positions(stepped),
              ElementsAre(HasSubstr("the command is refreshed every 8 ms only")));
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

TEST(Positions, SingleWrongValuesAreLeftOutAndTheOthersStay) {
  const Recording whole = motion(0.3, false);
  Recording spoiled = whole;
  for (std::size_t i = 777; i < whole.time.size(); i += 2000) spoiled.axes[0].actual[i] += 0.05;
  EXPECT_THAT(mend_positions(spoiled),
              ElementsAre(testing::AllOf(HasSubstr("6 single values of the encoder are up to"),
                                         HasSubstr("first at 0.777 s"))));
  for (std::size_t i = 0; i < whole.time.size(); ++i) {
    if (i % 2000 == 777) {
      EXPECT_TRUE(std::isnan(spoiled.axes[0].actual[i])) << i;
    } else {
      EXPECT_EQ(spoiled.axes[0].actual[i], whole.axes[0].actual[i]) << i;
    }
  }
  Recording many = whole;
  for (std::size_t i = 50; i < whole.time.size(); i += 200) many.axes[0].actual[i] += 0.05;
  const std::vector<double> as_it_was = many.axes[0].actual;
  EXPECT_THAT(mend_positions(many), ElementsAre(HasSubstr("too many to be left out")));
  EXPECT_EQ(many.axes[0].actual, as_it_was);
  Recording one = whole;
  one.axes[0].actual[5000] -= 0.002;
  EXPECT_THAT(mend_positions(one), ElementsAre(HasSubstr("one value of the encoder is 2.000")));
}

// An interpolator of 4 ms beside an encoder of 1 ms: the drive follows what is in between.
TEST(Positions, ACommandThatIsRecordedSlowlyIsInterpolated) {
  const Recording whole = motion(0.3, false);
  for (const bool blank : {false, true}) {
    SCOPED_TRACE(blank);
    Recording slow = whole;
    std::vector<double>& command = slow.axes[0].command;
    for (std::size_t i = 0; i < command.size(); ++i) {
      if (i % 4 != 0) command[i] = blank ? std::nan("") : command[i - i % 4];
    }
    EXPECT_THAT(
        mend_positions(slow),
        ElementsAre(testing::AllOf(HasSubstr(blank ? "C: the command is recorded every 4 ms only"
                                                   : "C: the command is refreshed every 4 ms only"),
                                   HasSubstr("it is interpolated, as drives do"))));
    double most = 0.0;
    const std::size_t end = command.size() - 4;  // behind the last value nothing is known
    for (std::size_t i = 0; i < end; ++i)
      most = std::max(most, std::abs(command[i] - whole.axes[0].command[i]));
    if (blank) {  // rows of another axis: neither has a value there
      Recording merged = whole;
      for (std::size_t i = 0; i < merged.time.size(); ++i) {
        if (i % 4 != 0) merged.axes[0].command[i] = merged.axes[0].actual[i] = std::nan("");
      }
      EXPECT_THAT(mend_positions(merged), IsEmpty());
    }
    // Held it would be 2 mm off, on straight lines 3 um.
    EXPECT_LT(most, 1e-6);
  }
}

TEST(Positions, TheWayToTheCommandAtTheBeginningIsLeftOut) {
  const Recording whole = motion(0.3, false);
  Recording late = whole;
  constexpr std::size_t kArrives = 400;
  const auto away = [&](double from_m) {
    late = whole;
    for (std::size_t i = 0; i < kArrives; ++i)
      late.axes[0].actual[i] +=
          from_m * 0.5 * (1.0 + std::cos(std::numbers::pi * static_cast<double>(i) / kArrives));
  };
  away(0.4);
  EXPECT_THAT(mend_positions(late),
              ElementsAre(testing::AllOf(
                  HasSubstr("C: the axis begins 399.999 mm from its command and has run to it"),
                  HasSubstr("left out until then"))));
  const std::vector<double>& left = late.axes[0].actual;
  const auto arrived = static_cast<std::size_t>(
      std::find_if(left.begin(), left.end(), [](double x) { return std::isfinite(x); }) -
      left.begin());
  EXPECT_GT(arrived, 8 * kArrives / 10);
  EXPECT_LE(arrived, kArrives);
  EXPECT_TRUE(
      std::equal(left.begin() + kArrives, left.end(), whole.axes[0].actual.begin() + kArrives));
  away(0.02);  // no more than the axis lags later
  EXPECT_THAT(mend_positions(late), IsEmpty());
  // A step that the command makes once, at the beginning, is the motion.
  Recording step = whole;
  std::fill(step.axes[0].command.begin(), step.axes[0].command.end(), 0.1);
  for (std::size_t i = 0; i < step.time.size(); ++i)
    step.axes[0].actual[i] = 0.1 - 0.1 * std::exp(-static_cast<double>(i) / 50.0);
  const std::vector<double> as_it_was = step.axes[0].actual;
  (void)mend_positions(step);
  EXPECT_EQ(step.axes[0].actual, as_it_was);
}

TEST(Positions, WhatAnAxisCanDoIsNoSpike) {
  const Recording whole = motion(0.3, false);
  // A step stays where it is, two values in a row are an event, a count that flickers is noise,
  // and 0.2 mm away and back in two milliseconds are 800 m/s^2, which a blow can do.
  const auto spoilt = [&](std::initializer_list<std::size_t> rows, double by) {
    Recording out = whole;
    for (const std::size_t row : rows) out.axes[0].actual[row] += by;
    return out;
  };
  for (Recording recording :
       {spoilt({4000, 4001}, 0.05), spoilt({5000}, 2e-4), spoilt({3000, 5000, 7000}, 1e-5)})
    EXPECT_THAT(mend_positions(recording), IsEmpty());
  Recording step = whole;
  for (std::size_t i = 6000; i < step.time.size(); ++i) step.axes[0].actual[i] += 3e-3;
  for (const std::string& line : mend_positions(step))
    EXPECT_THAT(line, testing::Not(HasSubstr("away from both neighbours")));
  Recording flickers = whole;  // a coarse encoder: counts of 2 mm
  for (std::size_t i = 0; i < flickers.time.size(); ++i) {
    double& value = flickers.axes[0].actual[i];
    value = 2e-3 * std::round(value / 2e-3) + (i % 1000 == 7 ? 2e-3 : 0.0);
  }
  EXPECT_THAT(mend_positions(flickers), IsEmpty());
  // The peak of a vibration of a quarter of the sampling rate: three large bends in a row.
  Recording vibrates = whole;
  for (std::size_t i = 6000; i < 6008; ++i)
    vibrates.axes[0].actual[i] += 2e-3 * std::sin(0.25 * kTurn * static_cast<double>(i));
  EXPECT_THAT(mend_positions(vibrates), IsEmpty());
}

TEST(Positions, AnEncoderAheadOfItsCommandIsSaid) {
  for (const int ahead : {1, 5}) {
    Recording early = motion(0.3, false);
    std::vector<double>& actual = early.axes[0].actual;
    // 12 ms behind; from that row on the value of `ahead` ms later than the command.
    for (std::size_t i = 0; i < actual.size(); ++i)
      actual[i] =
          early.axes[0].command[std::min(i + static_cast<std::size_t>(ahead), actual.size() - 1)];
    if (ahead == 5) {
      EXPECT_THAT(mend_positions(early), ElementsAre(HasSubstr("is 5 ms ahead of its command")));
    } else {
      EXPECT_THAT(mend_positions(early), IsEmpty());
    }
  }
}

TEST(Positions, MetresThatAreCalledMillimetresAreAsked) {
  Recording tiny = motion(0.2e-3, false);  // 200 mm, with an encoder of 0.1 um
  for (double& value : tiny.axes[0].actual) value = 1e-10 * std::round(value / 1e-10);
  EXPECT_THAT(mend_positions(tiny), ElementsAre(HasSubstr("write [m] behind their names")));
  Recording stage = motion(0.2e-3, false);  // a stage that travels so little, with its encoder
  for (double& value : stage.axes[0].actual) value = 1e-9 * std::round(value / 1e-9);
  EXPECT_THAT(mend_positions(stage), IsEmpty());
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
