// The publisher: sends predictions, offsets, models, diagnoses and the status to the network.
//
// Predictions and live offsets are sent as soon as the loop has them, the status once a second, a
// model when it comes into force, a diagnosis when it is made. Of several daemons of a machine,
// readers get the data of the strongest; a daemon that takes over sends its models and diagnoses
// again, because readers have dropped what it sent before; while it is in standby, offsets of live
// runs do not leave (daemon/publish/offset_outlet.h). One worker thread, which may be a
// real-time thread: it waits for the network and for nothing else. announce(): any thread. Errors:
// the constructor throws std::runtime_error (drivers/dds/dds.h).
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <mutex>
#include <optional>
#include <stop_token>
#include <string>
#include <vector>

#include "daemon/between/histogram.h"
#include "daemon/between/offset_plan.h"
#include "daemon/between/ring.h"
#include "daemon/between/wake_up.h"
#include "daemon/publish/live_feed.h"
#include "daemon/publish/offset_outlet.h"
#include "daemon/store/store.h"
#include "drivers/dds/dds.h"

namespace servotwin::daemon {

class Publisher {
 public:
  using Status = std::function<MachineStatus()>;

  /// `cycle_s`: deadline offered for predictions. `published`: gets the time from every frame until
  /// its prediction was handed to DDS. `status`: gives the status to send. `page`: gets the same
  /// data; may be null. All references must outlive the publisher.
  Publisher(const DdsNode& node, double cycle_s, Ring<MachinePrediction>& predictions,
            Ring<DatedOffset>& offsets, OffsetHandOver& hand_over, const WakeUp& wake_up,
            Histogram& published, Status status, LiveFeed* page = nullptr);

  void run(const std::stop_token& stop);
  void announce(const StoredModel& model);
  void announce(const StoredDiagnosis& diagnosis);
  /// Changes between active and standby since the last call, one line each. Always the same thread.
  [[nodiscard]] std::vector<std::string> news();

 private:
  void send_offsets();
  void send_predictions();
  void send_announcements();
  void send_status();
  void find_active_daemon();
  void repeat_announcements();

  DdsWriter<MachinePrediction> prediction_writer_;
  DdsWriter<MachineOffset> offset_writer_;
  DdsWriter<ModelAnnouncement> model_writer_;
  DdsWriter<DiagnosisAnnouncement> diagnosis_writer_;
  DdsWriter<MachineStatus> status_writer_;
  DdsReader<MachineStatus> status_reader_;
  Ring<MachinePrediction>& predictions_;
  OffsetOutlet offsets_;
  OffsetHandOver& hand_over_;
  const WakeUp& wake_up_;
  Histogram& published_;
  Status status_;
  LiveFeed* page_;
  MachinePrediction prediction_;
  std::int64_t last_status_ns_ = 0;
  std::uint64_t last_frames_ = 0;
  std::mutex mutex_;
  std::vector<ModelAnnouncement> waiting_;
  std::vector<DiagnosisAnnouncement> waiting_diagnoses_;
  std::map<std::string, ModelAnnouncement> models_;  // last announcement of every axis
  std::map<std::string, DiagnosisAnnouncement> diagnoses_;
  std::optional<bool> active_;  // this daemon is the active one
  int repeats_left_ = 0;        // remaining repetitions after a takeover
  Ring<bool> changes_{16};      // this daemon became active (true) or standby; for news()
};

}  // namespace servotwin::daemon
