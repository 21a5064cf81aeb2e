// How often a fault of the input that goes on is reported.
#pragma once

#include <cstdint>

namespace servotwin::daemon {

inline constexpr std::int64_t kReportPeriod_ns = 60'000'000'000;

}  // namespace servotwin::daemon
