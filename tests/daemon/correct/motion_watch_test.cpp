// What the daemon keeps of the commands that it hears, and the program that it makes of them: rows
// as they come, in pieces, with lost cycles and long pauses.
#include "daemon/correct/motion_watch.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

namespace servotwin::daemon {
namespace {

using testing::ElementsAre;

constexpr double kCycle_s = 1e-3;

/// A machine of X and Y, heard in pieces of 100 cycles.
struct Heard {
  void hear(double x, double y) {
    if (news.axes.empty()) news.axes = {{"X", false, {}, {}, {}, {}}, {"Y", false, {}, {}, {}, {}}};
    news.time.push_back((now_s += kCycle_s) + late_s);
    news.axes[0].command.push_back(x);
    news.axes[1].command.push_back(y);
    if (news.time.size() == 100) send();
  }
  void send() {
    if (watch.take(news)) ++ended;
    news = Recording();
  }
  void rest(int rows) {
    for (int k = 0; k < rows; ++k) hear(0.2, 0.1);
  }
  /// One turn of a circle: 1 s. `lost`: this many of its cycles are not heard.
  void turn(double radius = 0.01, int lost = 0) {
    for (int k = 1; k <= 1000; ++k) {
      const double angle = 2.0 * std::numbers::pi * k / 1000.0;
      if (k >= 500 && k < 500 + lost) {
        now_s += kCycle_s;
      } else {
        late_s = late_at == k ? 0.9 * kCycle_s : 0.0;
        hear(0.2 + radius * (1.0 - std::cos(angle)), 0.1 + radius * std::sin(angle));
      }
    }
  }

  MotionWatch watch{{kCycle_s, {{"X", false, ""}, {"Y", false, ""}}}, 2e-6};
  Recording news;
  double now_s = 0.0, late_s = 0.0;
  int late_at = 0;  // the cycle of a turn whose stamp is late, once
  int ended = 0;
};

TEST(MotionWatch, WhatRepeatsIsAProgramOfTheMotionItselfUnderALastingName) {
  Heard machine;
  machine.rest(300);
  for (const int pause : {700, 800, 640}) {
    machine.turn();
    machine.rest(pause);
  }
  machine.send();
  EXPECT_EQ(machine.ended, 3) << "once for every move";
  const std::optional<RepeatingMotion> found = machine.watch.repetition();
  ASSERT_TRUE(found);
  EXPECT_EQ(found->begins.size(), 3U);
  const auto [shortest_s, longest_s] = machine.watch.periods_s(*found);
  EXPECT_NEAR(shortest_s, 1.7, 1e-9);
  EXPECT_NEAR(longest_s, 1.8, 1e-9);
  const CommandedPath program = machine.watch.program_of(found->parts[0]);
  EXPECT_TRUE(program.learn);
  EXPECT_THAT(program.axes, ElementsAre(0U, 1U));
  ASSERT_EQ(program.rows(), 101 + 1000 + 100);
  for (int k = 0; k < 1201; ++k) {
    const double angle = 2.0 * std::numbers::pi * std::clamp(k - 100, 0, 1000) / 1000.0;
    EXPECT_NEAR(program.command[1](k), 0.1 + 0.01 * std::sin(angle), 1e-12) << k;
  }
  Heard later;
  later.rest(17);
  for (const int pause : {60, 55, 71}) {  // shorter rests at its ends
    later.turn();
    later.rest(pause);
  }
  later.send();
  const std::optional<RepeatingMotion> again = later.watch.repetition();
  ASSERT_TRUE(again);
  EXPECT_LT(again->parts[0].rows, found->parts[0].rows);
  EXPECT_EQ(later.watch.program_of(again->parts[0]).name, program.name);
}

TEST(MotionWatch, CyclesLostInAMoveMakeItAnotherButNotInAPause) {
  Heard machine;
  for (const int lost : {0, 1, 3}) {
    SCOPED_TRACE(lost);
    machine.watch.forget();
    machine.rest(300);
    for (const int pause : {700, 800, 640}) {
      machine.turn(0.01, lost);  // the same each time: the rows that are heard repeat
      machine.rest(200);
      machine.now_s += 0.3;
      machine.rest(pause);
    }
    machine.send();
    EXPECT_EQ(machine.watch.repetition().has_value(), lost == 0);
  }
}

// An adapter that hands several frames over at once stamps some of them late; none is lost.
TEST(MotionWatch, ALateStampMakesItNoOtherMove) {
  for (const int lost : {0, 1}) {
    SCOPED_TRACE(lost);
    Heard machine;
    machine.rest(300);
    int turns = 0;
    for (const int pause : {700, 800, 640}) {
      machine.late_at = 100 * ++turns;
      machine.turn(0.01, lost);
      machine.rest(pause);
    }
    machine.late_at = 999;  // near its end
    machine.turn(0.01, lost);
    machine.rest(700);
    machine.send();
    const auto found = machine.watch.repetition();
    ASSERT_EQ(found.has_value(), lost == 0);
    EXPECT_EQ(found ? found->begins.size() : 0U, lost == 0 ? 4U : 0U);
  }
}

TEST(MotionWatch, ACommandNotHeardDoesNotMatterInAPause) {
  for (const bool in_pause : {true, false}) {
    Heard machine;
    machine.rest(300);
    for (const int pause : {700, 800, 640}) {
      machine.turn();
      machine.rest(pause);
      if (in_pause) machine.hear(0.2, std::nan(""));
      machine.rest(300);
    }
    if (!in_pause) {
      machine.hear(0.21, std::nan(""));  // a move of its own
      machine.rest(50);
    }
    machine.send();
    EXPECT_EQ(machine.watch.repetition().has_value(), in_pause);
  }
}

TEST(MotionWatch, ALongPauseTakesNoMemoryAndItsTimeStillCounts) {
  Heard machine;
  machine.rest(300);
  for (const int pause : {20'000, 25'000, 30'000, 640}) {
    machine.turn();
    machine.rest(pause);
  }
  machine.send();
  const std::optional<RepeatingMotion> found = machine.watch.repetition();
  ASSERT_TRUE(found);
  EXPECT_LT(found->begins.back(), 40'000U);
  const auto [shortest_s, longest_s] = machine.watch.periods_s(*found);
  EXPECT_NEAR(shortest_s, 21.0, 1e-9);
  EXPECT_NEAR(longest_s, 31.0, 1e-9);
}

TEST(MotionWatch, WhatIsForgottenDoesNotCount) {
  Heard machine;
  machine.rest(300);
  machine.turn();
  machine.rest(700);
  machine.turn();
  machine.rest(800);
  machine.send();
  machine.watch.forget();
  machine.rest(300);
  machine.turn();
  machine.rest(700);
  machine.send();
  EXPECT_FALSE(machine.watch.repetition());
}

TEST(MotionWatch, TheOldestAreDroppedWhenThereAreTooMany) {
  Heard machine;
  machine.rest(300);
  // 2.1 million rows of two axes, of which none repeats.
  for (int i = 0; i < 2100; ++i) machine.turn(0.01 + 1e-5 * i);
  for (const int pause : {700, 800, 640}) {
    machine.rest(pause);
    machine.turn();
  }
  machine.rest(100);
  machine.send();
  const std::optional<RepeatingMotion> found = machine.watch.repetition();
  ASSERT_TRUE(found);
  EXPECT_LT(found->begins.back(), kMaxWatchedValues / 2);
}

}  // namespace
}  // namespace servotwin::daemon
