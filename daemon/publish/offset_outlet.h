// The publisher's rule for live offsets on their way to drives (docs/decisions/0011).
//
// An offset that is late, or that waits behind another one, would come in a later cycle of the
// drive than it is meant for, or as the second one in a cycle. It does not leave, and neither does
// any later one of its stream: the drive would have to jump to it. The loop is told
// (OffsetHandOver::interrupted), withdraws the run and begins another stream when the drive has
// certainly reached 0. Offsets on which no drive depends are only dropped if they are late. One
// thread, that of the publisher; no function locks or allocates.
#pragma once

#include <cstdint>

#include "daemon/between/offset_plan.h"
#include "daemon/between/ring.h"

namespace servotwin::daemon {

class OffsetOutlet {
 public:
  OffsetOutlet(Ring<DatedOffset>& offsets, OffsetHandOver& hand_over)
      : offsets_(offsets), hand_over_(hand_over) {}

  /// Sends what waits. `now_ns()`: steady clock [ns]. `write(offset)`: false if it did not leave.
  template <class Now, class Write>
  void send(const Now& now_ns, const Write& write) {
    while (offsets_.pop(next_)) {
      const std::int64_t until_ns = next_.leaves_until_ns;
      if (next_.stream == 0) {
        if (now_ns() <= until_ns) write(next_.offset);
        continue;
      }
      // relaxed, here and below: the flags order no other data.
      if (next_.stream <= hand_over_.interrupted.load(std::memory_order_relaxed)) continue;
      const bool due = now_ns() <= until_ns && offsets_.waiting() == 0 &&
                       !hand_over_.standby.load(std::memory_order_relaxed);
      // It may also be held up on its way out.
      if (!due || !write(next_.offset) || now_ns() > until_ns)
        hand_over_.interrupted.store(next_.stream, std::memory_order_relaxed);
    }
  }

 private:
  Ring<DatedOffset>& offsets_;
  OffsetHandOver& hand_over_;
  DatedOffset next_;
};

}  // namespace servotwin::daemon
