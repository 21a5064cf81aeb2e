#include "daemon/publish/status_figures.h"

#include <cmath>
#include <nlohmann/json.hpp>

namespace servotwin::daemon {

using nlohmann::json;

json number_json(double value) { return std::isfinite(value) ? json(value) : json(); }

json figures_of(const MachineStatus& status) {
  json out = {{"frame_rate_hz", number_json(status.frame_rate_hz)},
              {"wake_p50_s", number_json(status.wake_p50_s)},
              {"wake_p99_s", number_json(status.wake_p99_s)},
              {"work_p50_s", number_json(status.work_p50_s)},
              {"work_p99_s", number_json(status.work_p99_s)},
              {"work_max_s", number_json(status.work_max_s)},
              {"last_error", status.last_error}};
  for (const StatusCounter& counter : kStatusCounters) out[counter.key] = status.*counter.count;
  return out;
}

}  // namespace servotwin::daemon
