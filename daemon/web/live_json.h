// The JSON of the current state for the page and for programs: servotwin.status/1 and
// servotwin.live/1.
//
// A missing number is null. Any thread; errors: none.
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>

#include "daemon/between/histogram.h"
#include "daemon/publish/live_feed.h"
#include "drivers/common/messages.h"

namespace servotwin::daemon {

/// servotwin.status/1. `machine` without axes: not known yet. `alarms`: one per axis.
[[nodiscard]] nlohmann::json status_json(const LiveStatus& live, const MachineDescription& machine,
                                         const std::vector<AlarmState>& alarms);

/// Octaves of duration that are given here and in /metrics: 2^10 ns (1.024 us) to 2^30 ns (1.07 s).
inline constexpr int kFirstOctave = 10, kLastOctave = 30;

/// The octaves of a histogram from the first to the last non-empty one: [{"below_s", "count"}, ..];
/// the last one may have no bound.
[[nodiscard]] nlohmann::json octaves_json(const Histogram& histogram);

/// servotwin.live/1 on one line, errors to 7 digits.
[[nodiscard]] std::string batch_json(const LiveBatch& batch);

[[nodiscard]] const char* name_of(AlarmState state) noexcept;
[[nodiscard]] const char* state_name(DaemonState state) noexcept;
[[nodiscard]] const char* state_name(AxisState state) noexcept;

}  // namespace servotwin::daemon
