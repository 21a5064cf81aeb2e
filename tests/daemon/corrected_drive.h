// A machine on a bus of any kind with one virtual drive, and the real daemon as a process that
// corrects it. What the drive does is counted in cycles.
#pragma once

#include <gtest/gtest.h>
#include <signal.h>
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
#include "tests/daemon/support.h"
#include "tests/support/process.h"

namespace servotwin::test {

class CorrectedDrive : public testing::Test {
 protected:
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
    actual_ = decoded(map_.find(0, CanChannel::kActual)->signal, out_.back().data);
    const std::chrono::duration<double> period(cycle_s_);
    // A controller keeps its cycle; a test that counts answers waits for a host that was late.
    constexpr std::chrono::milliseconds kLongPause(100);
    const auto now = Clock::now();
    if (!keeps_cycle_ || next_ + kLongPause < now) next_ = std::max(next_, now);
    next_ += std::chrono::duration_cast<Clock::duration>(period);
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
    drive_.emplace(map_, std::vector<daemon::TwinInForce>{{Twin(model)}});
    std::ofstream(directory_.path() / "m.toml")
        << "[machine]\nname = \"" << name_
        << "\"\n[[axis]]\nname = \"X\"\ncorrection = { peak = " << peak_ << ", rate = " << kRate
        << ", bandwidth = 20 }\n"
        << "[dds]\ndomain = 95\n"
        << source
        << "\n"
        // A busy host may answer some cycles late: then the command is off by some of the offset.
        << "[ilc]\nlive = true\nmatch_tolerance = 4e-4\n"
        << ilc_
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
  /// Asks the daemon for a change, with its token.
  daemon::HttpAnswer ask(Process& daemon, const std::string& method, const std::string& target,
                         const std::string& body = "") {
    const std::string at = "page at http://127.0.0.1:";
    const auto port = static_cast<std::uint16_t>(
        std::stoi(daemon.said().substr(daemon.said().find(at) + at.size())));
    return daemon::ask(port, method, target,
                       std::string("Authorization: Bearer ") + kToken + "\r\n", body);
  }
  daemon::HttpAnswer arm(Process& daemon) { return ask(daemon, "POST", "/api/v1/offsets/arm"); }
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
  bool keeps_cycle_ = false;
  double peak_ = kPeak;  // of the correction [m]
  std::string ilc_;      // more of the section [ilc]
  TemporaryDirectory directory_;
  std::string name_ = "kill-" + std::to_string(getpid());
  std::unique_ptr<CanBus> bus_;
  double cycle_s_ = 0.0;
  CanMap map_;
  std::optional<CanEncoder> controller_;
  std::optional<VirtualDrive> drive_;
  Clock::time_point next_ = Clock::now();
  std::vector<CanFrame> out_;
  double demand_ = 0.0, actual_ = 0.0;  // of the drive, in the last cycle [m]
  long offsets_ = 0;                    // frames with an offset that came
};

}  // namespace servotwin::test
