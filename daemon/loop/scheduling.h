// How important a thread is. Each function acts on the calling thread and returns why it could not,
// with what to do; empty if it could. A daemon without these rights works, with a less certain
// latency.
#pragma once

#include <pthread.h>

#include <string>
#include <vector>

namespace servotwin::daemon {

/// SCHED_FIFO at this priority (1..98); 0: nothing is done.
[[nodiscard]] std::string become_real_time(int priority);
/// Why a thread of this process could not become a real-time one at this priority; empty if it
/// could. The calling thread stays what it is.
[[nodiscard]] std::string real_time_refused(int priority);
/// Only on these processors; none: on all.
[[nodiscard]] std::string keep_to(const std::vector<int>& cpus);
/// Of these processors those that this host does not have.
[[nodiscard]] std::vector<int> missing_processors(const std::vector<int>& cpus);
/// SCHED_IDLE: runs only where nobody else wants to.
[[nodiscard]] std::string become_idle();
/// Another thread that became idle runs as all others do, where that is permitted.
void hasten(pthread_t thread) noexcept;
/// The name that top and gdb show; at most 15 characters.
void name_thread(const char* name);
/// No page of the process is swapped out once it has been touched.
[[nodiscard]] std::string lock_memory();
/// Touches the stack that the real-time loop may come to use, so that it is in memory.
void prefault_stack() noexcept;

}  // namespace servotwin::daemon
