// A daemon that dies or stands still with offsets out: the real one as a process, a virtual drive
// on a bus of any kind. What the drive does is counted in cycles.
#pragma once

#include <gtest/gtest.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <fstream>
#include <memory>
#include <numbers>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "cli/live/virtual_drive.h"
#include "daemon/between/clock.h"
#include "daemon/store/store.h"
#include "drivers/can/can_bus.h"
#include "drivers/can/can_encoder.h"
#include "tests/daemon/http_client.h"
#include "tests/daemon/learned_program.h"
#include "tests/daemon/support.h"
#include "tests/support/process.h"

namespace servotwin::test {

class OffsetKill : public testing::Test {
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
  using Clock = std::chrono::steady_clock;
  static constexpr std::uint32_t kOffsetId = 0x401;
  static constexpr const char* kToken = "a token of the test";
  static constexpr const char* kAxis = R"(
[[axis]]
name = "X"
command = {id = 0x181, start_bit = 0, length = 32, unit = "nm*10"}
actual = {id = 0x181, start_bit = 32, length = 32, unit = "nm*10"}
target = {id = 0x301, start_bit = 0, length = 32, unit = "nm*10"}
offset = {id = 0x401, start_bit = 0, length = 32, unit = "nm*10", message_bytes = 4}
)";
  static constexpr double kPeak = 2e-4, kRate = 0.01;
  static constexpr double kSteps = 2.1e-8;  // two roundings of the bus, 10 nm each
  static constexpr double kPath_s = 4.6;
  static constexpr double kRamp_s = 0.1;  // the default of ilc.ramp_s

  [[nodiscard]] int cycles(double seconds) const {
    return static_cast<int>(std::lround(seconds / cycle_s_));
  }
  /// 20 mm there and back, twice, between dwells.
  [[nodiscard]] double path_at(int k) const {
    const double t = cycle_s_ * k - 0.3;
    return t < 0.0 || t > 4.0 ? 0.0 : 0.01 * (1.0 - std::cos(std::numbers::pi * t));
  }

  /// One cycle of the controller, the drive and the bus; the drive receives what the daemon has
  /// sent.
  void cycle(double target) {
    const auto tell = [&](const CanFrame& frame) {
      for (const VirtualDrive::Answer& answer : drive_->on_frame(0, frame))
        out_.push_back(answer.frame);
    };
    std::array<CanFrame, 64> batch;
    for (std::size_t count = 1; count > 0;) {
      count = bus_->receive(batch, 0.0);
      for (std::size_t i = 0; i < count; ++i) {
        offsets_ += batch[i].id == kOffsetId ? 1 : 0;
        tell(batch[i]);
      }
    }
    ASSERT_TRUE(controller_->set(0, CanChannel::kTarget, target));
    out_ = {controller_->frame(map_.find(0, CanChannel::kTarget)->message), controller_->start()};
    for (const CanFrame& frame : std::vector<CanFrame>(out_)) tell(frame);
    bus_->send(out_);
    const MappedSignal* command = map_.find(0, CanChannel::kCommand);
    demand_ = decoded(command->signal, out_.back().data);
    const std::chrono::duration<double> period(cycle_s_);
    next_ = std::max(next_, Clock::now()) + std::chrono::duration_cast<Clock::duration>(period);
    std::this_thread::sleep_until(next_);
  }
  /// The daemon on this bus, with a model in force.
  std::unique_ptr<Process> started(std::unique_ptr<CanBus> bus, const std::string& source,
                                   double cycle_s) {
    bus_ = std::move(bus);
    cycle_s_ = cycle_s;
    const std::string map = "cycle_s = " + std::to_string(cycle_s) + kAxis + timeout_ + "\n";
    std::ofstream(directory_.path() / "map.toml") << map;
    map_ = check_can_map(map, "map.toml", "").map;
    Model model = daemon::drive();
    model.sample_time_s = cycle_s;
    controller_.emplace(map_);
    drive_.emplace(map_, std::vector<Twin>{Twin(model)});
    std::ofstream(directory_.path() / "m.toml")
        << "[machine]\nname = \"" << name_
        << "\"\n[[axis]]\nname = \"X\"\ncorrection = { peak = " << kPeak << ", rate = " << kRate
        << ", bandwidth = 20 }\n"
        << "[dds]\ndomain = 95\n"
        << source
        << "\n"
        // A busy host may answer some cycles late: then the command is off by some of the offset.
        << "[ilc]\nlive = true\nmatch_tolerance = 4e-4\n"
        // The model stays as it is.
        << "[identify]\nwindow_s = 120\nmemory_s = 120\n"
        << "[diagnose]\nevery_s = 0\nfalse_alarm_days = 0\n"
        << "[http]\nlisten = \"127.0.0.1:0\"\ntoken = \"" << kToken << "\"\n";
    {
      daemon::Store store(directory_.path() / "store", name_);
      ModelRecord record = daemon::record_of(model);
      record.created = daemon::iso_time(daemon::wall_ns());
      store.promote(record, {record.created, "X", "model_promoted", "made for this test", ""});
    }
    auto daemon = std::make_unique<Process>(
        std::vector<std::string>{built("servotwind"), "--config", directory_.path() / "m.toml",
                                 "--store", directory_.path() / "store"});
    for (const char* line : {"page at http://127.0.0.1:", "X: model 1 is in force again"}) {
      if (daemon->says(line)) continue;
      ADD_FAILURE() << daemon->said();
      return nullptr;
    }
    return daemon;
  }
  daemon::HttpAnswer arm(Process& daemon) {
    const std::string at = "page at http://127.0.0.1:";
    const auto port = static_cast<std::uint16_t>(
        std::stoi(daemon.said().substr(daemon.said().find(at) + at.size())));
    return daemon::ask(port, "POST", "/api/v1/offsets/arm",
                       std::string("Authorization: Bearer ") + kToken + "\r\n");
  }
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
  /// Runs the program until part of the correction has been active for a while; `k` is its next
  /// cycle. A host that held the bus up in the middle of a run has another one.
  void run_until_it_corrects(Process& daemon, int& k) {
    constexpr int kMostRuns = 24;  // where other work holds a guest up, none is answered in time
    int runs = 0;
    k = 0;
    for (int out = 0; out < cycles(0.2); ++k) {
      if (k == cycles(kPath_s - 0.4)) {
        ASSERT_LT(++runs, kMostRuns) << "no offset came\n" << daemon.said();
        for (k = 0; k < cycles(1.0); ++k) cycle(0.0);
        out = k = 0;
      }
      cycle(path_at(k));
      out = std::abs(added(path_at(k))) > 0.25 * kPeak ? out + 1 : 0;
    }
  }
  /// Change of an offset in a cycle while the drive ramps it out.
  [[nodiscard]] double ramp_step() const { return kPeak / cycles(VirtualDrive::kOffsetRamp_s); }
  /// What the drive adds to its target.
  [[nodiscard]] double added(double target) const { return demand_ - target; }

  std::string timeout_ = "offset_timeout_s = 0.02";  // of the virtual drive
  TemporaryDirectory directory_;
  std::string name_ = "kill-" + std::to_string(getpid());
  std::unique_ptr<CanBus> bus_;
  double cycle_s_ = 0.0;
  CanMap map_;
  std::optional<CanEncoder> controller_;
  std::optional<VirtualDrive> drive_;
  Clock::time_point next_ = Clock::now();
  std::vector<CanFrame> out_;
  double demand_ = 0.0;
  long offsets_ = 0;  // frames with an offset that came
};

}  // namespace servotwin::test
