/* Preloaded into user-mode-linux 6.1 where the processor has AMX: it hands 2696 bytes of extended
   processor state to ptrace(PTRACE_SETREGSET), but a kernel of a processor with AMX insists on the
   full area. This completes what is handed over from what the kernel itself gives; AMX stays as at
   the start. */
#define _GNU_SOURCE
#include <stdarg.h>
#include <stdint.h>
#include <string.h>
#include <sys/syscall.h>
#include <sys/uio.h>
#include <unistd.h>

enum {
  kGetRegset = 0x4204,
  kSetRegset = 0x4205,
  kXstate = 0x202,
  kFeaturesAt = 512,
  kWithoutAmx = 0x2ff
};

long ptrace(long request, ...) {
  static uint8_t state[65536] __attribute__((aligned(64)));
  static size_t size; /* of the full area */
  va_list arguments;
  va_start(arguments, request);
  const long process = va_arg(arguments, long);
  const long address = va_arg(arguments, long);
  void* data = va_arg(arguments, void*);
  va_end(arguments);

  if (request == kSetRegset && address == kXstate) {
    const struct iovec* given = data;
    struct iovec all = {state, sizeof state};
    if (size == 0 && syscall(SYS_ptrace, (long)kGetRegset, process, address, &all) == 0) {
      size = all.iov_len;
      memset(state, 0, sizeof state);
    }
    if (size > given->iov_len) {
      memcpy(state, given->iov_base, given->iov_len);
      *(uint64_t*)(state + kFeaturesAt) &= kWithoutAmx;
      all.iov_len = size;
      return syscall(SYS_ptrace, request, process, address, &all);
    }
  }
  /* The C library returns what PEEK reads, the system call writes it to where data points. */
  const int peeks = request >= 1 && request <= 3;
  long word = 0;
  const long result = syscall(SYS_ptrace, request, process, address, peeks ? (void*)&word : data);
  return peeks && result == 0 ? word : result;
}
