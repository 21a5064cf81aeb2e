// The residual alarms of all axes (daemon/residual_alarm.h): fed by the recorder, asked by the
// diagnosis worker. Alarms are events the moment they come, however busy the diagnosis is.
//
// An axis moves where its command changes from cycle to cycle, as in daemon/motion_memory.h.
// append() one thread, take_alarm() another.
#pragma once

#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "daemon/config.h"
#include "daemon/event_log.h"
#include "daemon/real_time_loop.h"
#include "daemon/residual_alarm.h"
#include "drivers/messages.h"

namespace servotwin {

class ResidualWatch {
 public:
  ResidualWatch(const MachineDescription& machine, const DiagnoseConfig& config, EventLog& events);

  void append(const CycleRow& row);
  /// What the alarm says that was raised since this was last asked; nothing if none was.
  [[nodiscard]] std::optional<std::string> take_alarm(std::size_t axis);

 private:
  struct Axis {
    std::string name;
    bool rotary = false;
    ResidualAlarm alarm;
    double last_command = kAbsent;
  };
  void say(std::size_t axis, const AlarmChange& change);

  double false_alarm_days_;
  EventLog& events_;
  std::vector<Axis> axes_;  // none where there is no alarm
  std::mutex mutex_;
  std::vector<std::optional<std::string>> raised_;
};

}  // namespace servotwin
