// Everything that works for one machine once its description is known: the rings between the
// threads, the workers, and the threads themselves. serve() opens what it needs and calls run();
// the picture of the threads is in daemon/README.md.
//
// Errors: the constructor throws std::runtime_error where the store or DDS fails; run() reports
// what fails while it runs as events.
#pragma once

#include <atomic>
#include <condition_variable>
#include <memory>
#include <mutex>
#include <optional>
#include <stop_token>
#include <string>
#include <vector>

#include "daemon/between/histogram.h"
#include "daemon/between/latest_value.h"
#include "daemon/between/offset_plan.h"
#include "daemon/between/ring.h"
#include "daemon/between/wake_up.h"
#include "daemon/config/config.h"
#include "daemon/correct/arming.h"
#include "daemon/correct/learning_worker.h"
#include "daemon/correct/program_inbox.h"
#include "daemon/diagnose/diagnosis_worker.h"
#include "daemon/identify/identification_worker.h"
#include "daemon/input/machine_input.h"
#include "daemon/input/offset_contract.h"
#include "daemon/loop/live_offsets.h"
#include "daemon/loop/real_time_loop.h"
#include "daemon/publish/publisher.h"
#include "daemon/record/motion_memory.h"
#include "daemon/record/recorder.h"
#include "daemon/record/residual_watch.h"
#include "daemon/service_manager.h"
#include "daemon/store/event_log.h"
#include "daemon/store/store.h"
#include "daemon/web/web_service.h"
#include "drivers/dds/dds.h"

namespace servotwin::daemon {

/// What is open before the machine is known. Everything here outlives the MachineService.
struct ServiceBase {
  const Config& config;  ///< as at the start: source, priorities and processors do not change
  Store& store;
  EventLog& events;
  const DdsNode& node;     ///< where predictions go
  const DdsNode& node_in;  ///< where frames come from, if they come over DDS
  WebService* web;         ///< null: no page
  Watchdog& watchdog;
  const std::stop_token& stop;
};

class MachineService {
 public:
  /// `input` outlives the service. `current`: the configuration now, which may be newer than
  /// `base.config`. The constructor starts no thread.
  MachineService(const ServiceBase& base, MachineInput& input, const Config& current);

  /// Starts the threads and returns when the source has ended or a stop is requested. Then ends
  /// them downstream, source first, so that nothing is left in a ring.
  void run();

  /// Takes over what a configuration may change while the service runs. Any thread.
  void reconfigure(const Config& current);

 private:
  [[nodiscard]] MachineStatus status();
  void run_loop();
  void fade_out();
  /// Why offsets cannot be armed while another daemon is active; empty: they can.
  [[nodiscard]] std::string standby_reason() const;
  void report_news(const std::stop_token& stop);

  const ServiceBase base_;
  FrameSource& source_;
  const MachineDescription& machine_;

  // What threads hand to each other.
  std::vector<LatestValue<TwinInForce>> models_;
  Ring<MachinePrediction> predictions_;
  Ring<CycleRow> rows_;
  Ring<DatedOffset> offsets_;
  OffsetHandOver hand_over_;
  WakeUp predicted_;
  Histogram published_;
  MotionMemory memory_;
  ResidualWatch watch_;

  // Who works. Two of them are too large for a stack.
  std::unique_ptr<RealTimeLoop> loop_;
  OffsetContract contract_;
  LearningRules rules_;
  std::unique_ptr<LiveOffsets> live_offsets_;
  Arming arming_;
  std::shared_ptr<ProgramInbox> inbox_;
  Recorder recorder_;
  std::unique_ptr<WebService::Shown> shown_;  // null: no page
  IdentificationWorker identification_;
  DiagnosisWorker diagnosis_;
  DdsReader<ProgramChunk> programs_;
  std::optional<DdsReader<ModelProposal>> proposals_;  // none where DDS Security forbids it
  DdsWriter<CorrectionChunk> corrections_;
  LearningWorker learner_;
  Publisher publisher_;

  // The publisher's thread alone, and run() after that thread has ended.
  std::vector<AxisStatus> axes_;
  std::string last_error_;

  std::atomic<bool> stop_loop_{false};
  std::mutex mutex_;  // of ended_
  std::condition_variable_any ended_changed_;
  bool ended_ = false;
};

}  // namespace servotwin::daemon
