// The counters of a status in one table, so that the page, /metrics, the terminal and JSON give the
// same figures. Any thread; errors: none.
#pragma once

#include <array>
#include <cstdint>
#include <nlohmann/json_fwd.hpp>

#include "drivers/common/messages.h"

namespace servotwin::daemon {

struct StatusCounter {
  const char* key;     ///< key in JSON
  const char* words;   ///< text on the terminal, after the number
  const char* metric;  ///< name in /metrics
  const char* help;    ///< help text in /metrics
  std::uint64_t MachineStatus::*count;
};

inline constexpr std::array<StatusCounter, 9> kStatusCounters{{
    {"frames", "frames", "frames_total", "Servo cycles received.", &MachineStatus::frames},
    {"lost", "lost", "frames_lost_total", "Servo cycles lost, by the sequence numbers.",
     &MachineStatus::lost},
    {"repeated", "repeated", "frames_repeated_total",
     "Frames with the sequence number of the one before; ignored.", &MachineStatus::repeated},
    {"malformed", "malformed", "frames_malformed_total", "Frames refused on receipt.",
     &MachineStatus::malformed},
    {"not_finite", "not finite", "not_finite_total",
     "Commands or encoder values that are not finite, summed over the axes.",
     &MachineStatus::not_finite},
    {"time_jumps", "time jumps", "time_jumps_total",
     "Time stamps or sequence numbers that go back or jump.", &MachineStatus::time_jumps},
    {"overruns", "overruns", "overruns_total",
     "Cycles in which the work of the loop took longer than the cycle.", &MachineStatus::overruns},
    {"predictions_dropped", "predictions dropped", "predictions_dropped_total",
     "Predictions not sent: the publisher was too slow, or the network refused them.",
     &MachineStatus::predictions_dropped},
    {"rows_dropped", "rows dropped", "rows_dropped_total", "Cycles that were not recorded.",
     &MachineStatus::rows_dropped},
}};

/// JSON object with counters, rates, latencies of the loop and the last error.
[[nodiscard]] nlohmann::json figures_of(const MachineStatus& status);

}  // namespace servotwin::daemon
