// Repeating motion: paths in closed form with known begins, pauses and lengths, and motion that
// does not repeat.
#include "daemon/correct/repeating_motion.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <functional>
#include <numbers>
#include <random>

#include "drivers/recordings/recording_file.h"
#include "tests/daemon/support.h"

namespace servotwin::daemon {
namespace {

constexpr double kTolerance = 2e-6;
constexpr std::size_t kEnd = 100;  // rows that a part rests at its ends, if the pause is as long

/// Commands of two axes, to the increment of 0.1 um, as a control sends them.
class Commands {
 public:
  Commands() { rest(50); }
  Commands& rest(std::size_t rows) {
    for (std::size_t k = 0; k < rows; ++k) add(x_, y_);
    return *this;
  }
  /// Row by row from one point to another; `rows`: those with motion.
  Commands& to(double x, double y, std::size_t rows) {
    const double from_x = x_, from_y = y_;
    for (std::size_t k = 1; k <= rows; ++k) {
      const double share = static_cast<double>(k) / static_cast<double>(rows);
      add(from_x + share * (x - from_x), from_y + share * (y - from_y));
    }
    x_ = x;
    y_ = y;
    return *this;
  }
  /// One turn of a circle through the present point.
  Commands& turn(double radius, std::size_t rows) {
    for (std::size_t k = 1; k <= rows; ++k) {
      const double angle =
          2.0 * std::numbers::pi * static_cast<double>(k) / static_cast<double>(rows);
      add(x_ + radius * (1.0 - std::cos(angle)), y_ + radius * std::sin(angle));
    }
    return *this;
  }
  /// As rest() and to(), from wherever the last row is.
  void hold(std::size_t rows) {
    from_last();
    rest(rows);
  }
  void line_to(double x, double y, std::size_t rows) {
    from_last();
    to(x, y, rows);
  }
  void add(double x, double y) {
    commands_[0].push_back(1e-7 * std::round(1e7 * x));
    commands_[1].push_back(1e-7 * std::round(1e7 * y));
  }
  [[nodiscard]] std::size_t rows() const { return commands_[0].size(); }
  [[nodiscard]] std::optional<RepeatingMotion> found() const {
    return repeating_motion(commands_, kCycle_s, kTolerance);
  }

  std::vector<std::vector<double>> commands_{2};

 private:
  void from_last() {
    x_ = commands_[0].back();
    y_ = commands_[1].back();
  }
  double x_ = 0.0, y_ = 0.0;
};

/// 0.5 s out, 0.2 s of pause, a turn of 1 s, 0.05 s of pause, 0.4 s back: 2.15 s without a rest of
/// differing length.
void part(Commands& path) {
  path.to(0.05, 0.02, 500).rest(200).turn(0.01, 1000).rest(50).to(0.0, 0.0, 400);
}
constexpr std::size_t kPartRows = 500 + 200 + 1000 + 50 + 400;

/// The part three times, and a row within the last turn of it.
struct ThreeParts {
  ThreeParts() {
    for (const std::size_t pause : {700U, 731U, 1502U}) {
      in_last_turn = path.rows() + 1200;
      part(path);
      path.rest(pause);
    }
  }
  Commands path;
  std::size_t in_last_turn = 0;
};

TEST(RepeatingMotion, TheBeginsAndThePartAreThoseOfThePathWhateverThePausesBetween) {
  Commands path;
  std::vector<std::size_t> begins;
  for (const std::size_t pause : {700U, 731U, 1502U, 12'000U}) {
    begins.push_back(path.rows());
    part(path);
    path.rest(pause);
  }
  const std::optional<RepeatingMotion> found = path.found();
  ASSERT_TRUE(found);
  EXPECT_EQ(found->begins, begins);
  ASSERT_EQ(found->parts.size(), 1U);
  EXPECT_EQ(found->parts[0].first, begins[2] - kEnd - 1);
  EXPECT_EQ(found->parts[0].rows, kPartRows + 2 * kEnd + 1);
  EXPECT_EQ(found->parts[0].axes, 3U);
  EXPECT_EQ(found->deviation, 0.0);
}

TEST(RepeatingMotion, WithPausesThatAreAllTheSameItBeginsAfterTheLongest) {
  Commands path;
  path.turn(0.01, 1000).rest(50).to(-0.05, -0.02, 400).to(0.0, 0.0, 500).rest(260);
  std::vector<std::size_t> begins;
  for (int i = 0; i < 5; ++i) {
    begins.push_back(path.rows());
    part(path);
    path.rest(260);  // longer than those within
  }
  part(path);  // the last pause is not over
  path.rest(20);
  begins.push_back(begins.back() + kPartRows + 260);
  const std::optional<RepeatingMotion> found = path.found();
  ASSERT_TRUE(found);
  EXPECT_EQ(found->begins, begins);
  ASSERT_EQ(found->parts.size(), 1U);
  EXPECT_EQ(found->parts[0].rows, kPartRows + 2 * kEnd + 1);
}

TEST(RepeatingMotion, ItBeginsAfterAPauseThatDiffersThoughALongerOneIsWithin) {
  Commands path;
  std::vector<std::size_t> begins;
  for (const std::size_t pause : {700U, 731U, 702U, 640U}) {
    begins.push_back(path.rows());
    path.to(0.05, 0.02, 500).rest(5000).to(0.0, 0.0, 400).rest(pause);
  }
  const std::optional<RepeatingMotion> found = path.found();
  ASSERT_TRUE(found);
  EXPECT_EQ(found->begins, begins);
  ASSERT_EQ(found->parts.size(), 1U);
  EXPECT_EQ(found->parts[0].rows, 500 + 5000 + 400 + 2 * kEnd + 1);
}

// Pauses that last for long are shortened to this by who keeps the record.
TEST(RepeatingMotion, ALongPauseDividesItAsOneThatDiffers) {
  Commands path;
  for (const std::size_t pause : {700U, 731U, 702U, 640U})
    path.to(0.05, 0.02, 500).rest(10'000).to(0.0, 0.0, 400).rest(pause);
  const std::optional<RepeatingMotion> found = path.found();
  ASSERT_TRUE(found);
  EXPECT_EQ(found->parts.size(), 2U);
}

// The repetition that begins after the pause that differs is there twice until the third has ended.
TEST(RepeatingMotion, RepetitionsAreWholeOnes) {
  Commands path;
  path.to(0.05, 0.0, 500).rest(300).to(0.0, 0.0, 400);
  for (const std::size_t pause : {700U, 731U}) {
    path.rest(pause).to(0.05, 0.0, 500).rest(300).to(0.0, 0.0, 400);
  }
  for (auto& axis : path.commands_) axis.erase(axis.begin(), axis.begin() + 400);  // within a move
  path.rest(702).to(0.05, 0.0, 500).rest(300);
  EXPECT_FALSE(path.found());
  path.to(0.0, 0.0, 400).rest(50);
  const std::optional<RepeatingMotion> found = path.found();
  ASSERT_TRUE(found);
  EXPECT_EQ(found->begins.size(), 3U);
}

TEST(RepeatingMotion, WhatIsTwiceInARepetitionIsNoRepetition) {
  Commands path;
  std::vector<std::size_t> begins;
  const auto way = [&path] {
    path.to(0.05, 0.0, 500).rest(300).turn(0.01, 800).rest(50).turn(0.01, 800).rest(50);
  };
  for (const std::size_t pause : {700U, 731U, 702U}) {
    begins.push_back(path.rows());
    way();
    path.to(0.0, 0.0, 400).rest(pause);
  }
  way();
  const std::optional<RepeatingMotion> found = path.found();
  ASSERT_TRUE(found);
  EXPECT_EQ(found->begins, begins);
  ASSERT_EQ(found->parts.size(), 1U);
}

TEST(RepeatingMotion, ThatAnotherAxisMovesAsWellMakesItAnother) {
  Commands path;
  for (const std::size_t pause : {700U, 731U, 1502U})
    path.to(0.04, 0.0, 600).rest(200).to(0.0, 0.0, 500).rest(pause);
  ASSERT_TRUE(path.found());
  for (std::size_t k = 1; k <= 600; ++k)
    path.add(0.04 * static_cast<double>(k) / 600.0, 1e-7 * static_cast<double>(k));
  path.to(0.04, 6e-5, 1).rest(200);
  EXPECT_FALSE(path.found());
}

TEST(RepeatingMotion, AStopTooShortForAPauseBelongsToTheMove) {
  for (const std::size_t stop : {8U, 9U}) {
    Commands path;
    for (const std::size_t pause : {700U, 731U, 1502U})
      path.to(0.05, 0.0, 500).rest(pause == 731U ? stop : 9).to(0.0, 0.0, 400).rest(pause);
    EXPECT_EQ(path.found().has_value(), stop == 9);
  }
}

TEST(RepeatingMotion, APauseThatDiffersWithinDividesItIntoParts) {
  Commands path;
  std::vector<std::size_t> begins;
  for (const std::size_t pause : {30U, 31U, 45U, 30U}) {
    begins.push_back(path.rows());
    path.to(0.05, 0.02, 500).rest(200).turn(0.01, 1000).rest(pause).to(0.0, 0.0, 400);
    path.rest(900 + 10 * pause);
  }
  const std::optional<RepeatingMotion> found = path.found();
  ASSERT_TRUE(found);
  EXPECT_EQ(found->begins, begins);
  ASSERT_EQ(found->parts.size(), 2U);
  EXPECT_EQ(found->parts[0].first, begins[2] - kEnd - 1);
  EXPECT_EQ(found->parts[0].rows, kEnd + 1 + 500 + 200 + 1000 + 30) << "the shortest pause";
  EXPECT_EQ(found->parts[1].first, begins[2] + 500 + 200 + 1000 + 45 - 30 - 1);
  EXPECT_EQ(found->parts[1].rows, 30 + 1 + 400 + kEnd);
}

TEST(RepeatingMotion, AWarmUpBeforeAndAMoveThatIsNotOverDoNotCount) {
  Commands path;
  path.to(0.03, 0.0, 300).rest(400).to(0.0, 0.0, 700).rest(80).turn(0.02, 900).rest(500);
  std::vector<std::size_t> begins;
  for (const std::size_t pause : {800U, 900U, 850U}) {
    begins.push_back(path.rows());
    part(path);
    path.rest(pause);
  }
  path.to(0.05, 0.02, 500).rest(9);
  const std::optional<RepeatingMotion> found = path.found();
  ASSERT_TRUE(found);
  EXPECT_EQ(found->begins, begins);
}

TEST(RepeatingMotion, OnlyAxesThatMoveBelongToAPart) {
  Commands path;
  for (const std::size_t pause : {700U, 731U, 1502U, 640U}) {
    path.to(0.04, 0.0, 600).rest(200).to(0.0, 0.0, 500).rest(pause);
  }
  std::optional<RepeatingMotion> found = path.found();
  ASSERT_TRUE(found);
  EXPECT_EQ(found->parts[0].axes, 1U);
  path.commands_[1].assign(path.rows(), std::nan(""));  // sends no command at all
  found = path.found();
  ASSERT_TRUE(found);
  EXPECT_EQ(found->parts[0].axes, 1U);
}

TEST(RepeatingMotion, OfTheSameWayTheShortestSequenceIsTheRepetition) {
  Commands path;
  for (int i = 0; i < 6; ++i) {
    path.to(0.05, 0.0, 500).rest(300 + static_cast<std::size_t>(7 * i * i));
    path.to(0.0, 0.0, 500).rest(1000 + static_cast<std::size_t>(11 * i * i));
  }
  const std::optional<RepeatingMotion> found = path.found();
  ASSERT_TRUE(found);
  EXPECT_EQ(found->begins.size(), 6U);
  EXPECT_EQ(found->parts.size(), 2U);
}

TEST(RepeatingMotion, RowsWithinTheToleranceAreTheSameAndOneBeyondIsNot) {
  for (const double away : {1.5e-6, 2.5e-6}) {
    ThreeParts three;
    three.path.commands_[1][three.in_last_turn] += away;
    const std::optional<RepeatingMotion> found = three.path.found();
    EXPECT_EQ(found.has_value(), away < kTolerance);
    if (found) {
      EXPECT_NEAR(found->deviation, away, 1e-12);
    }
  }
}

TEST(RepeatingMotion, ALostCycleWithinMakesItAnother) {
  for (const bool lost : {false, true}) {
    ThreeParts three;
    if (lost)
      for (auto& axis : three.path.commands_) axis[three.in_last_turn] = std::nan("");
    EXPECT_EQ(three.path.found().has_value(), !lost);
  }
}

TEST(RepeatingMotion, APartThatIsOverAtOnceIsNone) {
  Commands path;
  for (const std::size_t pause : {700U, 731U, 1502U, 640U}) {
    path.to(0.001, 0.0, 150).rest(pause).to(0.0, 0.0, 150).rest(2 * pause);
  }
  EXPECT_FALSE(path.found());
}

// None of these repeats three times; each is asked at every rest, as the daemon asks.
void expect_none(const std::function<void(Commands&, int)>& step, int steps) {
  Commands path;
  for (int i = 0; i < steps; ++i) {
    step(path, i);
    EXPECT_FALSE(path.found()) << "step " << i;
  }
}

TEST(RepeatingMotion, WhatDoesNotRepeatIsNotSaidToRepeat) {
  std::mt19937 random(7);
  const auto below = [&](double most) {
    return std::uniform_real_distribution<double>(0.0, most)(random);
  };
  const auto rows = [&](double most) { return 300 + static_cast<std::size_t>(below(most)); };
  expect_none(
      [&](Commands& path, int) { path.to(below(0.1), below(0.1), rows(800)).rest(rows(200)); },
      150);
  // Jogged by hand, back and forth, at the same speed: never twice as far.
  expect_none(
      [&](Commands& path, int i) {
        path.to(i % 2 == 0 ? 0.1 + below(0.01) : 0.0, 0.0, 700).rest(rows(900));
      },
      100);
  // Jogged by the same step: never from the same place.
  expect_none([&](Commands& path, int i) { path.to(0.01 * (i + 1), 0.0, 400).rest(rows(500)); },
              100);
  // The same part twice, and then another.
  expect_none(
      [&](Commands& path, int i) {
        part(path.rest(rows(100)));
        if (i % 2 == 1) path.rest(300).turn(0.01 + 1e-4 * i, 900);
        path.rest(500);
      },
      40);
  // The same path at another feed each time.
  expect_none(
      [&](Commands& path, int i) { path.rest(300).turn(0.01, 900 + static_cast<std::size_t>(i)); },
      40);
  // A sine never rests.
  Commands sine;
  for (int k = 0; k < 60'000; ++k) sine.add(0.01 * std::sin(2.0 * std::numbers::pi * k / 500.0), 0);
  EXPECT_FALSE(sine.rest(500).found());
}

// A production of two axes without repetition, as the daemon hears it; and the same program run
// four times, with a way back to its begin and pauses that differ.
TEST(RepeatingMotion, ARecordedProductionRepeatsOnlyWhenItIsRunAgain) {
  const Recording recording =
      read_recording(std::filesystem::path(SERVOTWIN_SOURCE_DIR) / "examples/axis_production.csv");
  const std::vector<double>&x = recording.axes[0].command, &y = recording.axes[1].command;
  Commands heard;
  for (std::size_t row = 0; row < x.size(); ++row) {
    heard.add(x[row], y[row]);
    if (row % 1000 == 0) {
      EXPECT_FALSE(heard.found()) << row;
    }
  }
  EXPECT_FALSE(heard.found());
  Commands again;
  for (const std::size_t pause : {700U, 731U, 1502U, 640U}) {
    for (std::size_t row = 0; row < x.size(); ++row) again.add(x[row], y[row]);
    again.hold(200);
    again.line_to(x[0], y[0], 900);
    again.hold(pause);
  }
  const std::optional<RepeatingMotion> found = again.found();
  ASSERT_TRUE(found);
  EXPECT_EQ(found->begins.size(), 4U);
  EXPECT_EQ(found->begins[2] - found->begins[1], x.size() + 200 + 900 + 731);
}

TEST(RepeatingMotion, AHundredMovesInARow) {
  std::mt19937 random(3);
  std::vector<std::size_t> begins;
  Commands path;
  for (int i = 0; i < 4; ++i) {
    begins.push_back(path.rows());
    std::mt19937 same(11);
    std::uniform_real_distribution<double> place(0.0, 0.1);
    for (int k = 0; k < 99; ++k) path.to(place(same), place(same), 100).rest(20);
    path.to(0.0, 0.0, 200).rest(500 + random() % 500);
  }
  const std::optional<RepeatingMotion> found = path.found();
  ASSERT_TRUE(found);
  EXPECT_EQ(found->begins, begins);
  ASSERT_EQ(found->parts.size(), 1U);
  EXPECT_EQ(found->parts[0].rows, 99 * 120 + 200 + 2 * kEnd + 1);
}

}  // namespace
}  // namespace servotwin::daemon
