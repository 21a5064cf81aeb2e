// The learning worker: receives commanded programs from the network or from a folder, learns their
// corrections with the models in force, and publishes the results.
//
//   chunks --> complete and checked program (daemon/correct/program_assembly.h) --> virtual trials
//   on the twins (daemon/correct/learned_program.h) --> correction on the network, event with its
//   figures in the store --> plan for the real-time loop (daemon/loop/live_offsets.h), which
//   reports every run
//   --> kept, learned again or withdrawn (daemon/correct/correction_rule.h); the gain is an event
//
// It also hears the commands of the machine and recognises programs that repeat in them
// (daemon/correct/repeating_motion.h); each is offered in the list of programs, or put into the
// folder at once, as ilc.recognise says.
//
// Nothing is learned without a request; a file in the folder is one for as long as it is there, so
// what could not be learned is tried again when other models are in force. Every result (learned,
// previewed, refused, used, withdrawn) is an event with its reason; a refusal is also the last
// error of the status. The kMaxKept newest corrections are kept until the daemon stops; after a
// restart they are learned from the programs that their sender still publishes.
//
// One worker thread at idle priority. When the daemon is asked to stop, learning is aborted before
// the next trial.
#pragma once

#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <stop_token>
#include <string>
#include <vector>

#include "daemon/between/offset_plan.h"
#include "daemon/correct/correction_rule.h"
#include "daemon/correct/learned_program.h"
#include "daemon/correct/motion_watch.h"
#include "daemon/correct/program_assembly.h"
#include "daemon/correct/program_folder.h"
#include "daemon/correct/program_inbox.h"
#include "daemon/correct/program_list.h"
#include "daemon/loop/program_matcher.h"
#include "daemon/store/event_log.h"
#include "daemon/store/store.h"
#include "drivers/dds/dds.h"

namespace servotwin::daemon {

class LearningWorker {
 public:
  static constexpr std::size_t kMaxKept = ProgramMatcher::kMaxPrograms;
  static constexpr std::int64_t kRenewEvery_ns = 600'000'000'000;
  static constexpr std::int64_t kLookEvery_ns = 1'000'000'000;
  using Announce = std::function<void(const CorrectionChunk&)>;
  using Hear = std::function<Recording(double after_s)>;
  using Accept = std::function<ProgramInbox::Outcome(const std::string& program)>;

  /// All arguments outlive the worker.
  LearningWorker(LearningRules rules, Store& store, EventLog& events, OffsetHandOver& hand_over,
                 Announce announce);

  /// When `stop` is requested, learning is aborted before the next trial. Call it before run().
  void give_up_with(const std::stop_token& stop) { give_up_ = stop; }
  /// The list in which the programs of the folder and all corrections are shown. Call it before
  /// run(); the list outlives the worker.
  void show_in(ProgramList& list) { list_ = &list; }
  /// `hear`: the rows of all axes after a time [s]. `accept`: puts a recognised program into the
  /// folder. Call it before run().
  void hear_with(Hear hear, Accept accept) {
    hear_ = std::move(hear);
    accept_ = std::move(accept);
  }
  void run(const std::stop_token& stop, DdsReader<ProgramChunk>& programs);
  /// Takes one chunk of a program. `now_ns`: any monotonic clock, here and below.
  void take(const ProgramChunk& chunk, std::int64_t now_ns);
  /// Takes what has changed in the folder of programs, if there is one; at most every
  /// kLookEvery_ns.
  void look_into_folder(std::int64_t now_ns);
  /// Looks for a repetition in what was commanded since the last call; at most every kLookEvery_ns.
  void look_for_repetition(std::int64_t now_ns);
  /// Refuses programs whose next chunk has not come in time.
  void refuse_overdue(std::int64_t now_ns);
  /// Judges the runs that the real-time loop has reported since the last call.
  void judge_runs();
  /// Updates the validation time of the corrections from that of their models, at most every
  /// kRenewEvery_ns.
  void renew(std::int64_t now_ns);
  /// Reports, after a person has armed the daemon, the corrections that are too old to be sent.
  void report_stale();
  /// Shows what has become of the programs. `learning`: the one that is being learned, if any.
  void show(const std::string& learning = "");
  /// The corrections that are kept; the newest is the last one.
  [[nodiscard]] const std::vector<std::shared_ptr<const LearnedProgram>>& kept() const noexcept {
    return kept_;
  }

 private:
  using Kept = std::shared_ptr<const LearnedProgram>;
  void learn_now(const CommandedPath& program);
  void judge(const OffsetRun& run);
  void gone(const std::string& program);
  /// Finds the programs of the folder again that have no correction, if other models are in force.
  void try_again();
  void learn_anew(const Kept& learned);
  void withdraw(const Kept& learned, const std::string& why);
  void refuse(const ProgramRefusal& refusal);
  void keep(Kept learned);
  void forget(const std::string& program);
  void hand_over_plan(bool renewed = false);
  /// The name of the program that is this motion or begins like it, of those that are kept, that
  /// have been recognised or that have a file; empty: none.
  [[nodiscard]] std::string known(const CommandedPath& heard);
  /// Whether the two may be records of one motion.
  [[nodiscard]] bool one_motion(const CommandedPath& a, const CommandedPath& b) const;
  /// Returns the name that it gets.
  std::string recognise(CommandedPath path, const MotionRepeats& repeats);

  LearningRules rules_;
  Store& store_;
  EventLog& events_;
  OffsetHandOver& hand_over_;
  Announce announce_;
  ProgramAssembly assembly_;
  std::optional<ProgramFolder> folder_;
  std::map<std::string, std::uint64_t> from_folder_;  // newest revision of each program found there
  ProgramList* list_ = nullptr;
  std::uint64_t changes_seen_ = 0;              // of the list, before the last look into the folder
  std::map<std::string, std::string> results_;  // the last of each program of the list, for people
  std::map<std::string, int> tried_with_;  // version in force of each axis when it was last tried
  std::int64_t looked_ns_ = -kLookEvery_ns;
  Hear hear_;
  Accept accept_;
  MotionWatch motion_;
  double heard_s_ = 0.0;                                      // until this time
  std::int64_t listened_ns_ = -kLookEvery_ns, heard_ns_ = 0;  // last look; last with any rows
  std::optional<MotionRepeats> repeats_;
  double repeated_s_ = 0.0;  // when a move of it has ended
  struct Recognised {
    std::shared_ptr<const CommandedPath> path;
    std::string text;
  };
  std::vector<Recognised> recognised_;  // the newest is the last one, at most kMaxKept
  struct Filed {
    CommandedPath heard;
    std::string program;
  };
  std::vector<Filed> filed_;  // found by reading the folder; the same limit and order
  std::stop_token give_up_;
  std::uint64_t learned_ = 0, plans_made_ = 0;
  std::int64_t renewed_ns_ = 0;
  bool armed_ = false;
  std::vector<Kept> kept_;
  std::vector<std::unique_ptr<const OffsetPlan>> plans_;  // plans that the loop may still use
};

}  // namespace servotwin::daemon
