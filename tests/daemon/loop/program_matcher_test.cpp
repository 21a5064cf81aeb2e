#include "daemon/loop/program_matcher.h"

#include <gtest/gtest.h>

#include <cmath>

#include "tests/daemon/support.h"

namespace servotwin::daemon {
namespace {

constexpr double kTolerance = 2e-6;

/// Stands for `dwell` cycles, then moves from rest for 300, then stands again.
CommandedPath program_of(double turn, Eigen::Index dwell = 30, double until = 300.0) {
  CommandedPath out;
  out.name = "part";
  out.axes = {1, 0};
  const Eigen::Index rows = dwell + 400;
  for (int axis = 0; axis < 2; ++axis) {
    Eigen::ArrayXd command(rows);
    for (Eigen::Index k = 0; k < rows; ++k) {
      const double t = std::clamp(static_cast<double>(k - dwell), 0.0, until) * kCycle_s;
      command(k) = axis == 0 ? 0.3 + 0.5 * t * t : 0.1 + 0.2 * t * t + turn * t * t * t;
    }
    out.command.push_back(std::move(command));
  }
  return out;
}

TEST(Programs, BeginAlikeAsFarAsTheShorterOneMoves) {
  const CommandedPath whole = program_of(0.0), shorter = program_of(0.0, 12, 150.0);
  EXPECT_TRUE(begin_alike(whole, whole, kTolerance));
  EXPECT_TRUE(begin_alike(whole, program_of(0.0, 70), kTolerance)) << "the rests do not matter";
  EXPECT_TRUE(begin_alike(whole, shorter, kTolerance));
  EXPECT_TRUE(begin_alike(shorter, whole, kTolerance));
  EXPECT_FALSE(begin_alike(program_of(0.1), shorter, kTolerance));
  CommandedPath other = whole;
  other.axes = {1, 2};
  EXPECT_FALSE(begin_alike(whole, other, kTolerance));
}

TEST(Programs, AnAxisThatOnlyOneOfThemHasMakesNoDifferenceWhereItStands) {
  const CommandedPath path = program_of(0.0);
  for (const bool moves_late : {false, true}) {
    CommandedPath more{"more", 0, true, {0, 2, 1}, {path.command[1], {}, path.command[0]}};
    more.command[1] = Eigen::ArrayXd::Constant(path.rows(), 7.0);
    if (moves_late) more.command[1].tail(150) += 1e-3;  // within the motion
    EXPECT_EQ(same_course(path, more, kTolerance), !moves_late);
    EXPECT_EQ(same_course(more, path, kTolerance), !moves_late);
    EXPECT_EQ(begin_alike(path, more, kTolerance), !moves_late);
    EXPECT_EQ(begin_alike(more, path, kTolerance), !moves_late);
  }
  CommandedPath moves = path, stands = path;
  moves.axes = {1};
  moves.command.pop_back();
  stands.axes = {0};
  stands.command = {Eigen::ArrayXd::Constant(path.rows(), 0.1)};
  EXPECT_FALSE(same_course(moves, stands, kTolerance)) << "no axis in common";
  EXPECT_FALSE(begin_alike(moves, path, kTolerance)) << "the other axis moves";
}

// 0.2 t^2 exceeds 2 um after 3.2 cycles; less 1.8 um, it exceeds them after 4.4 cycles.
TEST(Programs, ACycleAtTheBeginMakesNoDifference) {
  const CommandedPath path{"part", 0, true, {0}, {program_of(0.0).command[1]}};
  for (const double less : {0.9 * kTolerance, 1.1 * kTolerance}) {
    CommandedPath later = path;
    later.command[0].tail(path.rows() - 30) -= less;
    EXPECT_EQ(same_course(path, later, kTolerance), less < kTolerance);
    EXPECT_EQ(begin_alike(path, later, kTolerance), less < kTolerance);
  }
}

class ProgramMatcherTest : public testing::Test {
 protected:
  void watch(const std::vector<const CommandedPath*>& programs) { matcher_.watch(programs); }
  /// One cycle at a row of a program, with both axes off by `off`.
  std::optional<ProgramMatcher::Match> at(const CommandedPath& program, Eigen::Index row,
                                          double off = 0.0) {
    command_[1] = program.command[0](row) + off;
    command_[0] = program.command[1](row) - off;
    return matcher_.see(command_);
  }
  void stand(const CommandedPath& program, int cycles) {
    for (int i = 0; i < cycles; ++i) ASSERT_FALSE(at(program, 0)) << "nothing moves";
  }
  ProgramMatcher matcher_{kTolerance};
  std::array<double, 3> command_{0.0, 0.0, 7.0};  // the third axis is in no program
};

TEST_F(ProgramMatcherTest, KnowsTheRowAfterALongerOrShorterDwell) {
  const CommandedPath program = program_of(0.0);
  for (const int stood : {10, 30, 5000}) {
    watch({&program});
    stand(program, stood);
    int seen = 0;
    for (Eigen::Index row = 30; row < program.rows(); ++row) {
      const auto match = at(program, row);
      if (!match) {
        ASSERT_EQ(seen, 0) << row;
        continue;
      }
      ++seen;
      ASSERT_EQ(match->row, row);
      ASSERT_EQ(match->program, 0U);
    }
    // The motion exceeds the tolerance within 4 cycles; the match is confirmed 20 cycles later.
    EXPECT_GE(seen, 400 - 4 - ProgramMatcher::kConfirmationCycles);
  }
}

TEST_F(ProgramMatcherTest, CommandsWithinTheToleranceAreTheProgramAndOthersAreNot) {
  const CommandedPath program = program_of(0.0);
  for (const double off : {0.9 * kTolerance, 1.1 * kTolerance}) {
    watch({&program});
    stand(program, 20);
    bool matched = false;
    for (Eigen::Index row = 30; row < 200; ++row) matched = at(program, row, off).has_value();
    EXPECT_EQ(matched, off < kTolerance);
  }
}

TEST_F(ProgramMatcherTest, WhatLeavesTheProgramEndsTheMatchAtOnce) {
  const CommandedPath program = program_of(0.0);
  watch({&program});
  stand(program, 20);
  for (Eigen::Index row = 30; row < 200; ++row) at(program, row);
  ASSERT_TRUE(at(program, 200));
  EXPECT_FALSE(at(program, 200)) << "a cycle that repeats is a pause";
  for (Eigen::Index row = 201; row < program.rows(); ++row)
    EXPECT_FALSE(at(program, row)) << "it is not found again before its start";
}

TEST_F(ProgramMatcherTest, AnotherFeedIsAnotherProgram) {
  const CommandedPath program = program_of(0.0), faster = [] {
    CommandedPath out = program_of(0.0);
    for (Eigen::ArrayXd& axis : out.command) axis = axis(0) + 1.01 * (axis - axis(0));
    return out;
  }();
  watch({&program});
  stand(faster, 20);
  for (Eigen::Index row = 30; row < faster.rows(); ++row) ASSERT_FALSE(at(faster, row)) << row;
}

TEST_F(ProgramMatcherTest, PassingItsStartIsNotStandingThere) {
  const CommandedPath program = program_of(0.0, 1);
  watch({&program});
  for (int i = 0; i < ProgramMatcher::kStandstillCycles / 2; ++i) at(program, 0);
  for (Eigen::Index row = 1; row < program.rows(); ++row) ASSERT_FALSE(at(program, row));
}

TEST_F(ProgramMatcherTest, OfTwoThatBeginAlikeNoneIsKnownUntilTheyPart) {
  const CommandedPath one = program_of(0.0), other = program_of(1.0);
  watch({&one, &other});
  stand(one, 20);
  int first = 0;
  for (Eigen::Index row = 30; row < one.rows(); ++row) {
    const auto match = at(one, row);
    const bool parted = std::abs(one.command[1](row) - other.command[1](row)) > kTolerance;
    if (match && first == 0) first = static_cast<int>(row);
    if (!match) continue;
    EXPECT_TRUE(parted) << row;
    EXPECT_EQ(match->program, 0U);
  }
  EXPECT_GT(first, 0);
}

TEST_F(ProgramMatcherTest, ACommandThatIsNoNumberAndAGapEndTheMatch) {
  const CommandedPath program = program_of(0.0);
  for (const bool gap : {false, true}) {
    watch({&program});
    stand(program, 20);
    for (Eigen::Index row = 30; row < 200; ++row) at(program, row);
    if (gap) {
      matcher_.forget();
      EXPECT_FALSE(at(program, 200));
    } else {
      EXPECT_FALSE(at(program, 200, kAbsent));
    }
    EXPECT_FALSE(at(program, 201));
  }
}

TEST_F(ProgramMatcherTest, AProgramThatNeverMovesIsNeverRecognised) {
  const CommandedPath program = program_of(0.0, 30, 0.0);
  watch({&program});
  stand(program, 100);
  command_[0] += 1e-3;
  for (int i = 0; i < 100; ++i) EXPECT_FALSE(matcher_.see(command_));
}

}  // namespace
}  // namespace servotwin::daemon
