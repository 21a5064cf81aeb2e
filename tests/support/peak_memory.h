// The most memory that this process has had.
#pragma once

#include <sys/resource.h>

namespace servotwin::test {

/// [KiB], resident.
inline long peak_kib() {
  struct rusage usage {};
  getrusage(RUSAGE_SELF, &usage);
  return usage.ru_maxrss;
}

}  // namespace servotwin::test
