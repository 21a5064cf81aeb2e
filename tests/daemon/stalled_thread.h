// One thread of another process, held still while the others run: what a loop that hangs looks like
// from outside.
#pragma once

#include <sys/ptrace.h>
#include <sys/wait.h>

#include <cerrno>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <stdexcept>
#include <string>

namespace servotwin::daemon {

class StalledThread {
 public:
  /// The thread of `process` that has this name. Throws std::runtime_error if it cannot be held.
  StalledThread(int process, const std::string& name) {
    const std::filesystem::path tasks = "/proc/" + std::to_string(process) + "/task";
    for (const auto& task : std::filesystem::directory_iterator(tasks)) {
      std::ifstream comm(task.path() / "comm");
      std::string its_name;
      std::getline(comm, its_name);
      if (its_name == name) thread_ = std::stoi(task.path().filename());
    }
    if (thread_ < 0) throw std::runtime_error("there is no thread '" + name + "'");
    if (ptrace(PTRACE_SEIZE, thread_, nullptr, nullptr) != 0 ||
        ptrace(PTRACE_INTERRUPT, thread_, nullptr, nullptr) != 0 ||
        waitpid(thread_, nullptr, __WALL) != thread_) {
      throw std::runtime_error(std::string("ptrace: ") + std::strerror(errno));
    }
  }
  StalledThread(const StalledThread&) = delete;
  StalledThread& operator=(const StalledThread&) = delete;
  /// The tracer must also wait for the end of the thread, or its process cannot end.
  void wait_for_its_end() const {
    int status = 0;
    while (waitpid(thread_, &status, __WALL) == thread_ && WIFSTOPPED(status)) {
    }
  }
  ~StalledThread() { ptrace(PTRACE_DETACH, thread_, nullptr, nullptr); }

 private:
  int thread_ = -1;
};

}  // namespace servotwin::daemon
