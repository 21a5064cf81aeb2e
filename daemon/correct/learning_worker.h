// The learning worker: takes commanded programs from the network, learns their corrections on the
// models in force, and publishes what came of it.
//
//   chunks --> whole and checked (daemon/correct/program_assembly.h) --> virtual trials on the
//   twins (daemon/correct/learned_program.h) --> correction on the network, an event with its
//   figures in the store --> a plan for the real-time loop (daemon/loop/live_offsets.h), which
//   tells of every run
//   --> kept, learned anew or withdrawn (daemon/correct/correction_rule.h), the gain an event
//
// Nothing is learned that was not asked for. Learned, previewed, refused, used, withdrawn: each is
// an event with its reason, and a refusal the last error of the status, too. The newest corrections
// are kept, until the daemon stops: whoever sends programs keeps them for late joiners.
//
// One worker thread at idle priority. When the daemon is asked to stop, learning is given up before
// its next trial.
#pragma once

#include <functional>
#include <memory>
#include <stop_token>
#include <string>
#include <vector>

#include "daemon/between/offset_plan.h"
#include "daemon/correct/correction_rule.h"
#include "daemon/correct/learned_program.h"
#include "daemon/correct/program_assembly.h"
#include "daemon/loop/program_matcher.h"
#include "daemon/store/event_log.h"
#include "daemon/store/store.h"
#include "drivers/dds.h"

namespace servotwin::daemon {

class LearningWorker {
 public:
  static constexpr std::size_t kMaxKept = ProgramMatcher::kMaxPrograms;
  static constexpr std::int64_t kRenewEvery_ns = 600'000'000'000;
  using Announce = std::function<void(const CorrectionChunk&)>;

  /// All arguments outlive the worker.
  LearningWorker(LearningRules rules, Store& store, EventLog& events, OffsetHandOver& hand_over,
                 Announce announce);

  /// When this stops, learning is given up before its next trial. Before the thread.
  void give_up_with(const std::stop_token& stop) { give_up_ = stop; }
  void run(const std::stop_token& stop, DdsReader<ProgramChunk>& programs);
  /// One chunk of a program. `now_ns`: any clock that goes on.
  void take(const ProgramChunk& chunk, std::int64_t now_ns);
  /// Refuses what has waited for a chunk for too long.
  void refuse_overdue(std::int64_t now_ns);
  /// Heeds what the real-time loop told of runs since the last call.
  void heed_runs();
  /// What was learned is as fresh as its models, which are found to hold again and again. Looks
  /// after that every kRenewEvery_ns; `now_ns` as above.
  void renew(std::int64_t now_ns);
  /// Says which corrections are too old to be sent, when a person has armed it.
  void heed_arming();
  /// The corrections that are kept, the newest last.
  [[nodiscard]] const std::vector<std::shared_ptr<const LearnedProgram>>& kept() const noexcept {
    return kept_;
  }

 private:
  using Kept = std::shared_ptr<const LearnedProgram>;
  void learn_now(const CommandedPath& program);
  void heed(const OffsetRun& run);
  void learn_anew(const Kept& learned);
  void withdraw(const Kept& learned, const std::string& why);
  void refuse(const ProgramRefusal& refusal);
  void keep(Kept learned);
  void forget(const std::string& program);
  void hand_over_plan(bool renewed = false);

  LearningRules rules_;
  Store& store_;
  EventLog& events_;
  OffsetHandOver& hand_over_;
  Announce announce_;
  ProgramAssembly assembly_;
  std::stop_token give_up_;
  std::uint64_t learned_ = 0, plans_made_ = 0;
  std::int64_t renewed_ns_ = 0;
  bool armed_ = false;
  std::vector<Kept> kept_;
  std::vector<std::unique_ptr<const OffsetPlan>> plans_;  // that the loop may still use
};

}  // namespace servotwin::daemon
