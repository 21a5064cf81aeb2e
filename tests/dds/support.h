// What the tests over DDS share: programs of this build as processes, and a machine for them.
#pragma once

#include <fcntl.h>
#include <gtest/gtest.h>
#include <poll.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <filesystem>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "daemon/store.h"
#include "drivers/dds.h"
#include "tests/daemon/support.h"

namespace servotwin::test {

inline constexpr double kPatience_s = 60.0;  // of a busy host; nothing waits that long otherwise

/// A program that was built with this test, or of the system; ended with this object.
class Process {
 public:
  using Environment = std::vector<std::pair<std::string, std::string>>;

  explicit Process(std::vector<std::string> words, const Environment& environment = {}) {
    if (words[0].find('/') == std::string::npos) {
      const auto built = std::filesystem::read_symlink("/proc/self/exe").parent_path() / words[0];
      if (exists(built)) words[0] = built;
    }
    int ends[2];
    if (pipe2(ends, O_CLOEXEC) != 0) throw std::runtime_error("pipe");
    out_ = ends[0];
    std::vector<char*> argv(words.size() + 1, nullptr);
    for (std::size_t i = 0; i < words.size(); ++i) argv[i] = words[i].data();
    id_ = fork();
    if (id_ == 0) {
      dup2(ends[1], STDOUT_FILENO);
      dup2(ends[1], STDERR_FILENO);
      for (const auto& [name, value] : environment) setenv(name.c_str(), value.c_str(), 1);
      execvp(argv[0], argv.data());
      _exit(127);
    }
    close(ends[1]);
  }
  Process(const Process&) = delete;
  Process& operator=(const Process&) = delete;
  ~Process() {
    if (id_ > 0) (void)end(SIGKILL);
    close(out_);
  }

  /// Reads on until it has said this; false if it does not in time.
  bool says(const std::string& text, double timeout_s = kPatience_s) {
    const auto until = std::chrono::steady_clock::now() + std::chrono::duration<double>(timeout_s);
    while (said_.find(text) == std::string::npos) {
      const auto left = std::chrono::duration_cast<std::chrono::milliseconds>(
          until - std::chrono::steady_clock::now());
      if (left.count() <= 0 || !read_more(static_cast<int>(left.count()))) return false;
    }
    return true;
  }
  /// What it has said so far.
  const std::string& said() {
    while (read_more(0)) {
    }
    return said_;
  }
  void send(int signal) const { kill(id_, signal); }
  /// Its exit status, or 128 + the signal that ended it.
  int end(int signal) {
    if (signal != 0) send(signal);
    while (read_more(-1)) {
    }
    int status = 0;
    waitpid(id_, &status, 0);
    id_ = -1;
    return WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
  }

 private:
  bool read_more(int timeout_ms) {
    pollfd waiting{out_, POLLIN, 0};
    if (poll(&waiting, 1, timeout_ms) <= 0) return false;
    char block[4096];
    const ssize_t count = read(out_, block, sizeof block);
    if (count <= 0) return false;
    said_.append(block, static_cast<std::size_t>(count));
    return true;
  }

  pid_t id_ = -1;
  int out_ = -1;
  std::string said_;
};

/// Runs a command of the shell; throws with what it said if it fails.
inline void run(const std::string& command) {
  Process process({"sh", "-c", command});
  if (const int status = process.end(0); status != 0) {
    throw std::runtime_error(command + ": " + process.said() + " (" + std::to_string(status) + ")");
  }
}

/// The command that cycle k of axis X has, and the frame of it.
inline double command_of(std::uint64_t k) { return command_at(static_cast<double>(k) * kCycle_s); }

inline MachineFrame frame_of(std::uint64_t k) {
  MachineFrame frame;
  frame.sequence = k;
  frame.time_ns = static_cast<std::int64_t>(k) * 1'000'000;
  frame.axis_count = 1;
  frame.axes[0].command = command_of(k);
  frame.axes[0].actual = frame.axes[0].command - 1e-6;
  return frame;
}

/// A store with a model of axis X in force, and the daemon's configuration beside it.
class Home {
 public:
  Home(const DdsPlace& place, const Model& model, int strength = 0,
       const std::string& reason = "for this test") {
    Store store(directory_.path() / "store", place.machine);
    ModelRecord record = record_of(model);
    store.promote(record, {"2026-01-31T12:00:00.000Z", "X", "model_promoted", reason, ""});
    std::ofstream(directory_.path() / "m.toml")
        << "[machine]\nname = '" << place.machine << "'\ncycle_s = 0.001\n[[axis]]\nname = 'X'\n"
        << "[source.dds]\ndomain = " << place.domain << "\nstrength = " << strength
        << "\n[store]\ndirectory = '" << (directory_.path() / "store").string()
        << "'\n[http]\nlisten = 'none'\n[real_time]\npriority = 0\n"
        << "[diagnose]\nevery_s = 0\nfalse_alarm_days = 0\n";
  }
  [[nodiscard]] std::vector<std::string> daemon() const {
    return {"servotwind", "--config", directory_.path() / "m.toml"};
  }
  [[nodiscard]] std::filesystem::path operator/(const std::string& name) const {
    return directory_.path() / name;
  }

 private:
  TemporaryDirectory directory_;
};

/// A machine of this process alone.
inline DdsPlace place_of(const std::string& name) {
  const auto id = static_cast<std::uint32_t>(getpid());
  return {name + "-" + std::to_string(id), 1 + id % 200, ""};
}

/// Sends frames until `done`, one per millisecond at most; the sequence number after the last one.
template <class Done>
std::uint64_t send_until(DdsWriter<MachineFrame>& frames, std::uint64_t k, const Done& done,
                         double timeout_s = kPatience_s) {
  const auto until = std::chrono::steady_clock::now() + std::chrono::duration<double>(timeout_s);
  while (!done()) {
    if (std::chrono::steady_clock::now() > until) {
      ADD_FAILURE() << "not done in " << timeout_s << " s";
      break;
    }
    frames.write(frame_of(k++));
    dds_sleepfor(DDS_MSECS(1));
  }
  return k;
}

}  // namespace servotwin::test
