#include "daemon/publish/status_figures.h"

#include <cmath>
#include <nlohmann/json.hpp>

#include "identification/model/json_number.h"

namespace servotwin::daemon {

using nlohmann::json;

json figures_of(const MachineStatus& status) {
  json out = {{"frame_rate_hz", number_or_null(status.frame_rate_hz)},
              {"wake_p50_s", number_or_null(status.wake_p50_s)},
              {"wake_p99_s", number_or_null(status.wake_p99_s)},
              {"work_p50_s", number_or_null(status.work_p50_s)},
              {"work_p99_s", number_or_null(status.work_p99_s)},
              {"work_max_s", number_or_null(status.work_max_s)},
              {"last_error", status.last_error}};
  for (const StatusCounter& counter : kStatusCounters) out[counter.key] = status.*counter.count;
  return out;
}

}  // namespace servotwin::daemon
