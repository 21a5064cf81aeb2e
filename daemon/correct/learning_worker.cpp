#include "daemon/correct/learning_worker.h"

#include <algorithm>
#include <array>
#include <cstdio>
#include <nlohmann/json.hpp>
#include <utility>

#include "daemon/between/clock.h"
#include "drivers/common/text.h"

namespace servotwin::daemon {
namespace {
constexpr double kProgramTimeout_s = 0.1;  // timeout after which the worker checks whether to stop
// A repetition is over when none of its moves has ended for so many of its periods: one pause that
// is longer than those before is not the end.
constexpr double kPeriodsUntilOver = 2.0;

std::map<std::string, int> versions_of(const std::vector<StoredModel>& in_force) {
  std::map<std::string, int> out;
  for (const StoredModel& model : in_force) out[model.record.axis] = model.record.version;
  return out;
}
std::string rounded(double seconds) {
  std::array<char, 32> text{};
  std::snprintf(text.data(), text.size(), "%.2f", seconds);
  return text.data();
}

}  // namespace

LearningWorker::LearningWorker(LearningRules rules, Store& store, EventLog& events,
                               OffsetHandOver& hand_over, Announce announce)
    : rules_(std::move(rules)),
      store_(store),
      events_(events),
      hand_over_(hand_over),
      announce_(std::move(announce)),
      assembly_(rules_.machine),
      motion_(rules_.machine, rules_.ilc.match_tolerance) {
  if (!rules_.ilc.programs.empty()) folder_.emplace(rules_.ilc.programs, rules_.machine);
}

void LearningWorker::run(const std::stop_token& stop, DdsReader<ProgramChunk>& programs) {
  std::uint64_t reported_malformed = 0;
  ProgramChunk chunk;
  while (!stop.stop_requested()) {
    if (programs.receive(chunk, kProgramTimeout_s)) take(chunk, steady_ns());
    look_into_folder(steady_ns());
    refuse_overdue(steady_ns());
    judge_runs();
    look_for_repetition(steady_ns());
    report_stale();
    renew(steady_ns());
    show();
    if (const std::uint64_t malformed = programs.counts().malformed;
        malformed > reported_malformed) {
      events_.error(
          "program_refused", "",
          std::to_string(malformed - reported_malformed) +
              " program chunks ignored: the name of a program may contain letters, digits "
              "and . _ - only");
      reported_malformed = malformed;
    }
  }
}

void LearningWorker::take(const ProgramChunk& chunk, std::int64_t now_ns) {
  const ProgramAssembly::Outcome outcome = assembly_.take(chunk, now_ns);
  if (const auto* refusal = std::get_if<ProgramRefusal>(&outcome)) refuse(*refusal);
  if (const auto* program = std::get_if<CommandedPath>(&outcome)) learn_now(*program);
}

void LearningWorker::look_into_folder(std::int64_t now_ns) {
  if (!folder_ || between_ns(looked_ns_, now_ns) < kLookEvery_ns) return;
  looked_ns_ = now_ns;
  try_again();
  if (list_ != nullptr) changes_seen_ = list_->changes();
  const ProgramFolder::News news = folder_->look(wall_ns());
  if (!news.problem.empty()) events_.error("program_refused", "", "ilc.programs: " + news.problem);
  if (!news.gone.empty() || !news.found.empty()) filed_.clear();
  for (const std::string& program : news.gone) gone(program);
  for (const ProgramFolder::Found& found : news.found) {
    if (found.taken) {  // the program of the other file stays what it is
      events_.error("program_refused", "", "ilc.programs: " + found.problem);
      continue;
    }
    from_folder_[found.program] = found.revision;
    if (!found.renamed.empty())
      events_.note("program_renamed", "",
                   "ilc.programs: " + in_quotes(found.renamed) + " is program " +
                       in_quotes(found.program) +
                       ": a name has at most 63 letters, digits or . _ - and begins with no dot; "
                       "rename the file to choose it");
    if (!found.problem.empty()) refuse({found.program, found.revision, found.problem});
    for (const ProgramChunk& chunk : found.chunks) take(chunk, now_ns);
  }
  if (!news.found.empty()) tried_with_ = versions_of(store_.in_force());
}

void LearningWorker::look_for_repetition(std::int64_t now_ns) {
  if (!hear_ || rules_.ilc.recognise == IlcConfig::Recognise::kOff ||
      between_ns(listened_ns_, now_ns) < kLookEvery_ns)
    return;
  listened_ns_ = now_ns;
  const Recording news = hear_(heard_s_);
  if (!news.time.empty()) {
    heard_s_ = news.time.back();
    heard_ns_ = now_ns;
  }
  if (!motion_.take(news)) {
    const double silent_s = 1e-9 * static_cast<double>(between_ns(heard_ns_, now_ns));
    if (repeats_ &&
        std::max(heard_s_ - repeated_s_, silent_s) > kPeriodsUntilOver * repeats_->longest_period_s)
      repeats_.reset();
    return;
  }
  repeats_.reset();
  repeated_s_ = heard_s_;
  std::optional<RepeatingMotion> found = motion_.repetition();
  if (!found) return;
  // The loop recognises so many programs; the longest are worth most.
  std::stable_sort(found->parts.begin(), found->parts.end(),
                   [](const auto& a, const auto& b) { return a.rows > b.rows; });
  if (found->parts.size() > kMaxKept) found->parts.resize(kMaxKept);
  const auto [shortest_s, longest_s] = motion_.periods_s(*found);
  MotionRepeats repeats{{}, found->begins.size(), shortest_s, longest_s};
  for (const RepeatedPart& part : found->parts) {
    CommandedPath path = motion_.program_of(part);
    std::string name = known(path);
    if (name.empty()) name = recognise(std::move(path), repeats);
    repeats.programs.push_back(std::move(name));
  }
  repeats_ = std::move(repeats);
}

bool LearningWorker::one_motion(const CommandedPath& a, const CommandedPath& b) const {
  // Each is within the tolerance of the motion.
  return begin_alike(a, b, 2.0 * rules_.ilc.match_tolerance);
}

std::string LearningWorker::known(const CommandedPath& heard) {
  for (const Kept& one : kept_) {
    if (one_motion(one->program, heard)) return one->program.name;
  }
  for (const Recognised& one : recognised_) {
    if (one_motion(*one.path, heard)) return one.path->name;
  }
  for (const Filed& one : filed_) {
    if (one_motion(one.heard, heard)) return one.program;
  }
  if (!folder_) return {};
  std::string name = folder_->find(
      [&](const CommandedPath& program) { return one_motion(program, heard); }, give_up_);
  if (name.empty()) return name;
  if (filed_.size() == kMaxKept) filed_.erase(filed_.begin());
  filed_.push_back({heard, name});
  return name;
}

std::string LearningWorker::recognise(CommandedPath path, const MotionRepeats& repeats) {
  // The file of this name has another path by now.
  const std::string motion = path.name;
  for (int n = 2; folder_ && folder_->found().contains(path.name); ++n)
    path.name = motion + "-" + std::to_string(n);
  std::string name = path.name;
  std::vector<std::string> axes;
  for (const std::size_t axis : path.axes) axes.push_back(rules_.machine.axes[axis].name);
  const double shortest_s = repeats.shortest_period_s, longest_s = repeats.longest_period_s;
  const std::string text =
      listed(axes) + " repeat " + std::to_string(path.rows()) + " rows of motion; " +
      std::to_string(repeats.repetitions) + " times until now, every " + rounded(shortest_s) +
      (rounded(longest_s) == rounded(shortest_s) ? "" : " to " + rounded(longest_s)) + " s";
  const bool learns = rules_.ilc.recognise == IlcConfig::Recognise::kLearn;
  const std::string next =
      learns    ? "it is put into the folder of programs"
      : folder_ ? "to have it learned, send PUT /api/v1/programs/" + name + " without a body"
                : "to have it learned, configure ilc.programs";
  events_.note("motion_repeats", "", "program '" + name + "' is recognised: " + text + "; " + next,
               nlohmann::json{{"program", name},
                              {"axes", axes},
                              {"rows", path.rows()},
                              {"repetitions", repeats.repetitions},
                              {"shortest_period_s", shortest_s},
                              {"longest_period_s", longest_s}}
                   .dump());
  if (recognised_.size() == kMaxKept) recognised_.erase(recognised_.begin());
  recognised_.push_back({std::make_shared<const CommandedPath>(std::move(path)), text});
  if (!learns || !accept_) return name;
  show();  // what is accepted is taken from the list
  if (const ProgramInbox::Outcome outcome = accept_(name);
      outcome.what != ProgramInbox::Outcome::What::kDone)
    events_.error("program_refused", "", "program '" + name + "': " + outcome.text);
  return name;
}

void LearningWorker::gone(const std::string& program) {
  const std::uint64_t revision = from_folder_[program];
  from_folder_.erase(program);
  const auto found = std::find_if(kept_.begin(), kept_.end(), [&](const Kept& one) {
    return one->program.name == program && one->program.revision == revision;
  });
  if (found == kept_.end()) return;
  const Kept learned = *found;
  withdraw(learned, "its file is no longer in " + folder_->folder().string());
  tried_with_.clear();  // a file that it had replaced, of the same path, may be there still
}

void LearningWorker::try_again() {
  std::vector<std::string> without = folder_->programs();
  std::erase_if(without, [&](const std::string& program) {
    return std::any_of(kept_.begin(), kept_.end(),
                       [&](const Kept& one) { return one->program.name == program; });
  });
  if (without.empty()) return;
  std::map<std::string, int> versions = versions_of(store_.in_force());
  if (versions == tried_with_) return;
  tried_with_ = std::move(versions);
  folder_->find_again(without);
}

void LearningWorker::refuse_overdue(std::int64_t now_ns) {
  while (const std::optional<ProgramRefusal> refusal = assembly_.overdue(now_ns)) refuse(*refusal);
}

void LearningWorker::learn_now(const CommandedPath& program) {
  if (program.learn) show(program.name);
  try {
    const std::int64_t begin_ns = steady_ns();
    LearnedProgram made = learned(program, rules_, store_.in_force(), wall_ns(), give_up_);
    made.number = ++learned_;
    std::vector<Kept> same;
    for (const Kept& one : kept_) {
      if (!program.learn || one->program.name == program.name ||
          !same_course(one->program, program, rules_.ilc.match_tolerance))
        continue;
      same.push_back(one);
      made.notes.push_back(
          "it replaces program '" + one->program.name +
          "', which is the same path: if both were kept, neither would be recognised");
    }
    const double taken_s = 1e-9 * static_cast<double>(steady_ns() - begin_ns);
    const std::vector<CorrectionChunk> chunks = chunks_of(made, rules_);
    events_.note(program.learn ? "correction_learned" : "program_previewed", "",
                 "program '" + program.name + "' of " + std::to_string(program.rows()) + " rows, " +
                     (program.learn ? "learned" : "previewed") + " in " + number(taken_s) +
                     " s: " + chunks.front().reason,
                 detail_of(made));
    for (const CorrectionChunk& chunk : chunks) announce_(chunk);
    if (program.learn) results_[program.name] = chunks.front().reason;
    if (program.learn) keep(std::make_shared<const LearnedProgram>(std::move(made)));
    for (const Kept& one : same)
      withdraw(one, "program '" + program.name + "' is the same path and replaces it");
  } catch (const std::exception& error) {
    refuse({program.name, program.revision, error.what()});
  }
}

void LearningWorker::judge_runs() {
  for (OffsetRun run; hand_over_.runs.pop(run);) judge(run);
}

void LearningWorker::report_stale() {
  // relaxed: the flag orders nothing.
  const bool before = std::exchange(armed_, hand_over_.armed.load(std::memory_order_relaxed));
  if (before || !armed_) return;
  for (const Kept& one : kept_) {
    if (stale(*one, rules_, wall_ns()))
      events_.error(
          "correction_stale", "",
          "program '" + one->program.name +
              "': armed, but its models were last validated longer ago than ilc.model_age_s: "
              "nothing is sent until they are validated again");
  }
}

void LearningWorker::renew(std::int64_t now_ns) {
  if (kept_.empty() || between_ns(renewed_ns_, now_ns) < kRenewEvery_ns) return;
  renewed_ns_ = now_ns;
  const std::vector<StoredModel> in_force = store_.in_force();
  bool any = false;
  for (Kept& one : kept_) {
    std::optional<std::int64_t> validated = validated_ns(*one, in_force);
    if (!validated || *validated <= one->validated_ns) continue;
    LearnedProgram newer = *one;
    // The wall clock may have been set back in the meantime.
    newer.validated_ns = std::min(wall_ns(), *validated);
    one = std::make_shared<const LearnedProgram>(std::move(newer));
    any = true;
  }
  if (any) hand_over_plan(true);
}

void LearningWorker::judge(const OffsetRun& run) {
  if (run.live && hear_) {  // what was commanded has the offset in it and is no program
    motion_.forget();
    repeats_.reset();
    if (const Recording heard = hear_(heard_s_); !heard.time.empty()) heard_s_ = heard.time.back();
  }
  const auto found = std::find_if(kept_.begin(), kept_.end(),
                                  [&](const Kept& one) { return one->number == run.learned; });
  if (found == kept_.end()) return;  // replaced by another correction in the meantime
  const Kept learned = *found;
  const CorrectionRuling ruling = ruling_after(run, *learned, rules_.machine);
  events_.note(
      "correction_used", "",
      "program '" + learned->program.name + "': " + gain_text(run, *learned) + "; " + ruling.reason,
      gain_detail(run, *learned, ruling));
  if (ruling.what == CorrectionRuling::What::kWithdraw) withdraw(learned, ruling.reason);
  if (ruling.what == CorrectionRuling::What::kLearnAnew) learn_anew(learned);
}

void LearningWorker::learn_anew(const Kept& learned) {
  const auto known = [&](const StoredModel& model) {
    return std::all_of(
        learned->axes.begin(), learned->axes.end(), [&](const AxisCorrectionFigures& axis) {
          return axis.name != model.record.axis || axis.model_version == model.record.version;
        });
  };
  const std::vector<StoredModel> in_force = store_.in_force();
  if (!std::all_of(in_force.begin(), in_force.end(), known)) {
    learn_now(learned->program);
  } else {
    events_.note(
        "correction_kept", "",
        "program '" + learned->program.name +
            "': its correction is kept, because no newer model is in force to learn it on");
    hand_over_plan();  // the loop uses it again
  }
}

void LearningWorker::withdraw(const Kept& learned, const std::string& why) {
  forget(learned->program.name);
  results_[learned->program.name] = "its correction is withdrawn: " + why;
  events_.error("correction_withdrawn", "",
                "program '" + learned->program.name + "': its correction is withdrawn: " + why);
  CorrectionChunk answer;
  answer.program = learned->program.name;
  answer.revision = learned->program.revision;
  answer.state = CorrectionState::kWithdrawn;
  answer.reason = why;
  answer.created_ns = wall_ns();
  answer.cycle_s = rules_.machine.cycle_s;
  announce_(answer);
}

void LearningWorker::refuse(const ProgramRefusal& refusal) {
  forget(refusal.program);
  results_[refusal.program] = refusal.reason;
  events_.error("program_refused", "", "program '" + refusal.program + "': " + refusal.reason);
  CorrectionChunk answer;
  answer.program = refusal.program;
  answer.revision = refusal.revision;
  answer.state = CorrectionState::kRefused;
  answer.reason = refusal.reason;
  answer.created_ns = wall_ns();
  answer.cycle_s = rules_.machine.cycle_s;
  announce_(answer);
}

void LearningWorker::keep(Kept learned) {
  const std::string name = learned->program.name;
  std::erase_if(kept_, [&](const Kept& one) { return one->program.name == name; });
  if (kept_.size() == kMaxKept) {
    results_[kept_.front()->program.name] =
        "its correction is dropped: " + std::to_string(kMaxKept) +
        " newer ones are kept, and no more";
    kept_.erase(kept_.begin());
  }
  std::erase_if(recognised_, [&](const Recognised& one) {
    return one.path->name != name && one_motion(*one.path, learned->program);
  });
  kept_.push_back(std::move(learned));
  hand_over_plan();
}

void LearningWorker::forget(const std::string& program) {
  const auto named = [&](const Kept& one) { return one->program.name == program; };
  if (std::erase_if(kept_, named) > 0) hand_over_plan();
}

void LearningWorker::show(const std::string& learning) {
  if (list_ == nullptr) return;
  using What = ProgramState::What;
  std::map<std::string, ProgramState> of;
  const std::map<std::string, bool> files =
      folder_ ? folder_->found() : std::map<std::string, bool>();
  for (const auto& [program, read] : files)
    of[program] = {What::kNotLearned, from_folder_[program], {}};
  for (const Kept& one : kept_) of[one->program.name] = {What::kLearned, one->program.revision, {}};
  for (const auto& [program, read] : files) {
    if (!read) of[program].what = What::kWaiting;
  }
  for (const Recognised& one : recognised_)
    of.try_emplace(one.path->name,
                   ProgramState{ProgramState::What::kRecognised, 0, one.text, one.path});
  if (!learning.empty()) of[learning].what = What::kLearning;
  std::erase_if(results_, [&](const auto& one) { return !of.contains(one.first); });
  for (const auto& [program, result] : results_) of[program].text = result;
  list_->show(std::move(of), changes_seen_, repeats_);
}

void LearningWorker::hand_over_plan(bool renewed) {
  auto plan = std::make_unique<OffsetPlan>();
  // A plan that the loop has not taken yet may come from a decision; this plan then replaces it and
  // must not count as a mere renewal.
  // acquire: pairs with the release of the loop.
  plan->renewed = renewed && hand_over_.in_use.load(std::memory_order_acquire) == plans_made_;
  plan->generation = ++plans_made_;
  plan->wall_ns = wall_ns();
  for (const Kept& one : kept_) {
    if (one->why_not_live.empty()) plan->programs.push_back(one);
  }
  hand_over_.plans.publish(plan.get());
  plans_.push_back(std::move(plan));
  // acquire: pairs with the release of the loop, which is done with all plans before this one.
  const std::uint64_t in_use = hand_over_.in_use.load(std::memory_order_acquire);
  std::erase_if(plans_, [&](const auto& one) { return one->generation < in_use; });
}

}  // namespace servotwin::daemon
