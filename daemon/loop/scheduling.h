// Priority, processors and memory of threads. The functions that return a text act on the calling
// thread and return why they failed and what to do; empty if they succeeded. A daemon without these
// rights works, but its latency is not guaranteed.
#pragma once

#include <pthread.h>
#include <sched.h>

#include <string>
#include <vector>

namespace servotwin::daemon {

/// Switches to SCHED_FIFO at this priority (1..98); 0: does nothing.
[[nodiscard]] std::string become_real_time(int priority);
/// Why a thread of this process cannot become a real-time thread at this priority; empty if it can.
/// The calling thread is not changed.
[[nodiscard]] std::string real_time_refused(int priority);
/// Runs only on these processors; an empty list: on all.
[[nodiscard]] std::string keep_to(const std::vector<int>& cpus);
/// While it lives, the calling thread runs only on these processors, and so do the threads that it
/// begins: for as long as they live. An empty list, one that is not allowed, or processors that are
/// not known: nothing changes.
class WhileKeptTo {
 public:
  explicit WhileKeptTo(const std::vector<int>& cpus);
  WhileKeptTo(const WhileKeptTo&) = delete;
  WhileKeptTo& operator=(const WhileKeptTo&) = delete;
  ~WhileKeptTo();

 private:
  cpu_set_t before_{};
  bool kept_ = false;
};
/// Those of these processors that this host does not have.
[[nodiscard]] std::vector<int> missing_processors(const std::vector<int>& cpus);
/// Switches to SCHED_IDLE: the thread runs only when no other thread needs the processor.
[[nodiscard]] std::string become_idle();
/// Gives another thread, which had become idle, normal priority again, if that is permitted.
void restore_normal_priority(pthread_t thread) noexcept;
/// Sets the name that top and gdb show, at most 15 characters.
void name_thread(const char* name);
/// Locks memory: a page of the process is never swapped out once it has been touched.
[[nodiscard]] std::string lock_memory();
/// Touches the stack that the real-time loop may need, so that it is in memory.
void prefault_stack() noexcept;

}  // namespace servotwin::daemon
