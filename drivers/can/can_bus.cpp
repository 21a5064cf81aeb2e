#include "drivers/can/can_bus.h"

namespace servotwin {

CanBusCounts CanBus::counts() const noexcept {
  const auto read = [](const auto& counter) { return counter.load(std::memory_order_relaxed); };
  return {read(counters_.received),  read(counters_.dropped), read(counters_.lost),
          read(counters_.malformed), read(counters_.sent),    read(counters_.not_sent),
          read(counters_.downs),     read(counters_.up)};
}

}  // namespace servotwin
