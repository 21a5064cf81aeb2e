// The diagnosis worker: finds what the simulation of an axis gets wrong
// (diagnosis/search/diagnose.h), on a schedule and after a residual alarm.
//
//   every_s of machine time, or an alarm --> wait until the axis has moved for record_s since the
//   last diagnosis and at least half of that is in memory --> the most recent record_s of its
//   motion
//   --> diagnose(), and diagnose_torque() if there is a torque --> store, with the extended model
//   --> publisher; where causes are named, the extended model --> identification worker, which
//   judges it as a candidate
//
// The first diagnosis is due as soon as there is that much motion. Times are machine time and
// motion of the axis, not time of the worker. A diagnosis itself changes no model in force. Begin,
// result and failure are events with their reason.
//
// One worker thread at idle priority, one axis at a time. When the daemon is asked to stop, a
// running diagnosis is given up; when a replay has ended, it is finished. The constructor and
// restore() run before the thread, finish() after it.
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
#include "diagnosis/search/diagnose.h"
#include "diagnosis/torque/torque.h"

namespace servotwin::daemon {

class DiagnosisWorker {
 public:
  using Announce = std::function<void(const StoredDiagnosis&)>;
  /// Axis, extended model, what it contains ("with .."), and the times of the motion that it was
  /// fitted to.
  using Propose =
      std::function<void(std::size_t, const ModelRecord&, const std::string&, double, double)>;

  /// `identify`: gives the pole bounds and the maximum delay. `announce` is called with every
  /// diagnosis. All references must outlive the worker.
  DiagnosisWorker(const MachineDescription& machine, const DiagnoseConfig& config,
                  const IdentifyConfig& identify, const MotionMemory& memory, ResidualWatch& watch,
                  Store& store, EventLog& events, Announce announce);

  /// When `stop` is requested, a running diagnosis is given up. Call it before run().
  void give_up_with(const std::stop_token& stop) { give_up_ = stop; }
  /// Called with the model of every diagnosis that has extended it by a named cause, where that
  /// model can predict other motion than that of its recording. Call it before run().
  void propose_with(Propose propose) { propose_ = std::move(propose); }
  /// Announces the last stored diagnosis of every axis.
  void restore();
  void run(const std::stop_token& stop);
  /// The new configuration applies from the next diagnosis on. Any thread.
  void reconfigure(const DiagnoseConfig& config, const IdentifyConfig& identify);
  /// Checks one axis and diagnoses it if that is due; true if it was.
  bool look(std::size_t axis);
  /// To be called when no more motion will come: half of record_s is enough then.
  void finish(const std::stop_token& stop = {});

 private:
  struct Axis {
    std::string name;
    std::optional<std::string> alarm;   // not handled yet
    std::optional<double> diagnosed_s;  // the newest row at the last diagnosis
    double moved_s = 0.0;               // motion of the axis at the last diagnosis
  };

  void take_newer_config();
  bool look(std::size_t axis, double least_motion_s);
  void diagnose_now(std::size_t axis, const std::string& reason, double from_s, double until_s);
  /// Nothing if there is no torque, or too little (reported as an event).
  [[nodiscard]] std::optional<TorqueDiagnosis> torque_of(const SegmentedAxis& motion);
  void propose(std::size_t axis, const Diagnosis& diagnosis, double from_s, double until_s) const;
  void keep_report(const std::string& axis, const std::string& html);
  void keep(const StoredDiagnosis& diagnosis, const Event& event);

  DiagnoseConfig config_;
  DiagnoseOptions options_;
  std::stop_token give_up_;
  const MotionMemory& memory_;
  ResidualWatch& watch_;
  Store& store_;
  EventLog& events_;
  Announce announce_;
  Propose propose_;
  std::vector<Axis> axes_;
  std::mutex config_mutex_;
  std::optional<std::pair<DiagnoseConfig, IdentifyConfig>> newer_config_;
};

}  // namespace servotwin::daemon
