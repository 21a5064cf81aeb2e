// How important a thread is. Each function acts on the calling thread and returns why it could not,
// with what to do; empty if it could. A daemon without these rights works, with a less certain
// latency.
#pragma once

#include <string>

namespace servotwin {

/// SCHED_FIFO at this priority (1..98); 0: nothing is done.
[[nodiscard]] std::string become_real_time(int priority);
/// SCHED_IDLE: runs only where nobody else wants to.
[[nodiscard]] std::string become_idle();
/// The name that top and gdb show; at most 15 characters.
void name_thread(const char* name);
/// No page of the process is swapped out once it has been touched.
[[nodiscard]] std::string lock_memory();

}  // namespace servotwin
