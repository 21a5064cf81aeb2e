#include "daemon/loop/scheduling.h"

#include <pthread.h>
#include <sched.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <sys/sysinfo.h>

#include <cerrno>
#include <cstring>
#include <thread>

namespace servotwin::daemon {

std::string become_real_time(int priority) {
  if (priority == 0) return {};
  sched_param parameter{};
  parameter.sched_priority = priority;
  const int error = pthread_setschedparam(pthread_self(), SCHED_FIFO, &parameter);
  if (error == 0) return {};
  return "the real-time loop runs at normal priority: " + std::string(std::strerror(error)) +
         "; needs CAP_SYS_NICE or LimitRTPRIO=" + std::to_string(priority);
}

std::string real_time_refused(int priority) {
  std::string why;
  std::thread([&] { why = become_real_time(priority); }).join();
  return why;
}

std::string keep_to(const std::vector<int>& cpus) {
  if (cpus.empty()) return {};
  cpu_set_t set;
  CPU_ZERO(&set);
  std::string list;
  for (const int cpu : cpus) {
    CPU_SET(static_cast<std::size_t>(cpu), &set);
    list += (list.empty() ? "" : ", ") + std::to_string(cpu);
  }
  const int error = pthread_setaffinity_np(pthread_self(), sizeof set, &set);
  if (error == 0) {
    // The kernel ignores processors that do not exist without an error.
    const std::vector<int> missing = missing_processors(cpus);
    return missing.empty() ? std::string()
                           : "real_time.cpus = [" + list + "]: there is no processor " +
                                 std::to_string(missing.front()) + " on this host";
  }
  return "loop, publisher and DDS run on any processor: real_time.cpus = [" + list +
         "]: " + std::strerror(error) + "; /proc/self/status names those that are allowed";
}

WhileKeptTo::WhileKeptTo(const std::vector<int>& cpus) {
  if (cpus.empty() || pthread_getaffinity_np(pthread_self(), sizeof before_, &before_) != 0) return;
  kept_ = true;  // by some of them, if not by all
  (void)keep_to(cpus);
}

WhileKeptTo::~WhileKeptTo() {
  if (kept_) (void)pthread_setaffinity_np(pthread_self(), sizeof before_, &before_);
}

std::vector<int> missing_processors(const std::vector<int>& cpus) {
  const int there = get_nprocs_conf();
  std::vector<int> missing;
  for (const int cpu : cpus) {
    if (cpu >= there) missing.push_back(cpu);
  }
  return missing;
}

std::string become_idle() {
  const sched_param parameter{};
  const int error = pthread_setschedparam(pthread_self(), SCHED_IDLE, &parameter);
  if (error == 0) return {};
  return "background work runs at normal priority: " + std::string(std::strerror(error));
}

void restore_normal_priority(pthread_t thread) noexcept {
  const sched_param parameter{};
  (void)pthread_setschedparam(thread, SCHED_OTHER, &parameter);
}

void name_thread(const char* name) { pthread_setname_np(pthread_self(), name); }

void prefault_stack() noexcept {
  constexpr std::size_t kStackToTouch_bytes =
      128 * 1024;  // of 8 MB; with two copies of a twin the loop needs 60 kB
  constexpr std::size_t kPage_bytes = 4096;
  volatile char stack[kStackToTouch_bytes];
  for (std::size_t i = 0; i < kStackToTouch_bytes; i += kPage_bytes) stack[i] = 0;
  (void)stack[0];
}

std::string lock_memory() {
  // Not with a limit: MCL_FUTURE would make later allocations fail once the limit is reached.
  rlimit limit{};
  getrlimit(RLIMIT_MEMLOCK, &limit);
  if (limit.rlim_cur != RLIM_INFINITY) {
    return "memory is not locked: the limit is " + std::to_string(limit.rlim_cur / 1024) +
           " kB; needs LimitMEMLOCK=infinity";
  }
  // MCL_ONFAULT: only touched pages are locked, not the whole stacks of all workers.
  if (mlockall(MCL_CURRENT | MCL_FUTURE | MCL_ONFAULT) == 0) return {};
  return "memory is not locked: " + std::string(std::strerror(errno));
}

}  // namespace servotwin::daemon
