// The real daemon stands still, or is killed, with an offset out, and its drive is on the network:
// what the motor feels of a drive that follows the rule of readers (msgs/README.md). The same on a
// bus: tests/daemon/offset_kill.h.
#include <gmock/gmock.h>
#include <signal.h>
#include <sys/wait.h>

#include <chrono>
#include <cmath>
#include <numbers>
#include <thread>

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

/// A machine whose drive hears offsets over DDS.
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
      if (axis.send && axis.expires_ns > frame_.time_ns) {
        drive_.receive(axis.offset);
        ++came_;
      } else {
        drive_.drop();
        stale_ += axis.send ? 1 : 0;
      }
      // On a busy host two come in a cycle: the second one follows from the first.
      if (came_ > 1) drive_.cycle();
    }
    felt_ = drive_.cycle();
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
  [[nodiscard]] bool ramping() const { return drive_.ramping(); }
  /// Offsets to be applied that came before the last cycle, and those in all that came too late.
  [[nodiscard]] int came() const { return came_; }
  [[nodiscard]] int stale() const { return stale_; }

 private:
  using Clock = std::chrono::steady_clock;
  DdsWriter<MachineFrame> frames_;
  DdsReader<MachineOffset> offsets_;
  daemon::OffsetDrive drive_{daemon::kCycle_s, kValidity_s, kDriveRamp_s, kStep*(1.0 + 1e-9)};
  Twin twin_;
  MachineFrame frame_;
  Clock::time_point next_ = Clock::now();
  double felt_ = 0.0;
  int came_ = 0, stale_ = 0;
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

  /// Runs the program until part of the correction has been active for a while; its next cycle.
  int run_until_it_corrects() {
    constexpr int kMostRuns = 12;  // a busy host is late, and a late run is given up
    for (int runs = 0; runs < kMostRuns; ++runs) {
      for (int k = 0, out = 0; k < cycles(kPath_s - 0.4); ++k) {
        drive_.cycle(path_at(k));
        out = std::abs(drive_.felt()) > 0.25 * kPeak ? out + 1 : 0;
        if (out == cycles(0.2)) return k + 1;
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

TEST_F(OffsetPause, WhatAPausedDaemonHasWaitingIsNotFelt) {
  for (const double pause_s : {0.01, 0.06, 0.4}) {
    SCOPED_TRACE("a pause of " + std::to_string(pause_s) + " s");
    int k = run_until_it_corrects();
    ASSERT_FALSE(HasFailure());
    daemon_.send(SIGSTOP);
    int status = 0;
    ASSERT_EQ(waitpid(daemon_.id(), &status, WUNTRACED), daemon_.id());
    drive_.cycle(path_at(k++));  // what it had sent before has come
    double before = drive_.felt();
    ASSERT_GT(std::abs(before), 0.1 * kPeak) << "nothing is at stake";
    // Where the drive had to drop the offset, nothing comes until it has ramped it out, and the
    // next run begins from 0.
    bool silent = pause_s > kValidity_s;
    const int stale = drive_.stale();
    for (int after = 0; k < cycles(kPath_s); ++after, ++k) {
      SCOPED_TRACE(std::to_string(after) + " cycles after it stood still");
      if (after == cycles(pause_s)) daemon_.send(SIGCONT);
      drive_.cycle(path_at(k));
      const double most = drive_.ramping() ? kPeak * daemon::kCycle_s / kDriveRamp_s : 3.0 * kStep;
      EXPECT_LE(std::abs(drive_.felt() - before), most * (1.0 + 1e-9));
      EXPECT_LE(drive_.came(), silent ? 0 : 2);
      silent = silent && drive_.felt() != 0.0;
      before = drive_.felt();
    }
    EXPECT_FALSE(silent);
    EXPECT_EQ(drive_.stale(), stale) << "sent after they had expired";
    for (k = 0; k < cycles(1.0); ++k) drive_.cycle(0.0);
  }
  run_until_it_corrects();
  EXPECT_EQ(daemon_.end(SIGTERM), 0) << daemon_.said();
}

TEST_F(OffsetPause, AKilledDaemonsOffsetIsRampedOut) {
  int k = run_until_it_corrects();
  ASSERT_FALSE(HasFailure());
  EXPECT_EQ(daemon_.end(SIGKILL), 128 + SIGKILL);
  double before = drive_.felt();
  int gone = 0;
  for (int after = 0; after < cycles(0.3); ++after) {
    drive_.cycle(path_at(k++));
    const double most = drive_.ramping() ? kPeak * daemon::kCycle_s / kDriveRamp_s : 3.0 * kStep;
    EXPECT_LE(std::abs(drive_.felt() - before), most * (1.0 + 1e-9)) << after;
    before = drive_.felt();
    if (before != 0.0) gone = after + 1;
  }
  EXPECT_LE(gone, cycles(kValidity_s + kDriveRamp_s) + 3);
  EXPECT_GT(gone, cycles(kValidity_s)) << "the drive holds it until it expires";
}

}  // namespace
}  // namespace servotwin::test
