// The real daemon stands still, or is killed, with an offset out, and its drive is on the network:
// what the motor feels of a drive that follows the rule of readers (msgs/README.md). The same on a
// bus: tests/daemon/offset_kill.h.
#include <gmock/gmock.h>
#include <signal.h>
#include <sys/wait.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <numbers>
#include <string>
#include <thread>
#include <vector>

#include "tests/daemon/http_client.h"
#include "tests/daemon/learned_program.h"
#include "tests/daemon/loop/offset_world.h"
#include "tests/dds/support.h"
#include "twin/twin.h"

namespace servotwin::test {
namespace {

constexpr double kPeak = 2e-4, kRate = 0.01, kValidity_s = 0.02, kDriveRamp_s = 0.1;
constexpr double kStep = kRate * daemon::kCycle_s;  // that the rate allows in a cycle
constexpr double kPath_s = 4.6;
constexpr const char* kToken = "a token of the test";

int cycles(double seconds) { return static_cast<int>(std::lround(seconds / daemon::kCycle_s)); }

/// 20 mm there and back, twice, between dwells.
double path_at(int k) {
  const double t = daemon::kCycle_s * k - 0.3;
  return t < 0.0 || t > 4.0 ? 0.0 : 0.01 * (1.0 - std::cos(std::numbers::pi * t));
}

/// A machine whose drive hears offsets over DDS. It takes steps of up to three times what the rule
/// allows, because on a busy host it misses one now and then; what it refuses is a jump.
class NetworkDrive {
 public:
  NetworkDrive(const DdsNode& node, const Model& model)
      : frames_(node), offsets_(node), twin_(model) {}

  [[nodiscard]] bool heard() const { return frames_.wait_for_readers(1, kPatience_s); }

  /// One cycle: what came since the last one acts, then the next frame leaves.
  void cycle(double path) {
    came_ = 0;
    for (MachineOffset offset; offsets_.receive(offset, 0.0);) {
      const AxisOffset& axis = offset.axes[0];
      // Two in a cycle, on a busy host, act one after the other.
      if (came_ > 0) step();
      ++came_;
      if (!axis.send) {
        drive_.drop();
      } else if (axis.expires_ns > frame_.time_ns && offset.sequence + kOldest >= frame_.sequence) {
        drive_.receive(axis.offset);
      } else {
        ++stale_;
      }
    }
    step();
    twin_.follow(path + felt_);
    frame_.sequence += 1;
    frame_.time_ns += 1'000'000;
    frame_.axis_count = 1;
    frame_.axes[0].command = path;
    frame_.axes[0].actual = twin_.position();
    frames_.write(frame_);
    next_ = std::max(next_, Clock::now()) + std::chrono::milliseconds(1);
    std::this_thread::sleep_until(next_);
  }
  [[nodiscard]] double felt() const { return felt_; }
  /// Whether the drive itself takes an offset away that was not renewed.
  [[nodiscard]] bool ramping() const { return drive_.ramping() && felt_ != 0.0; }
  /// Offsets so far that the drive took, that were jumps, and that answer a frame of long ago.
  [[nodiscard]] int taken() const { return taken_; }
  [[nodiscard]] int jumps() const { return jumps_; }
  [[nodiscard]] int stale() const { return stale_; }

 private:
  using Clock = std::chrono::steady_clock;
  static constexpr std::uint64_t kOldest = 5;  // cycles; what waits in a pause is older

  void step() {
    felt_ = drive_.cycle();
    taken_ += drive_.took() ? 1 : 0;
    jumps_ += drive_.refused() ? 1 : 0;
  }

  DdsWriter<MachineFrame> frames_;
  DdsReader<MachineOffset> offsets_;
  daemon::OffsetDrive drive_{daemon::kCycle_s, kValidity_s, kDriveRamp_s, kStep*(1.0 + 1e-9)};
  Twin twin_;
  MachineFrame frame_;
  Clock::time_point next_ = Clock::now();
  double felt_ = 0.0;
  int came_ = 0, taken_ = 0, jumps_ = 0, stale_ = 0;
};

class OffsetPause : public testing::Test {
 protected:
  void SetUp() override {
    const std::string at = "page at http://127.0.0.1:";
    for (const std::string& line : {at, std::string("X: model 1 is in force again")})
      ASSERT_TRUE(daemon_.says(line)) << daemon_.said();
    ASSERT_TRUE(drive_.heard());
    for (int k = 0; k < cycles(1.0); ++k) drive_.cycle(0.0);
    std::vector<double> path;
    for (int k = 0; k < cycles(kPath_s); ++k) path.push_back(path_at(k));
    learn_program(node_, "part", path, daemon::kCycle_s);
    ASSERT_FALSE(HasFailure());
    const auto port = static_cast<std::uint16_t>(
        std::stoi(daemon_.said().substr(daemon_.said().find(at) + at.size())));
    const daemon::HttpAnswer armed =
        daemon::ask(port, "POST", "/api/v1/offsets/arm",
                    std::string("Authorization: Bearer ") + kToken + "\r\n");
    ASSERT_EQ(armed.status, 200) << armed.body;
    for (int k = 0; k < cycles(0.2); ++k) drive_.cycle(0.0);
  }

  /// Runs the program until part of the correction has been active for a while, with this much of
  /// the program left; its next cycle.
  int run_until_it_corrects(double left_s) {
    // A busy host is late, and a late answer ends a run: 50 cycles in a row without one come on a
    // host that is late in every twentieth, 200 in a row do not.
    constexpr int kMostRuns = 24;
    constexpr double kActive_s = 0.05;
    for (int runs = 0; runs < kMostRuns; ++runs) {
      for (int k = 0, out = 0; k < cycles(kPath_s - left_s); ++k) {
        drive_.cycle(path_at(k));
        // After a late answer the drive ramps the offset out; that does not count as a correction.
        out = std::abs(drive_.felt()) > 0.25 * kPeak && !drive_.ramping() ? out + 1 : 0;
        if (out == cycles(kActive_s)) return k + 1;
      }
      for (int k = 0; k < cycles(1.0); ++k) drive_.cycle(0.0);
    }
    ADD_FAILURE() << "no offset came\n" << daemon_.said();
    return 0;
  }

  const DdsPlace place_ = place_of("pause");
  const Home home_{
      place_,
      daemon::drive(),
      0,
      "for this test",
      std::string("[http]\nlisten = '127.0.0.1:0'\ntoken = '") + kToken +
          "'\n[ilc]\nlive = true\nmodel_age_s = 1e9\n[identify]\nwindow_s = 120\nmemory_s = 120\n",
      "correction = { peak = " + std::to_string(kPeak) + ", rate = " + std::to_string(kRate) +
          ", bandwidth = 20 }\n"};
  DdsNode node_{place_};
  NetworkDrive drive_{node_, daemon::drive()};
  Process daemon_{home_.daemon()};
};

TEST_F(OffsetPause, WhatAPausedDaemonHasWaitingIsNotSent) {
  for (const double pause_s : {0.01, 0.06, 0.4}) {
    SCOPED_TRACE("a pause of " + std::to_string(pause_s) + " s");
    int k = run_until_it_corrects(pause_s + 0.3);
    ASSERT_FALSE(HasFailure());
    daemon_.send(SIGSTOP);
    int status = 0;
    ASSERT_EQ(waitpid(daemon_.id(), &status, WUNTRACED), daemon_.id());
    drive_.cycle(path_at(k++));  // what it had sent before has come
    ASSERT_GT(std::abs(drive_.felt()), 0.1 * kPeak) << "nothing is at stake";
    // Where the drive had to drop the offset, nothing comes until it has ramped it out, and the
    // next run begins from 0.
    bool silent = pause_s > kValidity_s;
    const int jumps = drive_.jumps(), stale = drive_.stale();
    for (int after = 0; k < cycles(kPath_s); ++after, ++k) {
      if (after == cycles(pause_s)) daemon_.send(SIGCONT);
      const int taken = drive_.taken();
      drive_.cycle(path_at(k));
      if (silent) {
        EXPECT_EQ(drive_.taken(), taken) << after << " cycles after it stood still";
      }
      silent = silent && drive_.felt() != 0.0;
    }
    EXPECT_FALSE(silent);
    EXPECT_EQ(drive_.jumps(), jumps);
    EXPECT_EQ(drive_.stale(), stale) << "sent after the pause";
    for (k = 0; k < cycles(1.0); ++k) drive_.cycle(0.0);
  }
  // It corrects again; asked to stop, it fades out, so that the drive has nothing to ramp out.
  int k = run_until_it_corrects(0.5);
  ASSERT_FALSE(HasFailure());
  const int jumps = drive_.jumps();
  daemon_.send(SIGTERM);
  int ramped = 0;
  for (int after = 0; after < cycles(0.3); ++after) {
    drive_.cycle(path_at(k++));
    ramped += drive_.ramping() ? 1 : 0;
  }
  // One late answer of a busy host ends the run, and the drive takes the offset away: also without
  // a jump, but nothing that the daemon could be blamed for.
  if (ramped > 0) RecordProperty("cycles_after_a_late_answer", ramped);
  EXPECT_LE(ramped, cycles(kDriveRamp_s) + 1);
  EXPECT_EQ(drive_.felt(), 0.0);
  EXPECT_EQ(drive_.jumps(), jumps);
  EXPECT_EQ(daemon_.end(0), 0) << daemon_.said();
}

TEST_F(OffsetPause, AKilledDaemonLeavesAnOffsetThatExpires) {
  int k = run_until_it_corrects(0.5);
  ASSERT_FALSE(HasFailure());
  EXPECT_EQ(daemon_.end(SIGKILL), 128 + SIGKILL);
  int gone = 0;
  for (int after = 0; after < cycles(0.3); ++after) {
    drive_.cycle(path_at(k++));
    if (drive_.felt() != 0.0) gone = after + 1;
  }
  EXPECT_LE(gone, cycles(kValidity_s + kDriveRamp_s) + 3);
  EXPECT_GT(gone, cycles(kValidity_s)) << "the drive holds it until it expires";
}

}  // namespace
}  // namespace servotwin::test
