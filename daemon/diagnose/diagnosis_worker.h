// The diagnosis worker: says what the simulation of every axis gets wrong (diagnosis/diagnose.h),
// on a schedule and when the residual alarm is raised.
//
//   every_s of the machine's time, or an alarm --> the axis has moved for record_s since the last
//   diagnosis, and half of that is remembered --> the most recent record_s of its motion
//   --> diagnose(), and diagnose_torque() where there is a torque --> store, with the extended
//   model --> publisher
//
// The first diagnosis is due as soon as there is that much motion. All of this is counted in the
// machine's time and motion, not in time of the worker. A diagnosis changes no model in force: it
// is for people. Begun, finished, failed: every one is an event with its reason.
//
// One worker thread at idle priority, one axis at a time. When the daemon is asked to stop, a
// diagnosis that runs is given up before its next fit; where the motion has ended it is finished.
// The constructor and restore() before the thread, finish() after it.
#pragma once

#include <functional>
#include <mutex>
#include <optional>
#include <stop_token>
#include <string>
#include <utility>
#include <vector>

#include "daemon/config/config.h"
#include "daemon/record/motion_memory.h"
#include "daemon/record/residual_watch.h"
#include "daemon/store/event_log.h"
#include "daemon/store/store.h"
#include "diagnosis/diagnose.h"
#include "diagnosis/torque.h"

namespace servotwin::daemon {

class DiagnosisWorker {
 public:
  using Announce = std::function<void(const StoredDiagnosis&)>;

  /// `identify`: the poles' box and the longest delay are those of the identification. `announce`
  /// is called with every diagnosis. All arguments outlive the worker.
  DiagnosisWorker(const MachineDescription& machine, const DiagnoseConfig& config,
                  const IdentifyConfig& identify, const MotionMemory& memory, ResidualWatch& watch,
                  Store& store, EventLog& events, Announce announce);

  /// When this stops, a diagnosis that runs is given up before its next fit. Before the thread.
  void give_up_with(const std::stop_token& stop) { options_.stop = stop; }
  /// Announces the last diagnosis of every axis that is in the store.
  void restore();
  void run(const std::stop_token& stop);
  /// From the next diagnosis on. Any thread.
  void reconfigure(const DiagnoseConfig& config, const IdentifyConfig& identify);
  /// One look at one axis; true if it was diagnosed.
  bool look(std::size_t axis);
  /// No more motion will come: diagnoses what is due with half of the motion, too.
  void finish(const std::stop_token& stop = {});

 private:
  struct Axis {
    std::string name;
    std::optional<std::string> alarm;   // not worked off yet
    std::optional<double> diagnosed_s;  // the newest row at the last diagnosis
    double moved_s = 0.0;               // of the axis by then
  };

  void take_newer_config();
  bool look(std::size_t axis, double least_motion_s);
  void diagnose_now(std::size_t axis, const std::string& reason, double from_s, double until_s);
  /// Nothing where there is no torque, or too little of it, which is noted.
  [[nodiscard]] std::optional<TorqueDiagnosis> torque_of(const SegmentedAxis& motion);
  void keep_report(const std::string& axis, const std::string& html);
  void keep(const StoredDiagnosis& diagnosis, const Event& event);

  DiagnoseConfig config_;
  DiagnoseOptions options_;
  const MotionMemory& memory_;
  ResidualWatch& watch_;
  Store& store_;
  EventLog& events_;
  Announce announce_;
  std::vector<Axis> axes_;
  std::mutex config_mutex_;
  std::optional<std::pair<DiagnoseConfig, IdentifyConfig>> newer_config_;
};

}  // namespace servotwin::daemon
