#include "identification/least_squares/parallel.h"

#include <malloc.h>

#include <algorithm>
#include <atomic>
#include <exception>
#include <thread>
#include <vector>

#include "identification/least_squares/interruption.h"

namespace servotwin {

namespace {

std::atomic<std::size_t> allowed{1};
thread_local bool inside_worker = false;

}  // namespace

void use_threads(std::size_t count) { allowed = std::max<std::size_t>(1, count); }

void keep_freed_memory() {
  constexpr int kKept_B = 512 << 20;    // at most
  constexpr int kLargest_B = 32 << 20;  // of one piece; the largest that glibc allows here
  constexpr int kGrowth_B = 16 << 20;   // asked for at once
  ::mallopt(M_TRIM_THRESHOLD, kKept_B);
  ::mallopt(M_MMAP_THRESHOLD, kLargest_B);
  ::mallopt(M_TOP_PAD, kGrowth_B);
}

void in_parallel(std::size_t count, const std::function<void(std::size_t)>& work) {
  const std::size_t threads = inside_worker ? 1 : std::min(allowed.load(), count);
  if (threads <= 1) {
    for (std::size_t i = 0; i < count; ++i) {
      throw_if_interrupted();
      work(i);
    }
    return;
  }
  std::atomic<std::size_t> next{0};
  std::vector<std::exception_ptr> thrown(count);
  const auto take = [&, stop = interruption()] {
    const Interruptible until(stop);
    inside_worker = true;
    for (std::size_t i = next++; i < count; i = next++) {
      try {
        throw_if_interrupted();
        work(i);
      } catch (...) {
        thrown[i] = std::current_exception();
      }
    }
    inside_worker = false;
  };
  {
    std::vector<std::jthread> others;
    for (std::size_t i = 1; i < threads; ++i) others.emplace_back(take);
    take();
  }
  throw_if_interrupted();
  for (const std::exception_ptr& one : thrown) {
    if (one) std::rethrow_exception(one);
  }
}

}  // namespace servotwin
