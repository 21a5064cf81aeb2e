// Faults in the frames of a machine, and how they are reported.
#include <gmock/gmock.h>

#include <cmath>

#include "tests/dds/support.h"

namespace servotwin::test {
namespace {

class Faults : public testing::Test {
 protected:
  Faults() {
    EXPECT_TRUE(frames_.wait_for_readers(1, kPatience_s)) << daemon_.said();
    // One frame at a time, so that none is lost where the daemon is slow to begin.
    do {
      EXPECT_TRUE(frames_.write(next()));
    } while (!predictions_.receive(prediction_, 0.3) && k_ < 100);
    drain();
    settle();
    drain();
  }
  void drain() {
    while (predictions_.receive(prediction_, 0.3)) {
    }
  }
  /// Sends this frame and gives the state of the axis in what comes back.
  AxisState after(const MachineFrame& frame) {
    EXPECT_TRUE(frames_.write(frame));
    EXPECT_TRUE(predictions_.receive(prediction_, kPatience_s)) << daemon_.said();
    EXPECT_EQ(prediction_.sequence, frame.sequence);
    return prediction_.axes[0].state;
  }
  MachineFrame next() { return frame_of(k_++); }
  void settle() {
    while (after(next()) != AxisState::kPredicting) ASSERT_LT(k_, 100'000U);
  }
  /// The first status with these counts.
  template <class Wanted>
  bool status_has(const Wanted& wanted) {
    for (int i = 0; i < 60; ++i) {
      if (statuses_.receive(status_, 1.0) && wanted(status_)) return true;
    }
    return false;
  }

  DdsPlace place_ = place_of("faults");
  Home home_{place_, daemon::drive()};
  DdsNode node_{place_};
  DdsWriter<MachineFrame> frames_{node_};
  DdsReader<MachinePrediction> predictions_{node_};
  DdsReader<MachineStatus> statuses_{node_};
  Process daemon_{home_.daemon()};
  MachinePrediction prediction_;
  MachineStatus status_;
  std::uint64_t k_ = 0;
};

TEST_F(Faults, ACommandThatIsNoNumberIsFlaggedAndTheTwinSettlesAgain) {
  for (const double wrong :
       {kAbsent, static_cast<double>(INFINITY), -static_cast<double>(INFINITY)}) {
    MachineFrame frame = next();
    frame.axes[0].command = wrong;
    EXPECT_EQ(after(frame), AxisState::kBadSample);
    EXPECT_TRUE(std::isnan(prediction_.axes[0].predicted_error));
    EXPECT_EQ(after(next()), AxisState::kSettling);
    settle();
    EXPECT_TRUE(std::isfinite(prediction_.axes[0].residual));
  }
  EXPECT_TRUE(status_has([](const MachineStatus& now) { return now.not_finite == 3; }));
}

TEST_F(Faults, TimeThatJumpsEitherWayIsCountedAndTheTwinSettlesAgain) {
  std::int64_t shift_ns = 0;
  for (const std::int64_t jump_ns :
       {std::int64_t{3'600'000'000'000}, -std::int64_t{7'200'000'000'000}}) {
    shift_ns += jump_ns;
    MachineFrame frame = next();
    frame.time_ns += shift_ns;
    EXPECT_EQ(after(frame), AxisState::kSettling) << jump_ns;
    do {
      frame = next();
      frame.time_ns += shift_ns;
    } while (after(frame) != AxisState::kPredicting && k_ < 100'000U);
    EXPECT_EQ(prediction_.axes[0].state, AxisState::kPredicting);
  }
  EXPECT_TRUE(status_has([](const MachineStatus& now) { return now.time_jumps == 2; }));
  EXPECT_EQ(status_.lost, 0U);
}

TEST_F(Faults, FramesWithAnotherNumberOfAxesAreIgnoredAndToldOf) {
  MachineFrame two = frame_of(k_);
  two.axis_count = 2;
  two.axes[1] = two.axes[0];
  ASSERT_TRUE(frames_.write(two));
  EXPECT_FALSE(predictions_.receive(prediction_, 0.3));
  EXPECT_TRUE(daemon_.says("1 frame ignored for lack of the axis of the machine"))
      << daemon_.said();
  EXPECT_EQ(after(next()), AxisState::kPredicting) << "nothing was lost by it";
  EXPECT_TRUE(status_has([](const MachineStatus& now) { return now.malformed == 1; }));
}

TEST_F(Faults, OfTwoWritersTheFirstIsFollowedUntilItLeaves) {
  const DdsNode other_node(place_);
  DdsWriter<MachineFrame> other(other_node);
  ASSERT_TRUE(other.wait_for_readers(1, kPatience_s));
  MachineFrame foreign = frame_of(5);
  foreign.axes[0].command += 0.5;
  bool told = false;
  for (int i = 0; i < 20'000 && !told; ++i) {
    EXPECT_TRUE(other.write(foreign));
    foreign.sequence++;
    ASSERT_EQ(after(next()), AxisState::kPredicting) << "the second one disturbs";
    told = daemon_.said().find("a second writer sends frames of this machine") != std::string::npos;
    dds_sleepfor(DDS_MSECS(1));
  }
  EXPECT_TRUE(told) << daemon_.said();
  EXPECT_TRUE(status_has([](const MachineStatus& now) { return now.frames > 0; }));
  EXPECT_EQ(status_.time_jumps, 0U);
  // The first writer falls silent: the other one is followed now.
  dds_sleepfor(DDS_MSECS(1500));
  drain();
  foreign.sequence = 1'000'000;
  EXPECT_TRUE(other.write(foreign));
  ASSERT_TRUE(predictions_.receive(prediction_, kPatience_s)) << daemon_.said();
  EXPECT_EQ(prediction_.sequence, foreign.sequence);
  EXPECT_EQ(prediction_.axes[0].state, AxisState::kSettling);
}

}  // namespace
}  // namespace servotwin::test
