// What the motor feels of live offsets, whatever happens between the daemon and the drive
// (tests/daemon/loop/offset_world.h).
#include <gtest/gtest.h>

#include <cstdlib>
#include <random>
#include <string>

#include "tests/daemon/loop/offset_world.h"

namespace servotwin::daemon {
namespace {

using WorldEvent = OffsetWorld::Event;

/// Cycles until the correction is well under way; in the first run the daemon has just started.
constexpr int kUnderWay = 3 * OffsetWorld::kPeriod + OffsetWorld::kDwell + 70;
constexpr int kAfterwards = 800;

/// Each kind of drive in turn.
OffsetWorld::Drive nth_drive(int n) {
  return OffsetWorld::kAllDrives[static_cast<std::size_t>(n % OffsetWorld::kDrives)];
}

/// SERVOTWIN_SEQUENCES in the environment: how many random sequences are tried.
int sequences_wanted() {
  constexpr int kSequences = 1000;  // half a minute with sanitizers
  const char* wanted = std::getenv("SERVOTWIN_SEQUENCES");
  return wanted == nullptr ? kSequences : std::stoi(wanted);
}

struct Incident {
  const char* name;
  WorldEvent event;
  int size;
};

class LiveOffsetsAfter : public testing::TestWithParam<Incident> {};

TEST_P(LiveOffsetsAfter, TheMotorFeelsNoJump) {
  for (const OffsetWorld::Drive drive : OffsetWorld::kAllDrives) {
    OffsetWorld world(drive);
    for (int k = 0; k < kUnderWay; ++k) ASSERT_STREQ(world.cycle(), nullptr) << k;
    ASSERT_GT(std::abs(world.felt()), 0.25 * OffsetWorld::kPeak) << "nothing is at stake";
    world.happens(GetParam().event, GetParam().size);
    for (int k = 0; k < kAfterwards; ++k)
      ASSERT_STREQ(world.cycle(), nullptr) << k << " cycles after it, offset " << world.felt();
  }
}

INSTANTIATE_TEST_SUITE_P(
    Incidents, LiveOffsetsAfter,
    testing::Values(Incident{"OneLostFrame", WorldEvent::kLose, 1},
                    Incident{"TenLostFrames", WorldEvent::kLose, 10},
                    Incident{"AsManyLostFramesAsTheDriveWaits", WorldEvent::kLose, 20},
                    Incident{"OneMore", WorldEvent::kLose, 21},
                    Incident{"LostFramesWhileTheDriveRamps", WorldEvent::kLose, 60},
                    Incident{"LostFramesUntilTheDriveHasRamped", WorldEvent::kLose, 119},
                    Incident{"APauseOf5ms", WorldEvent::kPause, 5},
                    Incident{"APauseOf60ms", WorldEvent::kPause, 60},
                    Incident{"APauseOf100ms", WorldEvent::kPause, 100},
                    Incident{"ARestartAtOnce", WorldEvent::kRestart, 1},
                    Incident{"ARestartAfter60ms", WorldEvent::kRestart, 60},
                    Incident{"AFrameClockThatGoesBack", WorldEvent::kFrameClock, -5000},
                    Incident{"AFrameClockThatGoesBackALittle", WorldEvent::kFrameClock, -7},
                    Incident{"AFrameClockThatGoesForward", WorldEvent::kFrameClock, 5000},
                    Incident{"AFrameClockThatGoesForwardALittle", WorldEvent::kFrameClock, 15},
                    Incident{"AHostClockThatGoesBack", WorldEvent::kHostClock, -30},
                    Incident{"AHostClockThatGoesForward", WorldEvent::kHostClock, 30},
                    Incident{"ABusThatRefusesOnce", WorldEvent::kRefuse, 1},
                    Incident{"ABusThatRefuses30Times", WorldEvent::kRefuse, 30},
                    Incident{"Disarming", WorldEvent::kDisarm, 300},
                    Incident{"AnotherModel", WorldEvent::kModel, 1},
                    Incident{"LateAnswers", WorldEvent::kDelay, 40},
                    Incident{"OneLostOffset", WorldEvent::kLoseOffset, 1},
                    Incident{"TenLostOffsets", WorldEvent::kLoseOffset, 10},
                    Incident{"OffsetsLostUntilTheDriveRamps", WorldEvent::kLoseOffset, 30},
                    Incident{"OffsetsLostUntilTheDriveHasRamped", WorldEvent::kLoseOffset, 125},
                    Incident{"ASleepOf60ms", WorldEvent::kSleep, 60},
                    Incident{"AVirtualMachineThatStoodStillFor15ms", WorldEvent::kSleep, 15},
                    Incident{"AVirtualMachineThatStoodStillFor61ms", WorldEvent::kSleep, 61},
                    Incident{"AVirtualMachineThatStoodStillFor125ms", WorldEvent::kSleep, 125},
                    Incident{"APublisherThatStoodStillFor2ms", WorldEvent::kPublisher, 2},
                    Incident{"APublisherThatStoodStillFor15ms", WorldEvent::kPublisher, 15},
                    Incident{"APublisherThatStoodStillFor60ms", WorldEvent::kPublisher, 60},
                    Incident{"APublisherThatStoodStillFor125ms", WorldEvent::kPublisher, 125},
                    Incident{"ASlowSocket", WorldEvent::kSlow, 100}),
    [](const auto& incident) { return std::string(incident.param.name); });

TEST(LiveOffsets, TheMotorFeelsNoJumpInAnySequenceOfIncidents) {
  std::mt19937_64 rng{20261125};
  std::uniform_int_distribution<int> event(0, OffsetWorld::kEvents - 1), wait(-100, 300);
  std::uniform_int_distribution<int> large(-200, 200), small(-25, 25);
  int corrected = 0;
  const int sequences = sequences_wanted();
  for (int sequence = 0; sequence < sequences; ++sequence) {
    OffsetWorld world(nth_drive(sequence));
    for (int incident = 0; incident < 6; ++incident) {
      for (int k = wait(rng); k > 0; --k)
        ASSERT_STREQ(world.cycle(), nullptr)
            << "sequence " << sequence << ", incident " << incident;
      const auto what = static_cast<WorldEvent>(event(rng));
      const int size = (rng() & 1U) != 0 ? large(rng) : small(rng);
      const bool clock = what == WorldEvent::kFrameClock || what == WorldEvent::kHostClock;
      world.happens(what, clock ? size : std::abs(size) + 1);
    }
    for (int k = 0; k < 400; ++k)
      ASSERT_STREQ(world.cycle(), nullptr) << "sequence " << sequence << ", at the end";
    if (world.most() > 0.25 * OffsetWorld::kPeak) ++corrected;
  }
  EXPECT_GT(corrected, sequences / 2) << "the limits were seldom at stake";
}

// Frames that wait look younger than those before them: their age alone does not show the burst.
TEST(LiveOffsets, TheMotorFeelsNoJumpIfTheHostClockIsSetBackInAPause) {
  for (const int pause : {5, 12, 19, 40}) {
    OffsetWorld world(OffsetWorld::Drive::kOnBus);
    for (int k = 0; k < kUnderWay; ++k) ASSERT_STREQ(world.cycle(), nullptr);
    world.happens(WorldEvent::kPause, pause);
    world.happens(WorldEvent::kHostClock, -200);
    for (int k = 0; k < kAfterwards; ++k) ASSERT_STREQ(world.cycle(), nullptr) << pause << " " << k;
  }
}

// The daemon ends before the drive has nothing, and a run of the next one could begin.
TEST(LiveOffsets, TheMotorFeelsNoJumpWhereverInARunTheDaemonOrTheFramesStop) {
  for (const WorldEvent event : {WorldEvent::kRestart, WorldEvent::kLose, WorldEvent::kPause}) {
    for (int at = 0; at < OffsetWorld::kPeriod; at += 2) {
      OffsetWorld world(nth_drive(at));
      for (int k = 0; k < 3 * OffsetWorld::kPeriod + at; ++k) ASSERT_STREQ(world.cycle(), nullptr);
      world.happens(event, 22);
      for (int k = 0; k < kAfterwards; ++k) ASSERT_STREQ(world.cycle(), nullptr) << at << " " << k;
    }
  }
}

// What waits in the ring is of no drive's concern; what no longer fits into it is.
TEST(LiveOffsets, TheMotorFeelsNoJumpIfThePublisherStandsStillFromADryRunIntoALiveOne) {
  OffsetWorld world(OffsetWorld::Drive::kOnNetwork);
  for (int k = 0; k < 3 * OffsetWorld::kPeriod; ++k) ASSERT_STREQ(world.cycle(), nullptr);
  world.happens(WorldEvent::kDisarm, 2 * OffsetWorld::kPeriod - 1);
  for (int k = 0; k < OffsetWorld::kDwell; ++k) ASSERT_STREQ(world.cycle(), nullptr);
  world.happens(WorldEvent::kPublisher, 2 * OffsetWorld::kPeriod + 85);
  for (int k = 0; k < kAfterwards; ++k) ASSERT_STREQ(world.cycle(), nullptr) << k;
}

// A drive may wait for longer than the daemon needs it to: its event timer is as it is.
TEST(LiveOffsets, TheMotorFeelsNoJumpIfTheDriveWaitsLongerThanTheValidity) {
  for (const double timeout_s : {0.025, 0.05, 0.1}) {
    for (const WorldEvent event : {WorldEvent::kRestart, WorldEvent::kLose, WorldEvent::kPause}) {
      for (int at = 0; at < OffsetWorld::kPeriod; at += 7) {
        OffsetWorld world(nth_drive(at), timeout_s);
        for (int k = 0; k < 3 * OffsetWorld::kPeriod + at; ++k)
          ASSERT_STREQ(world.cycle(), nullptr);
        world.happens(event, 22);
        for (int k = 0; k < kAfterwards; ++k)
          ASSERT_STREQ(world.cycle(), nullptr) << at << " " << k;
      }
    }
  }
}

TEST(LiveOffsets, GoOnAfterAnIncidentInTheNextRun) {
  OffsetWorld world(OffsetWorld::Drive::kOnBus);
  for (int k = 0; k < kUnderWay; ++k) ASSERT_STREQ(world.cycle(), nullptr);
  world.happens(WorldEvent::kPause, 60);
  const int next = 3 * OffsetWorld::kPeriod;  // silent until the drive has nothing
  double most = 0.0;
  for (int k = kUnderWay; k < next + kUnderWay; ++k) {
    ASSERT_STREQ(world.cycle(), nullptr);
    if (k > next) most = std::max(most, std::abs(world.felt()));
  }
  EXPECT_GT(most, 0.25 * OffsetWorld::kPeak);
}

// The service waits for as long before it ends.
TEST(LiveOffsets, FadeOutWithinTheTimeThatIsSaidWhereTheRateIsSlowerThanTheRamp) {
  OffsetRules rules;
  rules.cycle_s = 1e-3;
  rules.ramp_s = 0.05;
  rules.limits = {{2e-4, 5e-4, 40.0, rules.ramp_s, 0.02, 1e6, true, rules.cycle_s}};
  Gate gate(rules.limits[0]);
  GateRequest request{.offset = 2e-4,
                      .expires_ns = 10'000'000'000,
                      .model_validated = true,
                      .axis_state_matches = true};
  const auto pass = [&] {
    request.now_ns += 1'000'000;
    return gate.pass(request).offset;
  };
  while (pass() < 2e-4) ASSERT_LT(request.now_ns, 5'000'000'000);
  request.axis_state_matches = false;
  int cycles = 1;
  while (pass() > 0.0) ++cycles;
  EXPECT_GT(cycles * rules.cycle_s, 2.0 * rules.ramp_s);
  EXPECT_LE(cycles * rules.cycle_s, fade_out_s(rules) + rules.cycle_s);
}

/// Frames of 1 kHz.
class LatenessTest : public testing::Test {
 protected:
  std::int64_t of(std::int64_t age_ns) { return lateness_.of(age_ns, now_ns_ += 1'000'000); }
  /// How many of so many frames of this age are late.
  int late(int frames, std::int64_t age_ns) {
    int count = 0;
    for (int k = 0; k < frames; ++k) count += of(age_ns) > 0 ? 1 : 0;
    return count;
  }
  Lateness lateness_{1'000'000};
  std::int64_t now_ns_ = 7'000'000'000;
};

TEST_F(LatenessTest, IsWhatComesOnTopOfAConstant) {
  for (int k = 0; k < 10; ++k) EXPECT_EQ(of(5'000'000), 0);
  EXPECT_EQ(of(5'300'000), 300'000);
  EXPECT_EQ(of(105'000'000), 100'000'000);
}

TEST_F(LatenessTest, FollowsAClockThatWasSet) {
  EXPECT_EQ(late(10, 5'000'000), 0);
  EXPECT_EQ(late(10, -995'000'000), 0) << "back";
  EXPECT_LE(late(5000, 5'000'000), 2001) << "forward";
  EXPECT_EQ(late(10, 5'000'000), 0);
}

// As a daemon on a host that has too much to do: it does not become punctual by being late.
TEST_F(LatenessTest, OfADaemonThatIsAlwaysLateIsNotForgotten) {
  late(1000, 100'000);
  EXPECT_EQ(late(50'000, 900'000), 50'000);
  EXPECT_EQ(of(900'000), 800'000);
  EXPECT_LT(late(70'000, 900'000), 20'000) << "after a minute a clock was set";
}

TEST_F(LatenessTest, FollowsClocksThatDriftApart) {
  std::int64_t age = 100'000;
  for (int k = 0; k < 600'000; ++k) {
    age += 50;  // 50 ppm, for ten minutes
    ASSERT_LT(of(age), 100'000);
  }
}

}  // namespace
}  // namespace servotwin::daemon
