#include "tests/daemon/loop/rt/forbid_heap.h"

#include <dlfcn.h>
#include <pthread.h>
#include <semaphore.h>

#include <atomic>
#include <cstddef>

namespace servotwin::daemon {
namespace {

thread_local bool forbidden = false;
std::atomic<std::uint64_t> heap_uses{0}, lock_uses{0};

void heap_used() noexcept {
  if (forbidden) heap_uses.fetch_add(1, std::memory_order_relaxed);
}
void lock_used() noexcept {
  if (forbidden) lock_uses.fetch_add(1, std::memory_order_relaxed);
}

/// The function of that name that this file has taken the place of.
template <class Function>
Function* original(const char* name) {
  return reinterpret_cast<Function*>(dlsym(RTLD_NEXT, name));
}

}  // namespace

void forbid_heap_and_locks(bool forbid) noexcept { forbidden = forbid; }
Violations violations() noexcept { return {heap_uses.load(), lock_uses.load()}; }

}  // namespace servotwin::daemon

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)

extern "C" {
// Called by the sanitizer's own malloc and free.
void __sanitizer_malloc_hook(const volatile void*, std::size_t) { servotwin::daemon::heap_used(); }
void __sanitizer_free_hook(const volatile void*) { servotwin::daemon::heap_used(); }
}

#else

extern "C" {
// The names that glibc gives its own. NOLINTBEGIN(bugprone-reserved-identifier)
void* __libc_malloc(std::size_t size);
void* __libc_calloc(std::size_t count, std::size_t size);
void* __libc_realloc(void* pointer, std::size_t size);
void* __libc_memalign(std::size_t alignment, std::size_t size);
void __libc_free(void* pointer);
// NOLINTEND(bugprone-reserved-identifier)

// operator new and delete of libstdc++ come here too.
void* malloc(std::size_t size) {
  servotwin::daemon::heap_used();
  return __libc_malloc(size);
}
void* calloc(std::size_t count, std::size_t size) {
  servotwin::daemon::heap_used();
  return __libc_calloc(count, size);
}
void* realloc(void* pointer, std::size_t size) {
  servotwin::daemon::heap_used();
  return __libc_realloc(pointer, size);
}
void* memalign(std::size_t alignment, std::size_t size) {
  servotwin::daemon::heap_used();
  return __libc_memalign(alignment, size);
}
void* aligned_alloc(std::size_t alignment, std::size_t size) {
  servotwin::daemon::heap_used();
  return __libc_memalign(alignment, size);
}
int posix_memalign(void** pointer, std::size_t alignment, std::size_t size) {
  servotwin::daemon::heap_used();
  *pointer = __libc_memalign(alignment, size);
  return *pointer == nullptr ? 12 : 0;  // ENOMEM
}
void free(void* pointer) {
  if (pointer != nullptr) servotwin::daemon::heap_used();
  __libc_free(pointer);
}
}

#endif

extern "C" {
int pthread_mutex_lock(pthread_mutex_t* mutex) {
  static auto* const lock =
      servotwin::daemon::original<int(pthread_mutex_t*)>("pthread_mutex_lock");
  servotwin::daemon::lock_used();
  return lock(mutex);
}
int pthread_mutex_trylock(pthread_mutex_t* mutex) {
  static auto* const lock =
      servotwin::daemon::original<int(pthread_mutex_t*)>("pthread_mutex_trylock");
  servotwin::daemon::lock_used();
  return lock(mutex);
}
int pthread_rwlock_rdlock(pthread_rwlock_t* rwlock) {
  static auto* const lock =
      servotwin::daemon::original<int(pthread_rwlock_t*)>("pthread_rwlock_rdlock");
  servotwin::daemon::lock_used();
  return lock(rwlock);
}
int pthread_rwlock_wrlock(pthread_rwlock_t* rwlock) {
  static auto* const lock =
      servotwin::daemon::original<int(pthread_rwlock_t*)>("pthread_rwlock_wrlock");
  servotwin::daemon::lock_used();
  return lock(rwlock);
}
int sem_wait(sem_t* semaphore) {
  static auto* const wait = servotwin::daemon::original<int(sem_t*)>("sem_wait");
  servotwin::daemon::lock_used();
  return wait(semaphore);
}
}
