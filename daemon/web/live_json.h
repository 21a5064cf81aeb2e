// What the page and programs are told about now: servotwin.status/1 and servotwin.live/1.
//
// A number that is not there is null. Any thread.
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>

#include "daemon/residual_watch.h"
#include "daemon/web/live_feed.h"
#include "drivers/messages.h"

namespace servotwin {

/// A number for JSON: null where there is none.
[[nodiscard]] nlohmann::json number_json(double value);

/// `machine` without axes: not known yet; `alarms` one per axis.
[[nodiscard]] nlohmann::json status_json(const LiveStatus& live, const MachineDescription& machine,
                                         const std::vector<AlarmState>& alarms);

/// servotwin.live/1 on one line, errors to 7 digits.
[[nodiscard]] std::string batch_json(const LiveBatch& batch);

[[nodiscard]] const char* name_of(AlarmState state) noexcept;
[[nodiscard]] const char* state_name(DaemonState state) noexcept;
[[nodiscard]] const char* state_name(AxisState state) noexcept;

}  // namespace servotwin
