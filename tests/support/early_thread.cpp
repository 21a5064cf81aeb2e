// A thread that blocks no signal and is there before main(), as libraries of linear algebra have
// them, for a program that is started with this library preloaded.
#include <pthread.h>
#include <signal.h>
#include <unistd.h>

namespace {

void* wait_for_ever(void*) {
  for (;;) pause();
}

[[gnu::constructor]] void begin() {
  pthread_t thread;
  pthread_create(&thread, nullptr, wait_for_ever, nullptr);
}

}  // namespace
