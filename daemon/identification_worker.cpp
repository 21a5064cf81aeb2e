#include "daemon/identification_worker.h"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <sstream>
#include <thread>

#include "daemon/clock.h"
#include "drivers/text.h"
#include "identification/segments.h"

namespace servotwin {
namespace {

constexpr auto kPause = std::chrono::milliseconds(100);
// Inside the window: the rest chooses nothing, but tells the identification whether it predicts at
// all.
constexpr double kTrainingShare = 0.8;
// A model of another sampling time is another machine's.
constexpr double kSameCycle = 0.01;

std::string progress_of(const char* what, double done_s, double needed_s) {
  std::ostringstream out;
  out.setf(std::ios::fixed);
  out.precision(1);
  out << what << ": " << std::max(0.0, done_s) << " of " << needed_s << " s of motion";
  return out.str();
}

/// What is left of the error by this model, or by none, where the first `skip_s` of every segment
/// do not count.
ErrorFigures left_by(const Model* model, const std::vector<Segment>& segments, double skip_s) {
  double sum = 0.0;
  ErrorFigures out{kAbsent, 0.0};
  Eigen::Index count = 0;
  for (const Segment& segment : segments) {
    const auto skip = static_cast<Eigen::Index>(std::ceil(skip_s / segment.sample_time_s));
    if (segment.size() <= skip) continue;
    Eigen::ArrayXd left = segment.command - segment.actual;
    if (model != nullptr) left -= simulate(*model, segment);
    const auto counted = left.tail(segment.size() - skip);
    sum += counted.square().sum();
    out.max = std::max(out.max, counted.abs().maxCoeff());
    count += counted.size();
  }
  if (count == 0) return {};
  out.rms = std::sqrt(sum / static_cast<double>(count));
  return out;
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
    axes_.push_back({axis.name, axis.rotary, {}, {}, 0.0});
    status_.push_back({axis.name, 0, kAbsent, "waiting for motion"});
  }
}

void IdentificationWorker::restore() {
  for (const StoredModel& model : store_.in_force()) {
    const auto found = std::find_if(axes_.begin(), axes_.end(),
                                    [&](const Axis& a) { return a.name == model.record.axis; });
    const std::string version = "model " + std::to_string(model.record.version);
    if (found == axes_.end()) {
      events_.note("model_unused", model.record.axis,
                   version + " is in the store, but the machine has no such axis");
    } else if (model.record.rotary != found->rotary) {
      events_.note("model_unused", model.record.axis,
                   version + (found->rotary ? " is for a linear axis, this one is rotary"
                                            : " is for a rotary axis, this one is linear"));
    } else if (std::abs(model.record.model.sample_time_s - machine_.cycle_s) >
               kSameCycle * machine_.cycle_s) {
      events_.note("model_unused", model.record.axis,
                   version + " is for a cycle of " + number(model.record.model.sample_time_s) +
                       " s, the machine runs at " + number(machine_.cycle_s) + " s");
    } else {
      put_in_force(static_cast<std::size_t>(found - axes_.begin()), model);
      events_.note("model_restored", model.record.axis, version + " is in force again");
    }
  }
}

void IdentificationWorker::run(const std::stop_token& stop) {
  while (!stop.stop_requested()) {
    bool any = false;
    for (std::size_t axis = 0; axis < axes_.size() && !stop.stop_requested(); ++axis)
      any = look(axis) || any;
    if (!any) std::this_thread::sleep_for(kPause);
  }
}

bool IdentificationWorker::look(std::size_t axis) {
  Axis& state = axes_[axis];
  const double moved_s = memory_.moved_s(axis);
  if (state.candidate) {
    const double from_s = state.candidate->moved_s;
    say(axis, progress_of("judging a candidate", moved_s - from_s, config_.judge_s));
    const std::optional<double> until_s = memory_.time_when_moved(axis, from_s + config_.judge_s);
    if (until_s) judge_candidate(axis, *until_s);
    return until_s.has_value();
  }
  say(axis, progress_of("collecting", moved_s - state.moved_s, config_.window_s));
  const std::optional<double> until_s =
      memory_.time_when_moved(axis, state.moved_s + config_.window_s);
  if (until_s) seek(axis, *until_s);
  return until_s.has_value();
}

void IdentificationWorker::seek(std::size_t axis, double until_s) {
  Axis& state = axes_[axis];
  say(axis, "identifying");
  state.moved_s += config_.window_s;
  Pending candidate;
  candidate.until_s = until_s;
  candidate.moved_s = state.moved_s;
  try {
    const Recording recording = memory_.copy(axis, until_s - config_.memory_s, until_s, "live");
    const std::int64_t begin = steady_ns();
    candidate.identified = identify(segment_axis(recording, state.name), config_.options);
    ModelRecord& record = candidate.identified.record;
    record.source = "live";
    record.created = iso_time(wall_ns());
    record.time_taken_s = static_cast<double>(steady_ns() - begin) * 1e-9;
  } catch (const std::exception& error) {
    note_refusal(axis, std::string("no model was found: ") + error.what());
    return;
  }
  // What may not be used need not be judged.
  Candidacy candidacy;
  candidacy.rotary = state.rotary;
  candidacy.refusals = candidate.identified.refusals;
  // What the motion did not show, a person may overlook; a machine left alone may not.
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
  say(axis, "judging");
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
          "the motion to judge it on is not remembered any more; the processor is too busy");
    }
    const std::vector<Segment> unseen =
        segment_axis(memory_.copy(axis, candidate.until_s, until_s, "live"), state.name).segments;
    // The same samples for both.
    const double skip_s =
        std::max(starting_state_s(model), other != nullptr ? starting_state_s(*other) : 0.0);
    candidate.identified.record.holdout = left_by(&model, unseen, skip_s);
    candidacy.rms = candidate.identified.record.holdout.rms;
    candidacy.rms_in_force = left_by(other, unseen, skip_s).rms;
  } catch (const std::exception& error) {
    note_refusal(axis, std::string("a candidate was not judged: ") + error.what());
    return;
  }
  rule(axis, candidate, candidacy);
}

void IdentificationWorker::rule(std::size_t axis, const Pending& candidate,
                                const Candidacy& candidacy) {
  Axis& state = axes_[axis];
  const Decision decision = decide(candidacy, {config_.judge_s, config_.min_improvement});
  StoredModel model{candidate.identified.record, decision.reason};
  if (!decision.promoted()) {
    note_refusal(axis, "candidate refused: " + decision.reason, to_json(model.record).dump());
    return;
  }
  const int next = candidacy.version_in_force + 1;
  const Event event =
      event_now("model_promoted", state.name,
                "model " + std::to_string(next) + " is in force: " + decision.reason);
  try {
    store_.promote(model.record, event);
  } catch (const std::runtime_error& error) {
    events_.error(
        "not_stored", state.name,
        std::string(
            "a better model was found and is not put in force, because it cannot be stored: ") +
            error.what());
    return;
  }
  put_in_force(axis, model);
  events_.print(event);
}

void IdentificationWorker::put_in_force(std::size_t axis, const StoredModel& model) {
  const ModelRecord& record = model.record;
  in_force_[axis].publish(
      {Twin(record.model), record.version, record.holdout.rms, settling_cycles(record.model)});
  axes_[axis].in_force = model;
  {
    const std::lock_guard lock(status_mutex_);
    status_[axis].model_version = record.version;
    status_[axis].holdout_rms = record.holdout.rms;
  }
  announce_(model);
}

void IdentificationWorker::finish() {
  for (std::size_t axis = 0; axis < axes_.size(); ++axis) {
    while (look(axis)) {
    }
    if (!axes_[axis].candidate) continue;
    const double judged_s = memory_.moved_s(axis) - axes_[axis].candidate->moved_s;
    note_refusal(axis, "a candidate stays undecided: " +
                           progress_of("judged on", judged_s, config_.judge_s));
    axes_[axis].candidate.reset();
  }
}

void IdentificationWorker::update(std::vector<AxisStatus>& status) const {
  const std::unique_lock lock(status_mutex_, std::try_to_lock);
  if (lock.owns_lock()) status = status_;
}

void IdentificationWorker::say(std::size_t axis, const std::string& activity) {
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

}  // namespace servotwin
