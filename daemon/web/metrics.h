// The figures of the daemon as Prometheus text (exposition format 0.0.4).
//
// Counters end in _total, all figures are in SI units, histograms have one bucket per octave from
// 1 us to 1 s. Any thread; errors: none.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "daemon/between/histogram.h"
#include "daemon/publish/live_feed.h"
#include "daemon/record/residual_watch.h"
#include "drivers/common/messages.h"

namespace servotwin::daemon {

struct MetricsInput {
  std::string machine, version;
  double uptime_s = 0.0;
  LiveStatus live;
  double silent_s = kAbsent;        ///< time since the last cycle; NaN: no cycle yet
  MachineDescription description;   ///< without axes: machine not known yet
  std::vector<AlarmState> alarms;   ///< one per axis
  const Histogram* wake = nullptr;  ///< null: no loop yet
  const Histogram* work = nullptr;
  const Histogram* published = nullptr;
  double recordings_bytes = 0.0, recordings_files = 0.0;
  bool healthy = true, store_lost = false, store_damaged = false;
  std::uint64_t streams = 0, slow_streams = 0, batches_dropped = 0;
};

[[nodiscard]] std::string metrics_text(const MetricsInput& input);

}  // namespace servotwin::daemon
