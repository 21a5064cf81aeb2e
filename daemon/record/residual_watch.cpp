#include "daemon/record/residual_watch.h"

#include <cmath>
#include <utility>

#include "diagnosis/statistics/text.h"
#include "twin/shown_units.h"

namespace servotwin::daemon {

ResidualWatch::ResidualWatch(const MachineDescription& machine, const DiagnoseConfig& config,
                             EventLog& events)
    : false_alarm_days_(config.false_alarm_days),
      events_(events),
      raised_(machine.axes.size()),
      states_(machine.axes.size()) {
  if (false_alarm_days_ <= 0.0) return;
  for (std::atomic<AlarmState>& state : states_) state = AlarmState::kLearning;
  const AlarmOptions options{86400.0 * false_alarm_days_, config.reference_s};
  for (const AxisDescription& axis : machine.axes)
    axes_.push_back({axis.name, axis.rotary, ResidualAlarm(options, machine.cycle_s)});
}

void ResidualWatch::append(const CycleRow& row) {
  for (std::size_t i = 0; i < axes_.size(); ++i) {
    Axis& axis = axes_[i];
    const double command = row.axes[i].command;
    const double before = std::exchange(axis.last_command, command);
    // A change from or to a command that is not finite does not count as motion.
    const bool moves =
        !row.after_gap && std::isfinite(command) && std::isfinite(before) && command != before;
    if (!moves) continue;
    if (const std::optional<AlarmChange> change = axis.alarm.add(row.residuals[i]))
      report(i, *change);
  }
}

void ResidualWatch::report(std::size_t axis, const AlarmChange& change) {
  const Axis& state = axes_[axis];
  const char* unit = micro(state.rotary);
  const std::string rms = text("%.3g %s RMS", 1e6 * change.rms, unit),
                    normal = text("%.3g %s", 1e6 * change.reference_rms, unit);
  switch (change.kind) {
    case AlarmChange::Kind::kRaised: {
      const std::string what = "the residual has grown: " + rms +
                               text(" over the last %.0f s of motion", change.motion_s) +
                               ", normal is " + normal;
      events_.note("alarm_raised", state.name,
                   "alarm: " + what +
                       text(" (CUSUM above %.1f; on average one false alarm in %g days of motion)",
                            change.threshold, false_alarm_days_));
      states_[axis] = AlarmState::kRaised;
      const std::lock_guard lock(mutex_);
      raised_[axis] = what;
      return;
    }
    case AlarmChange::Kind::kBack: {
      events_.note("alarm_cleared", state.name,
                   "alarm over: the residual is back at its normal " + normal + "; it was " + rms +
                       text(" over %.0f s of motion", change.motion_s));
      states_[axis] = AlarmState::kWatching;
      return;
    }
    case AlarmChange::Kind::kReference: {
      if (change.ended)
        events_.note("alarm_cleared", state.name,
                     "alarm over: the model in force has a reference of its own");
      events_.note(
          "alarm_reference", state.name,
          text("the residual is monitored: %s RMS is normal, learned from %.0f s of motion",
               normal.c_str(), change.motion_s));
      states_[axis] = AlarmState::kWatching;
      return;
    }
  }
}

std::optional<std::string> ResidualWatch::take_alarm(std::size_t axis) {
  const std::lock_guard lock(mutex_);
  return std::exchange(raised_[axis], std::nullopt);
}

void ResidualWatch::ask(std::size_t axis, const std::string& why) {
  const std::lock_guard lock(mutex_);
  if (!raised_[axis]) raised_[axis] = why;
}

}  // namespace servotwin::daemon
