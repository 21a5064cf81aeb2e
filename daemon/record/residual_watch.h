// The residual alarms of all axes (daemon/record/residual_alarm.h): fed by the recorder, read by
// the diagnosis worker. An alarm is an event at once, even if the diagnosis worker is busy.
//
// An axis moves where its command changes from cycle to cycle, as in daemon/record/motion_memory.h.
// append() one thread, take_alarm() another, the rest any thread.
#pragma once

#include <atomic>
#include <cstdint>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "daemon/between/cycle_row.h"
#include "daemon/config/config.h"
#include "daemon/record/residual_alarm.h"
#include "daemon/store/event_log.h"
#include "drivers/common/messages.h"

namespace servotwin::daemon {

class ResidualWatch {
 public:
  ResidualWatch(const MachineDescription& machine, const DiagnoseConfig& config, EventLog& events);

  void append(const CycleRow& row);
  /// The text of the alarm, or of ask(), since the last call; nothing if there was none.
  [[nodiscard]] std::optional<std::string> take_alarm(std::size_t axis);
  /// Requests a diagnosis: take_alarm() returns `why` as if it were an alarm. Any thread.
  void ask(std::size_t axis, const std::string& why);
  /// Any thread; without waiting.
  [[nodiscard]] AlarmState state(std::size_t axis) const noexcept { return states_[axis]; }

 private:
  struct Axis {
    std::string name;
    bool rotary = false;
    ResidualAlarm alarm;
    double last_command = kAbsent;
  };
  void report(std::size_t axis, const AlarmChange& change);

  double false_alarm_days_;
  EventLog& events_;
  std::vector<Axis> axes_;  // empty if no alarm is configured
  std::mutex mutex_;
  std::vector<std::optional<std::string>> raised_;
  std::vector<std::atomic<AlarmState>> states_;
};

}  // namespace servotwin::daemon
