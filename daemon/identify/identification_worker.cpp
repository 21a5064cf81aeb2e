#include "daemon/identify/identification_worker.h"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <sstream>
#include <thread>
#include <utility>

#include "daemon/between/clock.h"
#include "daemon/identify/held_out.h"
#include "diagnosis/search/acting_axis.h"
#include "drivers/common/text.h"
#include "identification/least_squares/interruption.h"
#include "identification/recording/noise_floor.h"
#include "twin/shown_units.h"
#include "twin/two_mass_axis.h"

namespace servotwin::daemon {
namespace {

constexpr auto kIdentificationPause = std::chrono::milliseconds(100);
// Share of the window that is fitted. The rest does not choose the structure; it only tests whether
// the model predicts at all.
constexpr double kTrainingShare = 0.8;
// Less new evidence than this starts no step.
constexpr double kMinNewEvidence_s = 1.0;
// A model file takes some kilobytes.
constexpr std::size_t kMaxModelBytes = 1'000'000;
// A noise floor that changes by less than this share is not updated.
constexpr double kNoiseFloorTolerance = 0.1;

std::string progress_of(const char* what, double done_s, double needed_s) {
  std::ostringstream out;
  out.setf(std::ios::fixed);
  out.precision(1);
  out << what << " " << std::max(0.0, done_s) << " of " << needed_s << " s of motion";
  return out.str();
}

/// Length of standstill for which the noise floor is measured [s].
double standing_s(const IdentifyConfig& config) {
  return std::max(config.window_s, EvidenceLimits().rest_s);
}

std::string tenths(double value) {
  std::ostringstream out;
  out.setf(std::ios::fixed);
  out.precision(1);
  out << value << " s";
  return out.str();
}

std::string percent(double share) { return number(std::round(100.0 * share)) + " %"; }

EvidenceBounds bounds_of(const IdentifyConfig& config) {
  constexpr double kMemoriesUntilForgotten = 10.0;
  return {config.memory_s, 0.5 * config.memory_s, standing_s(config),
          kMemoriesUntilForgotten * config.memory_s};
}

/// A reason with what the model contains or where it is from, if it was proposed.
std::string with_origin(const std::string& reason, const std::string& because) {
  return because.empty() ? reason : reason + "; " + because;
}

/// The larger noise floor of standstill and motion; NaN without stored motion.
RmsEstimate noise_floor_of(const EvidenceMemory& evidence) {
  const NoiseFloor motion =
      noise_floor(evidence.kept({Evidence::kFastMotion, Evidence::kSlowReversals}));
  // Readings at rest do not show the step where they change between few values.
  const NoiseFloor standing =
      noise_floor(evidence.kept({Evidence::kStandstill}), motion.encoder_step);
  return standing.white.rms > motion.rms ? standing.white : motion;
}

}  // namespace

IdentificationWorker::IdentificationWorker(const MachineDescription& machine,
                                           const IdentifyConfig& config, const MotionMemory& memory,
                                           Store& store, EventLog& events,
                                           std::span<LatestValue<TwinInForce>> in_force,
                                           Announce announce)
    : machine_(machine),
      config_(config),
      memory_(memory),
      store_(store),
      events_(events),
      in_force_(in_force),
      announce_(std::move(announce)) {
  config_.options.training_share = kTrainingShare;
  for (const AxisDescription& axis : machine.axes) {
    axes_.push_back(
        {axis.name, axis.rotary, {}, {}, 0.0, 0.0, EvidenceMemory(bounds_of(config)), {}, {}, {}});
    status_.push_back({axis.name, 0, kAbsent, "waiting for motion"});
  }
  proposals_.resize(axes_.size());
  // Until a model shows more, the first other axis.
  for (std::size_t i = 0; i < axes_.size() && axes_.size() > 1; ++i)
    axes_[i].beside = axes_[i == 0 ? 1 : 0].name;
}

void IdentificationWorker::restore() {
  for (const StoredModel& model : store_.in_force()) {
    const auto found = std::find_if(axes_.begin(), axes_.end(),
                                    [&](const Axis& a) { return a.name == model.record.axis; });
    const std::string version = "model " + std::to_string(model.record.version);
    if (found == axes_.end()) {
      events_.note("model_unused", model.record.axis,
                   version + " is in the store, but the machine has no such axis");
    } else if (const std::string why = why_not_for(model.record, machine_,
                                                   static_cast<std::size_t>(found - axes_.begin()));
               !why.empty()) {
      events_.note("model_unused", model.record.axis, version + " " + why);
    } else {
      put_in_force(static_cast<std::size_t>(found - axes_.begin()), model);
      events_.note("model_restored", model.record.axis, version + " is in force again");
    }
  }
}

void IdentificationWorker::run(const std::stop_token& stop) {
  const auto ends = [&] { return stop.stop_requested() || give_up_.stop_requested(); };
  while (!ends()) {
    bool any = false;
    for (std::size_t axis = 0; axis < axes_.size() && !ends(); ++axis) any = look(axis) || any;
    if (!any) std::this_thread::sleep_for(kIdentificationPause);
  }
}

void IdentificationWorker::reconfigure(const IdentifyConfig& config) {
  const std::lock_guard lock(config_mutex_);
  newer_config_ = config;
}

void IdentificationWorker::take_newer_config() {
  const std::lock_guard lock(config_mutex_);
  if (!newer_config_) return;
  config_ = *std::exchange(newer_config_, std::nullopt);
  config_.options.training_share = kTrainingShare;
  for (Axis& axis : axes_) axis.evidence.keep(bounds_of(config_));
}

void IdentificationWorker::propose(std::size_t axis, ModelRecord record, const std::string& because,
                                   double from_s, double until_s) {
  Pending proposal;
  proposal.identified.record = std::move(record);
  proposal.because = because;
  proposal.from_s = from_s;
  proposal.until_s = until_s;
  const std::lock_guard lock(proposal_mutex_);
  // What a person has proposed waits for its turn.
  if (proposals_.at(axis) && proposals_[axis]->origin != Origin::kDiagnosis) return;
  proposals_[axis] = std::move(proposal);
}

void IdentificationWorker::propose(const ModelProposal& given) {
  const std::string because = by_hand(given.origin);
  const auto axis = std::find_if(axes_.begin(), axes_.end(),
                                 [&](const Axis& one) { return one.name == given.axis; });
  if (axis == axes_.end()) {
    events_.note("model_refused", given.axis,
                 "a model " + because + " is refused: the machine has no such axis");
    return;
  }
  const auto at = static_cast<std::size_t>(axis - axes_.begin());
  const auto refuse = [&](const std::string& why) {
    note_refusal(at, "candidate refused: " + printable(why) + "; " + because);
  };
  Pending proposal;
  proposal.origin = given.force ? Origin::kForced : Origin::kPerson;
  proposal.because = because;
  ModelRecord& record = proposal.identified.record;
  try {
    if (given.model_json.size() > kMaxModelBytes)
      throw std::runtime_error("the model is larger than any model file");
    record = model_from_json(nlohmann::json::parse(given.model_json));
  } catch (const std::exception& error) {
    refuse(error.what());
    return;
  }
  record.axis = axis->name;
  if (const std::string why = why_not_for(record, machine_, at); !why.empty()) {
    refuse("it " + why);
    return;
  }
  std::optional<Pending> replaced;
  {
    const std::lock_guard lock(proposal_mutex_);
    replaced = std::exchange(proposals_[at], std::move(proposal));
  }
  if (replaced && replaced->origin != Origin::kDiagnosis)
    note_refusal(at, "candidate refused: replaced by a later proposal; " + replaced->because);
}

void IdentificationWorker::take_proposal(std::size_t axis) {
  std::optional<Pending> proposal;
  {
    const std::lock_guard lock(proposal_mutex_);
    std::optional<Pending>& waiting = proposals_[axis];
    if (!waiting || (axes_[axis].candidate && waiting->origin != Origin::kForced)) return;
    proposal = std::exchange(waiting, std::nullopt);
  }
  if (proposal->origin == Origin::kForced) {
    admit(proposal->identified.record, false, "", machine_.cycle_s);
    promote(axis, *proposal, kUnjudged);
    return;
  }
  if (proposal->origin == Origin::kDiagnosis) cite(*proposal, proposal->from_s, proposal->until_s);
  // Judged on motion after now, which nobody has seen.
  proposal->until_s = memory_.newest_s();
  proposal->moved_s = memory_.moved_s(axis);
  events_.note("model_proposed", axes_[axis].name,
               "a model " + proposal->because + " is a candidate now");
  consider(axis, *std::move(proposal));
}

bool IdentificationWorker::look(std::size_t axis) {
  take_newer_config();
  take_proposal(axis);
  Axis& state = axes_[axis];
  const double moved_s = memory_.moved_s(axis);
  if (state.candidate) {
    const double from_s = state.candidate->moved_s;
    set_activity(axis, progress_of("judging a candidate:", moved_s - from_s, config_.judge_s));
    const std::optional<double> until_s = memory_.time_when_moved(axis, from_s + config_.judge_s);
    if (!until_s) return false;
    judge_candidate(axis, *until_s);
    set_activity(axis, "a candidate was judged");
    return true;
  }
  set_activity(axis, progress_of("collecting:", moved_s - state.moved_s, config_.window_s) +
                         (state.last_step.empty() ? "" : "; last: " + state.last_step));
  const std::optional<double> until_s =
      memory_.time_when_moved(axis, state.moved_s + config_.window_s);
  // A worker that got no processor for too long continues with the motion that is still in memory.
  if (until_s && *until_s <= memory_.oldest_s() && moved_s - config_.window_s > state.moved_s) {
    events_.note("motion_skipped", state.name,
                 tenths(moved_s - config_.window_s - state.moved_s) +
                     " of motion were skipped: they left the memory before they could be used; the "
                     "processor is too busy");
    state.moved_s = moved_s - config_.window_s;
    return true;
  }
  // Without a model in force there is no noise floor to update.
  const std::optional<double> stood_s =
      state.in_force ? memory_.time_when_stood(axis, state.sorted_s, standing_s(config_))
                     : std::nullopt;
  if (stood_s && (!until_s || *stood_s <= *until_s)) {
    renew_noise_floor(axis, *stood_s);
    return true;
  }
  if (until_s) step(axis, *until_s);
  return until_s.has_value();
}

SegmentedAxis IdentificationWorker::remembered(std::size_t axis, double until_s,
                                               const std::string& beside) const {
  return segment_axis(memory_.copy(until_s - config_.memory_s, until_s, "the motion in memory"),
                      axes_[axis].name, {}, beside);
}

void IdentificationWorker::choose_beside(std::size_t axis, double until_s) {
  Axis& state = axes_[axis];
  if (!config_.options.coupling || axes_.size() < 3 || !state.in_force) return;
  const ModelRecord& record = state.in_force->record;
  std::string best = state.beside;
  double now = 0.0, most = 0.0;
  try {
    const auto share = [&](const std::string& other) {
      return share_of_neighbour(record.model, remembered(axis, until_s, other).segments);
    };
    now = std::max(0.0, share(state.beside));
    most = now + kMinShareOfActing;
    for (const Axis& other : axes_) {
      if (other.name == state.name || other.name == state.beside) continue;
      if (const double one = share(other.name); one > most) most = one, best = other.name;
    }
  } catch (const std::exception&) {
    return;  // the step that follows says what is wrong with the motion
  }
  if (best == state.beside) return;
  events_.note("coupling_sought", state.name,
               "of the error that model " + std::to_string(record.version) +
                   " leaves without a coupling, the acceleration of " + best + " explains " +
                   percent(most) + ", that of " + state.beside + " " + percent(now) +
                   ": it is sought from here on, with new evidence");
  seek_beside(axis, best);
}

void IdentificationWorker::seek_beside(std::size_t axis, const std::string& other) {
  Axis& state = axes_[axis];
  if (other == state.beside) return;
  state.beside = other;
  state.evidence.forget_all();
  state.sorted_s = 0.0;
}

SegmentedAxis IdentificationWorker::sort(std::size_t axis, double until_s) {
  Axis& state = axes_[axis];
  const double before_s = std::exchange(state.sorted_s, until_s);
  SegmentedAxis motion = remembered(axis, until_s, state.beside);
  const EvidenceSeconds fresh = state.evidence.take(motion.segments, before_s, state.moved_s);
  for (const Evidence e : {Evidence::kFastMotion, Evidence::kSlowReversals, Evidence::kStandstill})
    state.fresh.of(e) += fresh.of(e);
  return motion;
}

void IdentificationWorker::step(std::size_t axis, double until_s) {
  Axis& state = axes_[axis];
  set_activity(axis, "identifying");
  state.moved_s += config_.window_s;
  choose_beside(axis, until_s);
  SegmentedAxis motion;
  try {
    motion = sort(axis, until_s);
  } catch (const std::exception& error) {
    note_refusal(axis, std::string("no model was found: ") + error.what());
    return;
  }
  const EvidenceSeconds fresh = std::exchange(state.fresh, {});
  const double fast_s = fresh.of(Evidence::kFastMotion),
               slow_s = fresh.of(Evidence::kSlowReversals);
  const EvidenceSeconds kept = state.evidence.seconds();
  const std::string on = " on " + tenths(kept.of(Evidence::kFastMotion)) + " of fast motion and " +
                         tenths(kept.of(Evidence::kSlowReversals)) + " of slow reversals: ";
  IdentifyOptions options = config_.options;
  options.split_each = true;
  options.with_torque = false;  // a candidate is judged by the position
  const Effect* coupled = state.in_force ? coupling_of(state.in_force->record.model) : nullptr;
  if (!state.in_force) {
    state.last_step = "loop and friction" + on + "no model is in force";
  } else if (fast_s >= kMinNewEvidence_s) {
    state.last_step = "loop and friction" + on + tenths(fast_s) + " of fast motion are new";
  } else if (slow_s < kMinNewEvidence_s) {
    state.last_step = "no step: there is no new fast motion and no new slow reversal";
    return;
  } else if (state.in_force->record.method == "diagnosis") {
    state.last_step =
        "no step: friction from slow reversals starts from an identified model, and model " +
        std::to_string(state.in_force->record.version) + " contains what a diagnosis found";
    return;
  } else if (two_mass_of(state.in_force->record.model) != nullptr) {
    state.last_step =
        "no step: two masses are identified from fast motion, and none is new since model " +
        std::to_string(state.in_force->record.version);
    return;
  } else if (coupled != nullptr) {
    state.last_step =
        "no step: what another axis does is identified from fast motion, and none is new since "
        "model " +
        std::to_string(state.in_force->record.version);
    return;
  } else if (kept.of(Evidence::kFastMotion) == 0.0) {
    state.last_step =
        "no step: friction from slow reversals needs stored fast motion to determine the "
        "loop, and there is none";
    return;
  } else {
    options.start = state.in_force->record.model;
    options.masses = Masses::kRigid;
    state.last_step = "friction" + on + tenths(slow_s) +
                      " of slow reversals are new, fast motion is not; starting from model " +
                      std::to_string(state.in_force->record.version);
  }
  events_.note("identification_step", state.name, state.last_step);
  set_activity(axis, "identifying " + state.last_step);
  std::vector<Segment> evidence =
      state.evidence.kept({Evidence::kFastMotion, Evidence::kSlowReversals});
  // Motion without evidence is fitted as it is, so that the refusal says what excitation it lacks.
  if (!evidence.empty()) motion.segments = std::move(evidence);
  // A coupling is sought where the other axis' command is known all the time.
  options.coupling = options.coupling &&
                     std::all_of(motion.segments.begin(), motion.segments.end(),
                                 [](const Segment& s) { return s.neighbour.size() == s.size(); });
  // By its motion only if that is predicted as well.
  const auto acting = std::find_if(axes_.begin(), axes_.end(),
                                   [&](const Axis& one) { return one.name == motion.neighbour; });
  if (acting == axes_.end() || !acting->in_force) {
    for (Segment& segment : motion.segments) segment.neighbour_motion.resize(0);
  }
  seek(axis, until_s, motion, options);
}

void IdentificationWorker::cite(Pending& candidate, double from_s, double until_s) const {
  if (!files_with_) return;
  for (std::string& name : files_with_(from_s, until_s)) {
    if (std::find(candidate.recordings.begin(), candidate.recordings.end(), name) ==
        candidate.recordings.end())
      candidate.recordings.push_back(std::move(name));
  }
}

void IdentificationWorker::renew_noise_floor(std::size_t axis, double until_s) {
  Axis& state = axes_[axis];
  try {
    sort(axis, until_s);
  } catch (const std::exception& error) {
    state.last_step = std::string("noise floor at standstill not measured: ") + error.what();
    return;
  }
  const RmsEstimate floor = noise_floor_of(state.evidence);
  RmsEstimate& known = state.in_force->record.noise_floor;
  const std::string version = "model " + std::to_string(state.in_force->record.version);
  if (!std::isfinite(floor.rms)) {
    state.last_step =
        "standstill: the noise floor of " + version + " is unchanged, no motion is stored";
    return;
  }
  state.last_step = "standstill: noise floor of " + version + " " +
                    micro_text(floor.rms, state.rotary, 3) + ", no fit";
  if (std::abs(floor.rms - known.rms) <= kNoiseFloorTolerance * known.rms) return;
  const std::string before =
      std::isfinite(known.rms) ? ", was " + micro_text(known.rms, state.rotary, 3) : "";
  known = floor;
  events_.note("noise_floor", state.name, state.last_step + before);
}

void IdentificationWorker::seek(std::size_t axis, double until_s, const SegmentedAxis& motion,
                                const IdentifyOptions& options) {
  Pending candidate;
  candidate.until_s = until_s;
  candidate.moved_s = axes_[axis].moved_s;
  for (const Segment& segment : motion.segments) cite(candidate, segment.start_s, segment.end_s());
  const std::int64_t begin = steady_ns();
  set_identifying(Identifying{axis, begin});
  std::optional<Identified> found = identified(axis, motion, options);
  set_identifying(std::nullopt);
  // Until the next look at this axis, which may have to wait for another one.
  set_activity(axis, found ? "identified, not judged yet" : "no model was found");
  if (!found) return;
  candidate.identified = *std::move(found);
  ModelRecord& record = candidate.identified.record;
  record.motion = motion_range(motion.segments);
  record.source = "live";
  record.created = iso_time(wall_ns());
  record.time_taken_s = static_cast<double>(steady_ns() - begin) * 1e-9;
  consider(axis, std::move(candidate));
}

std::optional<Identified> IdentificationWorker::identified(std::size_t axis,
                                                           const SegmentedAxis& motion,
                                                           const IdentifyOptions& options) {
  const Interruptible until(give_up_);
  try {
    return identify(motion, options);
  } catch (const Interrupted&) {
    events_.note("identification_given_up", axes_[axis].name,
                 "the identification is given up, because the daemon stops");
  } catch (const std::exception& error) {
    note_refusal(axis, std::string("no model was found: ") + error.what());
  }
  return std::nullopt;
}

void IdentificationWorker::consider(std::size_t axis, Pending candidate) {
  Axis& state = axes_[axis];
  // A candidate that must not be used is refused without waiting for held-out motion.
  Candidacy candidacy;
  candidacy.rotary = state.rotary;
  candidacy.refusals = candidate.identified.refusals;
  // A person may accept a model with parameters that were not excited; the daemon refuses it.
  const std::vector<std::string>& not_excited = candidate.identified.record.excitation;
  candidacy.refusals.insert(candidacy.refusals.end(), not_excited.begin(), not_excited.end());
  candidacy.invalid = why_invalid(candidate.identified.record.model);
  if (candidacy.refusals.empty() && candidacy.invalid.empty()) {
    state.candidate = std::move(candidate);
  } else {
    rule(axis, candidate, candidacy);
  }
}

void IdentificationWorker::judge_candidate(std::size_t axis, double until_s) {
  Axis& state = axes_[axis];
  set_activity(axis, "judging");
  Pending candidate = std::move(*state.candidate);
  state.candidate.reset();
  const Model& model = candidate.identified.record.model;
  const Model* other = state.in_force ? &state.in_force->record.model : nullptr;
  Candidacy candidacy;
  candidacy.rotary = state.rotary;
  candidacy.judged_s = config_.judge_s;
  candidacy.version_in_force = state.in_force ? state.in_force->record.version : 0;
  try {
    if (memory_.oldest_s() > candidate.until_s + 2.0 * machine_.cycle_s) {
      throw std::runtime_error(
          "the held-out motion is no longer in memory; the processor is too busy");
    }
    const double after_s = candidate.until_s + 0.5 * machine_.cycle_s;  // that sample was seen
    // Each model with the axis that it is coupled to.
    const auto held_out = [&](const ModelRecord& record) {
      const std::vector<Segment> all = remembered(axis, until_s, record.neighbour).segments;
      std::vector<Segment> out = with_lead_in(cut(all, after_s, until_s), all);
      const int acting = neighbour_in(machine_, axis, record);
      const auto* its = acting < 0 ? nullptr : &axes_[static_cast<std::size_t>(acting)].in_force;
      see_as_live(out, record, its != nullptr && *its ? &(*its)->record : nullptr);
      return out;
    };
    const std::vector<Segment> motion = held_out(candidate.identified.record);
    candidate.identified.record.holdout =
        judge_on(motion, model, other != nullptr ? held_out(state.in_force->record) : motion, other,
                 candidacy);
    cite(candidate, candidate.until_s, until_s);
  } catch (const std::exception& error) {
    note_refusal(
        axis, with_origin(std::string("candidate not judged: ") + error.what(), candidate.because));
    return;
  }
  if (candidate.origin == Origin::kPerson)
    admit(candidate.identified.record, true, iso_time(wall_ns()), machine_.cycle_s);
  rule(axis, candidate, candidacy);
}

void IdentificationWorker::rule(std::size_t axis, const Pending& candidate,
                                const Candidacy& candidacy) {
  const Decision decision = decide(candidacy, {config_.judge_s, config_.min_improvement});
  if (!decision.promoted()) {
    note_refusal(axis, "candidate refused: " + with_origin(decision.reason, candidate.because),
                 to_json(candidate.identified.record).dump());
    validate(axis, candidacy);
    return;
  }
  promote(axis, candidate, decision.reason);
}

void IdentificationWorker::promote(std::size_t axis, const Pending& candidate,
                                   const std::string& reason) {
  Axis& state = axes_[axis];
  StoredModel model{candidate.identified.record, with_origin(reason, candidate.because)};
  const int next = (state.in_force ? state.in_force->record.version : 0) + 1;
  const Event event = event_now("model_promoted", state.name,
                                "model " + std::to_string(next) + " is in force: " + model.reason);
  try {
    store_.promote(model.record, event, candidate.recordings);
  } catch (const std::runtime_error& error) {
    events_.error(
        "not_stored", state.name,
        std::string("a better model was found but is not in force, because it cannot be stored: ") +
            error.what());
    if (candidate.origin != Origin::kDiagnosis)
      note_refusal(axis, with_origin("candidate refused: it cannot be stored", candidate.because));
    return;
  }
  put_in_force(axis, model);
  events_.print(event);
}

void IdentificationWorker::validate(std::size_t axis, const Candidacy& candidacy) {
  const std::optional<StoredModel>& held = axes_[axis].in_force;
  if (!held || !still_holds(candidacy, held->record.holdout.rms)) return;
  try {
    store_.validate(axes_[axis].name, held->record.version, iso_time(wall_ns()));
  } catch (const std::runtime_error& error) {
    events_.error(
        "not_stored", axes_[axis].name,
        std::string("the validation of the model in force could not be stored: ") + error.what());
  }
}

void IdentificationWorker::put_in_force(std::size_t axis, const StoredModel& model) {
  const ModelRecord& record = model.record;
  in_force_[axis].publish(twin_in_force(record, machine_, axis));
  axes_[axis].in_force = model;
  if (coupling_of(record.model) != nullptr && !record.neighbour.empty())
    seek_beside(axis, record.neighbour);
  {
    const std::lock_guard lock(status_mutex_);
    status_[axis].model_version = record.version;
    status_[axis].holdout_rms = record.holdout.rms;
  }
  announce_(model);
}

void IdentificationWorker::finish() {
  for (std::size_t axis = 0; axis < axes_.size(); ++axis) {
    std::optional<Pending>& candidate = axes_[axis].candidate;
    while (!give_up_.stop_requested() && (look(axis) || candidate)) {
      if (!candidate || memory_.time_when_moved(axis, candidate->moved_s + config_.judge_s))
        continue;
      // The motion that would decide it does not come.
      const double judged_s = memory_.moved_s(axis) - candidate->moved_s;
      note_refusal(axis, with_origin("candidate not decided: " +
                                         progress_of("it was judged on", judged_s, config_.judge_s),
                                     candidate->because));
      candidate.reset();
      // An axis without a model is identified from what is in memory. One that has a model only
      // hears what else was proposed.
      if (!axes_[axis].in_force) continue;
      take_proposal(axis);
      if (!candidate) break;
    }
  }
}

void IdentificationWorker::update(std::vector<AxisStatus>& status) const {
  const std::unique_lock lock(status_mutex_, std::try_to_lock);
  if (!lock.owns_lock()) return;
  status = status_;
  if (!identifying_) return;
  const std::string taken =
      number(std::round(1e-9 * static_cast<double>(steady_ns() - identifying_->since_ns))) + " s";
  for (std::size_t i = 0; i < status.size(); ++i) {
    status[i].activity += i == identifying_->axis
                              ? "; " + taken + " so far"
                              : "; on hold while " + status[identifying_->axis].name +
                                    " is identified, " + taken + " so far";
  }
}

void IdentificationWorker::set_identifying(std::optional<Identifying> now) {
  const std::lock_guard lock(status_mutex_);
  identifying_ = now;
}

void IdentificationWorker::set_activity(std::size_t axis, const std::string& activity) {
  const std::lock_guard lock(status_mutex_);
  status_[axis].activity = activity;
}

void IdentificationWorker::note_refusal(std::size_t axis, const std::string& why,
                                        const std::string& detail) {
  {
    const std::lock_guard lock(status_mutex_);
    ++status_[axis].refused;
    status_[axis].last_refusal = why;
  }
  events_.note("model_refused", axes_[axis].name, why, detail);
}

}  // namespace servotwin::daemon
