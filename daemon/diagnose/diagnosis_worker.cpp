#include "daemon/diagnose/diagnosis_worker.h"

#include <algorithm>
#include <nlohmann/json.hpp>
#include <set>
#include <thread>
#include <utility>

#include "daemon/between/clock.h"
#include "daemon/store/report_file.h"
#include "diagnosis/report/diagnosis_file.h"
#include "diagnosis/report/in_short.h"
#include "diagnosis/report/report.h"
#include "diagnosis/report/torque_text.h"
#include "diagnosis/search/acting_axis.h"
#include "diagnosis/statistics/text.h"
#include "identification/least_squares/interruption.h"
#include "identification/recording/segments.h"

namespace servotwin::daemon {
namespace {

constexpr double kMinOffTime_s = 0.5;  // without a cycle: the machine was off
constexpr auto kDiagnosisPause = std::chrono::milliseconds(100);
// Minimum motion in memory as a share of record_s; less would show too little.
constexpr double kMinMotionShare = 0.5;

/// The line of the event. Every cause is named once; the findings from the torque are given beside
/// those from the position, because two ripples may be two different ones.
std::string line_of(const Diagnosis& diagnosis, const TorqueDiagnosis& torque) {
  std::string line = verdict_text(diagnosis);
  std::set<std::string> named;
  for (const Cause& cause : diagnosis.causes) {
    line += "; " + cause.id + ": " + cause_text(diagnosis, cause);
    if (const std::string also = torque_beside(torque, cause.id); !also.empty())
      line += ", " + also;
    named.insert(cause.id);
  }
  for (const Cause& cause : diagnosis.suspected) line += "; suspected " + cause.id;
  for (const TorqueCause& cause : torque.causes) {
    if (named.insert(cause.id).second) line += "; by torque " + cause.id;
  }
  return line;
}

}  // namespace

DiagnosisWorker::DiagnosisWorker(const MachineDescription& machine, const DiagnoseConfig& config,
                                 const IdentifyConfig& identify, const MotionMemory& memory,
                                 ResidualWatch& watch, Store& store, EventLog& events,
                                 Announce announce)
    : config_(config),
      memory_(memory),
      watch_(watch),
      store_(store),
      events_(events),
      announce_(std::move(announce)) {
  options_.identify.bounds = identify.options.bounds;
  options_.identify.delay_max_s = identify.options.delay_max_s;
  for (const AxisDescription& axis : machine.axes) axes_.push_back({axis.name, {}, {}});
}

void DiagnosisWorker::restore() {
  for (const Axis& axis : axes_) {
    for (const StoredDiagnosis& last : store_.diagnoses(axis.name, 1)) announce_(last);
  }
}

void DiagnosisWorker::run(const std::stop_token& stop) {
  const auto ends = [&] { return stop.stop_requested() || give_up_.stop_requested(); };
  while (!ends()) {
    bool any = false;
    for (std::size_t axis = 0; axis < axes_.size() && !ends(); ++axis) any = look(axis) || any;
    if (!any) std::this_thread::sleep_for(kDiagnosisPause);
  }
}

void DiagnosisWorker::reconfigure(const DiagnoseConfig& config, const IdentifyConfig& identify) {
  const std::lock_guard lock(config_mutex_);
  newer_config_ = {config, identify};
}

void DiagnosisWorker::take_newer_config() {
  const std::lock_guard lock(config_mutex_);
  if (!newer_config_) return;
  const auto& [diagnose, identify] = *newer_config_;
  config_ = diagnose;
  options_.identify.bounds = identify.options.bounds;
  options_.identify.delay_max_s = identify.options.delay_max_s;
  newer_config_.reset();
}

bool DiagnosisWorker::look(std::size_t axis) {
  take_newer_config();
  return look(axis, config_.record_s);
}

void DiagnosisWorker::finish(const std::stop_token& stop) {
  for (std::size_t axis = 0; axis < axes_.size() && !stop.stop_requested(); ++axis)
    look(axis, kMinMotionShare * config_.record_s);
}

bool DiagnosisWorker::look(std::size_t axis, double least_motion_s) {
  Axis& state = axes_[axis];
  if (std::optional<std::string> alarm = watch_.take_alarm(axis)) state.alarm = std::move(alarm);
  const double now_s = memory_.newest_s(), moved_s = memory_.moved_s(axis);
  const bool on_schedule = config_.every_s > 0.0 &&
                           (!state.diagnosed_s || now_s - *state.diagnosed_s >= config_.every_s);
  if (!state.alarm && !on_schedule) return false;
  if (moved_s - state.moved_s < least_motion_s) return false;
  const std::optional<double> least_from_s =
      memory_.time_when_moved(axis, moved_s - kMinMotionShare * config_.record_s);
  if (!least_from_s || *least_from_s <= memory_.oldest_s()) return false;
  const std::optional<double> from_s = memory_.time_when_moved(axis, moved_s - config_.record_s);
  const std::string reason = state.alarm ? *state.alarm : "on schedule";
  state.alarm.reset();
  state.diagnosed_s = now_s;
  state.moved_s = moved_s;
  diagnose_now(axis, reason, *from_s, now_s);
  return true;
}

void DiagnosisWorker::diagnose_now(std::size_t axis, const std::string& reason, double from_s,
                                   double until_s) {
  const std::string& name = axes_[axis].name;
  events_.note("diagnosis_begun", name, "diagnosis begun, " + reason);
  const Interruptible until(give_up_);
  try {
    const std::int64_t begin = steady_ns();
    // With the other axes, because their motion may disturb this one.
    const Recording recorded = memory_.copy(from_s, until_s, "the motion in memory");
    SegmentedAxis motion = segment_axis(recorded, name, {}, acting_axis(recorded, name).name);
    // By its motion only where a model predicts that, as the candidate will be judged.
    const std::vector<StoredModel> in_force = store_.in_force();
    if (std::none_of(in_force.begin(), in_force.end(),
                     [&](const StoredModel& one) { return one.record.axis == motion.neighbour; })) {
      for (Segment& segment : motion.segments) segment.neighbour_motion.resize(0);
    }
    // A long pause means that the machine was off: that is not a loss of cycles.
    std::erase_if(motion.report.splits,
                  [](const auto& split) { return split.length_s > kMinOffTime_s; });
    const auto own = config_.encoder_in_loop_of.find(name);
    options_.encoder_in_loop =
        own == config_.encoder_in_loop_of.end() ? config_.encoder_in_loop : own->second;
    Diagnosis diagnosis = diagnose(motion, options_);
    std::optional<TorqueDiagnosis> torque = torque_of(motion);
    if (torque) heed(*torque, diagnosis);
    const double taken_s = 1e-9 * static_cast<double>(steady_ns() - begin);
    const Event event =
        event_now("diagnosis", name,
                  text("diagnosis of %.1f s, made in %.1f s: ", motion.report.duration_s, taken_s) +
                      line_of(diagnosis, torque.value_or(TorqueDiagnosis())));
    diagnosis.extended.created = event.time;
    nlohmann::json json = to_json(diagnosis, "");
    if (torque) add_torque(json, *torque);
    json["in_short"] = in_short(diagnosis, torque);
    json["created"] = event.time;
    json["reason"] = reason;
    keep_report(name,
                report_html(diagnosis, motion.segments, "live data until " + event.time, torque));
    keep({event.time, name, reason, json.at("verdict").get<std::string>(), json.dump(),
          to_json(diagnosis.extended).dump()},
         event);
    propose(axis, diagnosis, from_s, until_s);
  } catch (const Interrupted&) {
    events_.note("diagnosis_given_up", name, "the diagnosis is given up, because the daemon stops");
  } catch (const std::exception& error) {
    events_.note("diagnosis_failed", name, std::string("no diagnosis: ") + error.what());
  }
}

void DiagnosisWorker::propose(std::size_t axis, const Diagnosis& diagnosis, double from_s,
                              double until_s) const {
  // What the baseline has already, the identification finds by itself.
  if (!propose_ || diagnosis.extended.method != "diagnosis") return;
  const std::vector<Effect>& effects = diagnosis.extended.model.effects;
  std::string with;
  for (const Cause& cause : diagnosis.causes) {
    if (cause.place < effects.size()) with += (with.empty() ? "with " : ", ") + cause.id;
  }
  const auto of_its_recording = [](const Effect& effect) {
    return identity_of(effect.kind).of_its_recording;
  };
  const auto found = std::find_if(effects.begin(), effects.end(), of_its_recording);
  if (with.empty()) return;
  if (found == effects.end()) {
    propose_(axis, diagnosis.extended, with + ", as the diagnosis found", from_s, until_s);
  } else {
    events_.note("model_not_proposed", axes_[axis].name,
                 "the model " + with +
                     " is not put forward: " + std::string(identity_of(found->kind).id) +
                     " is of its recording and predicts no other motion");
  }
}

std::optional<TorqueDiagnosis> DiagnosisWorker::torque_of(const SegmentedAxis& motion) {
  if (!has_torque(motion)) return std::nullopt;
  try {
    return diagnose_torque(motion, options_);
  } catch (const std::runtime_error& error) {
    events_.note("torque_not_explained", motion.axis, error.what());
    return std::nullopt;
  }
}

void DiagnosisWorker::keep_report(const std::string& axis, const std::string& html) {
  try {
    write_report(store_.directory(), store_.machine(), axis, html);
  } catch (const std::runtime_error& error) {
    events_.error("not_stored", axis, error.what());
  }
}

void DiagnosisWorker::keep(const StoredDiagnosis& diagnosis, const Event& event) {
  events_.print(event);
  try {
    store_.add(diagnosis, event);
  } catch (const std::runtime_error& error) {
    events_.error(
        "not_stored", diagnosis.axis,
        std::string("the diagnosis is published but could not be stored: ") + error.what());
  }
  announce_(diagnosis);
}

}  // namespace servotwin::daemon
