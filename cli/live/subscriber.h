// Receives over DDS everything that is published about one machine. One thread. Errors:
// std::runtime_error (drivers/dds/dds.h).
#pragma once

#include <functional>

#include "cli/common/live_record.h"
#include "drivers/dds/dds.h"

namespace servotwin::cli {

/// A daemon that was waiting publishes through another writer once its machine is there: only one
/// that is away for this long [s] has stopped.
inline constexpr double kGone_s = 2.0;

class Subscriber {
 public:
  explicit Subscriber(const DdsPlace& place)
      : node_(place),
        predictions_(node_),
        frames_(node_),
        models_(node_),
        diagnoses_(node_),
        statuses_(node_) {}

  /// Called by receive() with what it receives, after the record has it.
  std::function<void(const MachinePrediction&)> on_prediction = [](const MachinePrediction&) {};
  std::function<void(const MachineStatus&)> on_status = [](const MachineStatus&) {};
  std::function<void(const ModelAnnouncement&)> on_model = [](const ModelAnnouncement&) {};
  std::function<void(const DiagnosisAnnouncement&)> on_diagnosis =
      [](const DiagnosisAnnouncement&) {};

  /// Waits up to 20 ms for a prediction, so that the readers' queues of 64 messages do not overflow
  /// at 1 kHz; frames before their predictions. True if at least one prediction was received.
  bool receive(LiveRecord& record);
  [[nodiscard]] const DdsNode& node() const { return node_; }
  /// Whether nothing more will be received: the daemon has stopped, or the machine that it listened
  /// to. A daemon that replays recordings itself has no machine on the bus and stops at their end.
  [[nodiscard]] bool over() const {
    return !daemon_there() || (machine_ != 0 && !frames_.matched(machine_));
  }
  /// Any writer of predictions is not enough: topics are shared by all machines of a domain.
  [[nodiscard]] bool daemon_there() const {
    return (daemon_ != 0 && statuses_.matched(daemon_)) ||
           (predicts_ != 0 && predictions_.matched(predicts_));
  }

 private:
  void take_frames(LiveRecord& record);

  DdsNode node_;
  DdsReader<MachinePrediction> predictions_;
  DdsReader<MachineFrame> frames_;
  DdsReader<ModelAnnouncement> models_;
  DdsReader<DiagnosisAnnouncement> diagnoses_;
  DdsReader<MachineStatus> statuses_;
  MachinePrediction prediction_;
  MachineFrame frame_;
  ModelAnnouncement model_;
  DiagnosisAnnouncement diagnosis_;
  MachineStatus status_;
  // Writers of the last messages; 0: none yet.
  dds_instance_handle_t daemon_ = 0, predicts_ = 0, machine_ = 0;
};

}  // namespace servotwin::cli
