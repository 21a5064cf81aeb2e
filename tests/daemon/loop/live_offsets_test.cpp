// What the motor feels of live offsets, whatever happens between the daemon and the drive
// (tests/daemon/loop/offset_world.h).
#include <gtest/gtest.h>

#include <random>

#include "tests/daemon/loop/offset_world.h"

namespace servotwin::daemon {
namespace {

using Event = OffsetWorld::Event;

/// Cycles until the correction is well under way; in the first run the daemon has just started.
constexpr int kUnderWay = 3 * OffsetWorld::kPeriod + OffsetWorld::kDwell + 70;
constexpr int kAfterwards = 800;

struct Incident {
  const char* name;
  Event event;
  int size;
};

class LiveOffsetsAfter : public testing::TestWithParam<Incident> {};

TEST_P(LiveOffsetsAfter, TheMotorFeelsNoJump) {
  for (const bool in_command : {true, false}) {
    OffsetWorld world(in_command);
    for (int k = 0; k < kUnderWay; ++k) ASSERT_EQ(world.cycle(), nullptr) << k;
    ASSERT_GT(std::abs(world.felt()), 0.25 * OffsetWorld::kPeak) << "nothing is at stake";
    world.happens(GetParam().event, GetParam().size);
    for (int k = 0; k < kAfterwards; ++k)
      ASSERT_EQ(world.cycle(), nullptr) << k << " cycles after it, offset " << world.felt();
  }
}

INSTANTIATE_TEST_SUITE_P(
    Incidents, LiveOffsetsAfter,
    testing::Values(
        Incident{"OneLostFrame", Event::kLose, 1}, Incident{"TenLostFrames", Event::kLose, 10},
        Incident{"AsManyLostFramesAsTheDriveWaits", Event::kLose, 20},
        Incident{"OneMore", Event::kLose, 21},
        Incident{"LostFramesWhileTheDriveRamps", Event::kLose, 60},
        Incident{"LostFramesUntilTheDriveHasRamped", Event::kLose, 119},
        Incident{"APauseOf5ms", Event::kPause, 5}, Incident{"APauseOf60ms", Event::kPause, 60},
        Incident{"APauseOf100ms", Event::kPause, 100},
        Incident{"ARestartAtOnce", Event::kRestart, 1},
        Incident{"ARestartAfter60ms", Event::kRestart, 60},
        Incident{"AFrameClockThatGoesBack", Event::kFrameClock, -5000},
        Incident{"AFrameClockThatGoesBackALittle", Event::kFrameClock, -7},
        Incident{"AFrameClockThatGoesForward", Event::kFrameClock, 5000},
        Incident{"AFrameClockThatGoesForwardALittle", Event::kFrameClock, 15},
        Incident{"AHostClockThatGoesBack", Event::kHostClock, -30},
        Incident{"AHostClockThatGoesForward", Event::kHostClock, 30},
        Incident{"ABusThatRefusesOnce", Event::kRefuse, 1},
        Incident{"ABusThatRefuses30Times", Event::kRefuse, 30},
        Incident{"Disarming", Event::kDisarm, 300}, Incident{"AnotherModel", Event::kModel, 1},
        Incident{"LateAnswers", Event::kDelay, 40}),
    [](const auto& incident) { return std::string(incident.param.name); });

TEST(LiveOffsets, TheMotorFeelsNoJumpInAnySequenceOfIncidents) {
  std::mt19937_64 rng{20261125};
  std::uniform_int_distribution<int> event(0, OffsetWorld::kEvents - 1), wait(-100, 300);
  std::uniform_int_distribution<int> large(-200, 200), small(-25, 25);
  int corrected = 0;
  constexpr int kSequences = 1000;
  for (int sequence = 0; sequence < kSequences; ++sequence) {
    OffsetWorld world(sequence % 2 == 0);
    for (int incident = 0; incident < 6; ++incident) {
      for (int k = wait(rng); k > 0; --k)
        ASSERT_EQ(world.cycle(), nullptr) << "sequence " << sequence << ", incident " << incident;
      const auto what = static_cast<Event>(event(rng));
      const int size = (rng() & 1U) != 0 ? large(rng) : small(rng);
      const bool clock = what == Event::kFrameClock || what == Event::kHostClock;
      world.happens(what, clock ? size : std::abs(size) + 1);
    }
    for (int k = 0; k < 400; ++k)
      ASSERT_EQ(world.cycle(), nullptr) << "sequence " << sequence << ", at the end";
    if (world.most() > 0.25 * OffsetWorld::kPeak) ++corrected;
  }
  EXPECT_GT(corrected, kSequences / 2) << "the limits were seldom at stake";
}

// Frames that wait look younger than those before them: their age alone does not show the burst.
TEST(LiveOffsets, TheMotorFeelsNoJumpIfTheHostClockIsSetBackInAPause) {
  for (const int pause : {5, 12, 19, 40}) {
    OffsetWorld world(true);
    for (int k = 0; k < kUnderWay; ++k) ASSERT_EQ(world.cycle(), nullptr);
    world.happens(Event::kPause, pause);
    world.happens(Event::kHostClock, -200);
    for (int k = 0; k < kAfterwards; ++k) ASSERT_EQ(world.cycle(), nullptr) << pause << " " << k;
  }
}

// The daemon ends before the drive has nothing, and a run of the next one could begin.
TEST(LiveOffsets, TheMotorFeelsNoJumpWhereverInARunTheDaemonOrTheFramesStop) {
  for (const Event event : {Event::kRestart, Event::kLose, Event::kPause}) {
    for (int at = 0; at < OffsetWorld::kPeriod; at += 3) {
      OffsetWorld world(at % 2 == 0);
      for (int k = 0; k < 3 * OffsetWorld::kPeriod + at; ++k) ASSERT_EQ(world.cycle(), nullptr);
      world.happens(event, 22);
      for (int k = 0; k < kAfterwards; ++k) ASSERT_EQ(world.cycle(), nullptr) << at << " " << k;
    }
  }
}

// A drive may wait for longer than the daemon needs it to: its event timer is as it is.
TEST(LiveOffsets, TheMotorFeelsNoJumpIfTheDriveWaitsLongerThanTheValidity) {
  for (const double timeout_s : {0.025, 0.05, 0.1}) {
    for (const Event event : {Event::kRestart, Event::kLose, Event::kPause}) {
      for (int at = 0; at < OffsetWorld::kPeriod; at += 7) {
        OffsetWorld world(at % 2 == 0, timeout_s);
        for (int k = 0; k < 3 * OffsetWorld::kPeriod + at; ++k) ASSERT_EQ(world.cycle(), nullptr);
        world.happens(event, 22);
        for (int k = 0; k < kAfterwards; ++k) ASSERT_EQ(world.cycle(), nullptr) << at << " " << k;
      }
    }
  }
}

TEST(LiveOffsets, GoOnAfterAnIncidentInTheNextRun) {
  OffsetWorld world(true);
  for (int k = 0; k < kUnderWay; ++k) ASSERT_EQ(world.cycle(), nullptr);
  world.happens(Event::kPause, 60);
  const int next = 3 * OffsetWorld::kPeriod;  // silent until the drive has nothing
  double most = 0.0;
  for (int k = kUnderWay; k < next + kUnderWay; ++k) {
    ASSERT_EQ(world.cycle(), nullptr);
    if (k > next) most = std::max(most, std::abs(world.felt()));
  }
  EXPECT_GT(most, 0.25 * OffsetWorld::kPeak);
}

TEST(Lateness, IsWhatComesOnTopOfAConstant) {
  Lateness lateness;
  for (int k = 0; k < 10; ++k) EXPECT_EQ(lateness.of(5'000'000), 0);
  EXPECT_EQ(lateness.of(5'300'000), 300'000);
  EXPECT_EQ(lateness.of(105'000'000), 100'000'000);
  for (int k = 0; k < 10; ++k) EXPECT_EQ(lateness.of(-995'000'000), 0) << "another clock";
  int late = 0;
  for (int k = 0; k < 3000; ++k) late += lateness.of(5'000'000) > 0 ? 1 : 0;
  EXPECT_LE(late, 1000) << "a clock that was set is followed";
}

}  // namespace
}  // namespace servotwin::daemon
