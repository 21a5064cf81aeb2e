// The identification worker: seeks a model for every axis, judges it, and puts it in force if it is
// better.
//
//   window_s of new motion --> sort it by what it shows (identification/recording/evidence.h) -->
//   one step:
//     fast motion, or no model in force   loop and friction on the evidence that is kept
//     slow reversals and nothing faster   friction, starting from the model in force
//     neither                             none
//   --> candidate --> judge_s of motion that neither the candidate nor the model in force has seen
//   --> daemon/identify/promotion.h --> store --> in force
//
//   window_s of standing --> the noise floor of the model in force, and no search
//
// All of this is counted in motion of the machine, not in time of the worker: a worker that lags
// does the same as one that does not, as long as the motion is remembered. Evidence is kept for
// longer than that (daemon/identify/evidence_memory.h), but not over a restart. A model is in force
// only when it is on the disk. Every step and every decision is an event with its reason.
//
// One worker thread at idle priority; the constructor and restore() before it starts; update() any
// thread.
#pragma once

#include <functional>
#include <mutex>
#include <optional>
#include <span>
#include <stop_token>
#include <string>
#include <vector>

#include "daemon/between/latest_value.h"
#include "daemon/config/config.h"
#include "daemon/identify/evidence_memory.h"
#include "daemon/identify/promotion.h"
#include "daemon/loop/real_time_loop.h"
#include "daemon/record/motion_memory.h"
#include "daemon/store/event_log.h"
#include "daemon/store/store.h"
#include "identification/recording/segments.h"

namespace servotwin::daemon {

class IdentificationWorker {
 public:
  using Announce = std::function<void(const StoredModel&)>;

  /// `in_force`: one per axis, to the loop. `announce` is called with every model that comes into
  /// force.
  IdentificationWorker(const MachineDescription& machine, const IdentifyConfig& config,
                       const MotionMemory& memory, Store& store, EventLog& events,
                       std::span<LatestValue<TwinInForce>> in_force, Announce announce);

  /// Asks this for the recordings of a time, to be stored with a model as what it was found and
  /// judged on. Before the thread.
  void cite_with(std::function<std::vector<std::string>(double from_s, double until_s)> files) {
    files_with_ = std::move(files);
  }
  /// Puts the models of the store in force. Throws std::runtime_error if one of them cannot be
  /// read.
  void restore();
  void run(const std::stop_token& stop);
  /// From the next look on; the step that runs ends as it began. Any thread.
  void reconfigure(const IdentifyConfig& config);
  /// One look at one axis; true if there was something to do.
  bool look(std::size_t axis);
  /// No more motion will come: works off what is there, and says what stays undecided.
  void finish();
  /// Brings `status` up to date, unless the worker is writing it just now: nobody waits for a
  /// thread at idle priority.
  void update(std::vector<AxisStatus>& status) const;

 private:
  struct Pending {
    Identified identified;
    std::vector<std::string> recordings;  // that it was found on
    double until_s = 0.0;                 // the newest data that it has seen
    double moved_s = 0.0;                 // of the axis by then
  };
  struct Axis {
    std::string name;
    bool rotary = false;
    std::optional<StoredModel> in_force;
    std::optional<Pending> candidate;
    double moved_s = 0.0;   // by the end of the last window
    double sorted_s = 0.0;  // until here the motion has been sorted
    EvidenceMemory evidence;
    EvidenceSeconds fresh;  // sorted since the last step
    std::string last_step;  // for people
  };

  void take_newer_config();
  void cite(Pending& candidate, double from_s, double until_s) const;
  SegmentedAxis sort(std::size_t axis, double until_s);
  void step(std::size_t axis, double until_s);
  void seek(std::size_t axis, double until_s, const SegmentedAxis& motion,
            const IdentifyOptions& options);
  void renew_noise_floor(std::size_t axis, double until_s);
  void judge_candidate(std::size_t axis, double until_s);
  void rule(std::size_t axis, const Pending& candidate, const Candidacy& candidacy);
  /// Keeps that the model in force still holds, if it does.
  void validate(std::size_t axis, const Candidacy& candidacy);
  void put_in_force(std::size_t axis, const StoredModel& model);
  void say(std::size_t axis, const std::string& activity);
  void note_refusal(std::size_t axis, const std::string& why, const std::string& detail = "");

  MachineDescription machine_;
  IdentifyConfig config_;
  const MotionMemory& memory_;
  Store& store_;
  EventLog& events_;
  std::span<LatestValue<TwinInForce>> in_force_;
  Announce announce_;
  std::function<std::vector<std::string>(double, double)> files_with_;
  std::vector<Axis> axes_;
  std::mutex config_mutex_;
  std::optional<IdentifyConfig> newer_config_;
  mutable std::mutex status_mutex_;
  std::vector<AxisStatus> status_;
};

}  // namespace servotwin::daemon
