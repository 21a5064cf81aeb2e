// What a daemon publishes over DDS, for tests of the programs that pass it on.
#pragma once

#include <unistd.h>

#include <atomic>
#include <chrono>
#include <string>
#include <thread>

#include "drivers/dds/dds.h"

namespace servotwin::test {

/// A machine and a domain of this test alone; `machine`: its beginning.
inline DdsPlace place_of_test(const std::string& machine) {
  const auto id = static_cast<std::uint32_t>(::getpid());
  return {machine + "-" + std::to_string(id), 1 + id % 200, ""};
}

/// Two axes: X with a model, an alarm and a diagnosis, and the rotary B/1, or `second`. Status and
/// predictions come ten times a second, so that a test does not wait.
class FakeDaemon {
 public:
  explicit FakeDaemon(const DdsPlace& place, const std::string& reason = "better",
                      const std::string& second = "B/1")
      : node_(place), statuses_(node_), models_(node_), diagnoses_(node_), predictions_(node_) {
    models_.write({"X", 3, 2, "2026-11-27T08:00:00Z", reason, R"({"schema":"servotwin.model/1"})"});
    diagnoses_.write(
        {"X", R"({"schema":"servotwin.diagnosis/1","verdict":"explained","causes":[]})"});
    sending_ = std::jthread([this, second](const std::stop_token& stop) {
      MachineStatus status;
      status.state = DaemonState::kRunning;
      status.axes = {{"X", 3, 1.5e-6, "collecting"}, {second, 0, kAbsent, ""}};
      status.axes[1].rotary = true;
      MachinePrediction cycle;
      cycle.axis_count = 2;
      cycle.axes[0] = {3e-4, 1.5e-6, 3.02e-4, 2e-6, 3, AxisState::kPredicting};
      cycle.axes[1].measured_error = -0.001;
      while (!stop.stop_requested()) {
        ++status.frames;
        ++cycle.sequence;
        status.axes[0].alarm = alarm;
        statuses_.write(status);
        predictions_.write(cycle);
        std::this_thread::sleep_for(std::chrono::milliseconds(100));
      }
    });
  }

  std::atomic<AlarmState> alarm = AlarmState::kRaised;  ///< of X

 private:
  DdsNode node_;
  DdsWriter<MachineStatus> statuses_;
  DdsWriter<ModelAnnouncement> models_;
  DdsWriter<DiagnosisAnnouncement> diagnoses_;
  DdsWriter<MachinePrediction> predictions_;
  std::jthread sending_;
};

}  // namespace servotwin::test
