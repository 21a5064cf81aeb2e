// A daemon that dies or stands still with offsets out, in front of a virtual drive.
#pragma once

#include <sys/wait.h>

#include "tests/daemon/corrected_drive.h"
#include "tests/daemon/learned_program.h"

namespace servotwin::test {

class OffsetKill : public CorrectedDrive {
 protected:
  /// `source`: the [source..] section of this bus; the map is map.toml. The daemon learns, is armed
  /// and gets `signal` while its offset is active; the test observes the drive.
  void end_it_and_watch_the_drive(std::unique_ptr<CanBus> bus, const std::string& source,
                                  double cycle_s, int signal) {
    const std::unique_ptr<Process> running = armed(std::move(bus), source, cycle_s);
    ASSERT_NE(running, nullptr);
    Process& daemon = *running;
    int k = 0;
    ASSERT_NO_FATAL_FAILURE(run_until_it_corrects(daemon, k));
    daemon.send(signal);
    const long sent_before = offsets_;

    const double left = added(path_at(k - 1));
    EXPECT_GT(std::abs(left), 0.25 * kPeak);
    const bool asked = signal != SIGKILL;
    double before = left;
    int gone = 0;  // cycles until nothing is added
    int last = 0;  // cycle in which its last offset came
    constexpr double kWatched_s = 0.3;
    for (int after = 0; after < cycles(kWatched_s); ++after, ++k) {
      const long sent = offsets_;
      cycle(path_at(k));
      const double now = added(path_at(k));
      if (offsets_ != sent) {
        last = after;
        // Asked to stop it fades the offset out; on a busy host two of its steps may come in one
        // cycle of the drive. What a host that was late brings first is not of that.
        if (asked && after > 1) {
          EXPECT_LE(std::abs(now - before), 3.0 * kRate * cycle_s_ + kSteps) << after;
        }
      } else {
        EXPECT_LE(std::abs(now - before), ramp_step() + kSteps) << after << ": a ramp, no step";
      }
      if (std::abs(now) > 1.1e-8) gone = after;
      before = now;
    }
    // When a busy host tells the daemon that it is asked to stop is not the daemon's matter.
    EXPECT_LE(gone,
              asked ? cycles(kWatched_s) - 2
                    : cycles(VirtualDrive::kOffsetValidity_s + VirtualDrive::kOffsetRamp_s) + 3);
    if (asked) {
      EXPECT_GE(offsets_ - sent_before, std::min<long>(gone, cycles(kRamp_s)) / 2)
          << "the daemon fades out, not the drive";
      EXPECT_EQ(daemon.end(0), 0) << daemon.said();
    } else {
      EXPECT_LE(last, 2) << "what was on its way, and no more";
      EXPECT_EQ(daemon.end(0), 128 + SIGKILL);
    }
  }

  /// The daemon stands still for each of these times, each in a run of its own, and then finds all
  /// frames of that time at once.
  void pause_it_and_watch_the_drive(std::unique_ptr<CanBus> bus, const std::string& source,
                                    double cycle_s, const std::vector<double>& pauses_s) {
    const std::unique_ptr<Process> running = armed(std::move(bus), source, cycle_s);
    ASSERT_NE(running, nullptr);
    for (const double pause_s : pauses_s) {
      SCOPED_TRACE("a pause of " + std::to_string(pause_s) + " s");
      int k = 0;
      ASSERT_NO_FATAL_FAILURE(run_until_it_corrects(*running, k));
      running->send(SIGSTOP);
      int status = 0;
      ASSERT_EQ(waitpid(running->id(), &status, WUNTRACED), running->id());
      cycle(path_at(k++));  // what it had sent before has come
      double before = added(path_at(k - 1));
      ASSERT_GT(std::abs(before), 0.1 * kPeak) << "nothing is at stake";
      // After a short pause the drive still has the offset. Otherwise it ramps it out: until it
      // has, nothing comes, and the next run begins from 0.
      bool ramps = pause_s > VirtualDrive::kOffsetValidity_s;
      for (int after = 0; k < cycles(kPath_s); ++after, ++k) {
        SCOPED_TRACE(std::to_string(after) + " cycles after it stood still");
        if (after == cycles(pause_s)) running->send(SIGCONT);
        const long sent = offsets_;
        cycle(path_at(k));
        const double now = added(path_at(k));
        EXPECT_LE(std::abs(now - before), (ramps ? ramp_step() : 3.0 * kRate * cycle_s_) + kSteps);
        // On a busy host two may come in a cycle of the drive; all of a pause would be more.
        EXPECT_LE(offsets_ - sent, ramps ? 0 : 2);
        ramps = ramps && std::abs(now) > 1.1e-8;
        before = now;
      }
      EXPECT_FALSE(ramps);
      for (k = 0; k < cycles(1.0); ++k) cycle(0.0);
    }
    int k = 0;
    EXPECT_NO_FATAL_FAILURE(run_until_it_corrects(*running, k)) << "it corrects again";
    EXPECT_EQ(running->end(SIGKILL), 128 + SIGKILL);
  }

  /// The daemon refuses to be armed, with `reason`. `timeout`: the line of the mapping.
  void expect_not_armed(std::unique_ptr<CanBus> bus, const std::string& source, double cycle_s,
                        const std::string& timeout, const std::string& reason) {
    timeout_ = timeout;
    const std::unique_ptr<Process> daemon = started(std::move(bus), source, cycle_s);
    ASSERT_NE(daemon, nullptr);
    for (int k = 0; k < cycles(0.2); ++k) cycle(0.0);
    const daemon::HttpAnswer answer = arm(*daemon);
    EXPECT_EQ(answer.status, 409);
    EXPECT_NE(answer.body.find(reason), std::string::npos) << answer.body;
    EXPECT_NE(daemon->said().find(reason), std::string::npos) << daemon->said();
    EXPECT_EQ(daemon->end(SIGTERM), 0);
  }

 private:
  /// The daemon, which has learned the program and is armed; null with a failure.
  std::unique_ptr<Process> armed(std::unique_ptr<CanBus> bus, const std::string& source,
                                 double cycle_s) {
    std::unique_ptr<Process> daemon = started(std::move(bus), source, cycle_s);
    if (daemon == nullptr) return nullptr;
    for (int k = 0; k < cycles(1.0); ++k) cycle(0.0);
    std::vector<double> path;
    for (int k = 0; k < cycles(kPath_s); ++k) path.push_back(path_at(k));
    learn_program(DdsNode({name_, 95, ""}), "part", path, cycle_s_);
    const daemon::HttpAnswer answer = arm(*daemon);
    EXPECT_EQ(answer.status, 200) << answer.body;
    for (int k = 0; k < cycles(0.2); ++k) cycle(0.0);
    return answer.status == 200 && !HasFailure() ? std::move(daemon) : nullptr;
  }
};

}  // namespace servotwin::test
