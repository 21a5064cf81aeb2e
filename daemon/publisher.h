// The publisher: takes predictions from the real-time loop to the network, and says how things are.
//
// A prediction goes out as soon as the loop has it; the status once a second; a model when it comes
// into force, a diagnosis when it is made. One worker thread; announce() any thread.
#pragma once

#include <cstdint>
#include <functional>
#include <mutex>
#include <stop_token>
#include <vector>

#include "daemon/ring.h"
#include "daemon/store.h"
#include "daemon/wake_up.h"
#include "daemon/web/live_feed.h"
#include "drivers/dds.h"

namespace servotwin {

class Publisher {
 public:
  using Status = std::function<MachineStatus()>;

  /// `cycle_s`: the deadline that is offered for predictions; `page`: who shows the same, or null.
  /// All arguments outlive the publisher.
  Publisher(const DdsNode& node, double cycle_s, Ring<MachinePrediction>& predictions,
            const WakeUp& wake_up, Status status, LiveFeed* page = nullptr);

  void run(const std::stop_token& stop);
  void announce(const StoredModel& model);
  void announce(const StoredDiagnosis& diagnosis);

 private:
  void send_predictions();
  void send_announcements();
  void send_status();

  DdsWriter<MachinePrediction> prediction_writer_;
  DdsWriter<ModelAnnouncement> model_writer_;
  DdsWriter<DiagnosisAnnouncement> diagnosis_writer_;
  DdsWriter<MachineStatus> status_writer_;
  Ring<MachinePrediction>& predictions_;
  const WakeUp& wake_up_;
  Status status_;
  LiveFeed* page_;
  MachinePrediction prediction_;
  std::int64_t last_status_ns_ = 0;
  std::uint64_t last_frames_ = 0;
  std::mutex mutex_;
  std::vector<ModelAnnouncement> waiting_;
  std::vector<DiagnosisAnnouncement> waiting_diagnoses_;
};

}  // namespace servotwin
