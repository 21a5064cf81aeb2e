// The publisher: takes predictions from the real-time loop to the network, and says how things are.
//
// A prediction and live offsets go out as soon as the loop has them; the status once a second; a
// model when it comes into force, a diagnosis when it is made. Where there is another daemon of
// this machine the stronger one is heard; a daemon that takes over says its models and diagnoses
// again, because readers have dropped what it said before. One worker thread, which may be a
// real-time one: it waits for the network and for nothing else. announce() any thread.
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
#include "daemon/between/ring.h"
#include "daemon/between/wake_up.h"
#include "daemon/publish/live_feed.h"
#include "daemon/store/store.h"
#include "drivers/dds.h"

namespace servotwin::daemon {

class Publisher {
 public:
  using Status = std::function<MachineStatus()>;

  /// `cycle_s`: the deadline that is offered for predictions; `published`: how long after its frame
  /// each was handed to the network; `page`: who shows the same, or null.
  /// All arguments outlive the publisher.
  Publisher(const DdsNode& node, double cycle_s, Ring<MachinePrediction>& predictions,
            Ring<MachineOffset>& offsets, const WakeUp& wake_up, Histogram& published,
            Status status, LiveFeed* page = nullptr);

  void run(const std::stop_token& stop);
  void announce(const StoredModel& model);
  void announce(const StoredDiagnosis& diagnosis);
  /// That another daemon is heard since the last call, or this one again: one line each, for
  /// people. Any one thread; what is done with them is no business of the worker.
  [[nodiscard]] std::vector<std::string> news();

 private:
  void send_offsets();
  void send_predictions();
  void send_announcements();
  void send_status();
  void look_who_is_heard();
  void say_again();

  DdsWriter<MachinePrediction> prediction_writer_;
  DdsWriter<MachineOffset> offset_writer_;
  DdsWriter<ModelAnnouncement> model_writer_;
  DdsWriter<DiagnosisAnnouncement> diagnosis_writer_;
  DdsWriter<MachineStatus> status_writer_;
  DdsReader<MachineStatus> heard_;
  Ring<MachinePrediction>& predictions_;
  Ring<MachineOffset>& offsets_;
  const WakeUp& wake_up_;
  Histogram& published_;
  Status status_;
  LiveFeed* page_;
  MachinePrediction prediction_;
  MachineOffset offset_;
  std::int64_t last_status_ns_ = 0;
  std::uint64_t last_frames_ = 0;
  std::mutex mutex_;
  std::vector<ModelAnnouncement> waiting_;
  std::vector<DiagnosisAnnouncement> waiting_diagnoses_;
  std::map<std::string, ModelAnnouncement> models_;  // the last one of every axis
  std::map<std::string, DiagnosisAnnouncement> diagnoses_;
  std::optional<bool> speaks_;  // this daemon is the one that is heard
  int says_again_ = 0;          // so many times more
  Ring<bool> turns_{16};        // this daemon began (true) or ceased to be heard; for news()
};

}  // namespace servotwin::daemon
