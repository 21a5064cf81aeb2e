// The identification worker: fits a model to every axis, compares it with the model in force on
// held-out motion, and puts it in force if it is better.
//
//   window_s of new motion --> sort it by evidence class (identification/recording/evidence.h) -->
//   one step:
//     new fast motion, or no model in force   fit loop and friction to the stored evidence
//     new slow reversals only                 fit friction, starting from the model in force
//     neither                                 none
//   --> candidate --> judge_s of held-out motion, to which neither the candidate nor the model in
//   force was fitted --> daemon/identify/promotion.h --> store --> in force
//
//   a model that a diagnosis has extended by what it found, or that a person proposes (propose()),
//   is a candidate like any other: judged on judge_s of motion after it was proposed
//
//   window_s of standstill --> measures the noise floor of the model in force, without a fit
//
// Steps are counted in motion of the axis, not in time of the worker: a worker that lags behind
// gives the same models, as long as the motion is still in memory. Evidence is kept longer
// (daemon/identify/evidence_memory.h), but not over a restart. A model is in force only when it is
// on the disk. Every step and every decision is an event with its reason.
//
// One worker thread at idle priority; the constructor and restore() before it starts; update() and
// propose() any thread.
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

  /// `in_force`: hands the models to the loop, one entry per axis. `announce` is called with every
  /// model that comes into force. All references must outlive the worker.
  IdentificationWorker(const MachineDescription& machine, const IdentifyConfig& config,
                       const MotionMemory& memory, Store& store, EventLog& events,
                       std::span<LatestValue<TwinInForce>> in_force, Announce announce);

  /// Sets the function that names the recordings of a time span; a model is stored with the
  /// recordings that it was fitted to and judged on. Call it before run().
  void cite_with(std::function<std::vector<std::string>(double from_s, double until_s)> files) {
    files_with_ = std::move(files);
  }
  /// When `stop` is requested, a running identification is given up. Call it before run().
  void give_up_with(const std::stop_token& stop) { give_up_ = stop; }
  /// Puts the stored models in force. Throws std::runtime_error if one of them cannot be read.
  void restore();
  void run(const std::stop_token& stop);
  /// The new configuration applies from the next step on. Any thread.
  void reconfigure(const IdentifyConfig& config);
  /// A model from elsewhere as the next candidate of an axis. `because` names what it contains, for
  /// the reason of its promotion or refusal; it was fitted to motion of these times. A later one
  /// replaces one that is not a candidate yet. Any thread.
  void propose(std::size_t axis, ModelRecord record, const std::string& because, double from_s,
               double until_s);
  /// The same of a person, who comes before a diagnosis; or in force without being judged, if the
  /// proposal says so. A model that cannot be used is a refused candidate. Any thread.
  void propose(const ModelProposal& given);
  /// Checks one axis and does what is due; true if something was.
  bool look(std::size_t axis);
  /// To be called when no more motion will come: processes the rest and reports undecided
  /// candidates.
  void finish();
  /// Updates `status`, unless the worker is just writing it: callers must not wait for a thread at
  /// idle priority.
  void update(std::vector<AxisStatus>& status) const;

 private:
  /// Who made a model.
  enum class Origin : std::uint8_t { kDiagnosis, kPerson, kForced };
  struct Pending {
    Identified identified;
    std::vector<std::string> recordings;  // that it was fitted to
    double until_s = 0.0;                 // end of the data that it was fitted to
    double moved_s = 0.0;                 // motion of the axis until then
    std::string because = {};             // of a proposal
    double from_s = 0.0;                  // of a diagnosis: begin of the data it was fitted to
    Origin origin = Origin::kDiagnosis;   // of a proposal
  };
  /// The axis that is being identified, for which the others wait.
  struct Identifying {
    std::size_t axis = 0;
    std::int64_t since_ns = 0;  // steady clock
  };
  struct Axis {
    std::string name;
    bool rotary = false;
    std::optional<StoredModel> in_force;
    std::optional<Pending> candidate;
    double moved_s = 0.0;   // motion until the end of the last window
    double sorted_s = 0.0;  // the motion has been sorted until this time
    EvidenceMemory evidence;
    EvidenceSeconds fresh;  // new evidence since the last step
    std::string last_step;  // for people
    std::string beside;     // the axis whose acceleration is sought in the error; empty: none
  };

  void take_newer_config();
  void take_proposal(std::size_t axis);
  /// Makes it the candidate, or refuses it at once if it must not be used.
  void consider(std::size_t axis, Pending candidate);
  void cite(Pending& candidate, double from_s, double until_s) const;
  /// The motion until then that is still in memory, with the command of another axis beside it.
  [[nodiscard]] SegmentedAxis remembered(std::size_t axis, double until_s,
                                         const std::string& beside) const;
  /// Of several other axes, chooses the one whose acceleration is sought: by what the model in
  /// force leaves without its coupling. Another one than before has new evidence only, because all
  /// evidence is fitted together. A model that comes into force with a coupling chooses its own.
  void choose_beside(std::size_t axis, double until_s);
  void seek_beside(std::size_t axis, const std::string& other);
  SegmentedAxis sort(std::size_t axis, double until_s);
  void step(std::size_t axis, double until_s);
  void seek(std::size_t axis, double until_s, const SegmentedAxis& motion,
            const IdentifyOptions& options);
  /// Nothing where none was found or the daemon stops; an event says so.
  [[nodiscard]] std::optional<Identified> identified(std::size_t axis, const SegmentedAxis& motion,
                                                     const IdentifyOptions& options);
  void renew_noise_floor(std::size_t axis, double until_s);
  void judge_candidate(std::size_t axis, double until_s);
  void rule(std::size_t axis, const Pending& candidate, const Candidacy& candidacy);
  void promote(std::size_t axis, const Pending& candidate, const std::string& reason);
  /// Stores that the model in force is still valid, if it is.
  void validate(std::size_t axis, const Candidacy& candidacy);
  void put_in_force(std::size_t axis, const StoredModel& model);
  void set_activity(std::size_t axis, const std::string& activity);
  void set_identifying(std::optional<Identifying> now);
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
  std::stop_token give_up_;
  std::mutex config_mutex_;
  std::optional<IdentifyConfig> newer_config_;
  std::mutex proposal_mutex_;
  std::vector<std::optional<Pending>> proposals_;  // one entry per axis
  mutable std::mutex status_mutex_;
  std::vector<AxisStatus> status_;
  std::optional<Identifying> identifying_;
};

}  // namespace servotwin::daemon
