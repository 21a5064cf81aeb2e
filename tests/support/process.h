// A program run by a test as a user starts it: its output and its exit status.
#pragma once

#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <cstdlib>
#include <filesystem>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

namespace servotwin::test {

// Generous for a busy host; normally nothing waits that long.
inline constexpr double kPatience_s = 60.0;

/// A program that was built with this test.
inline std::string built(const std::string& name) {
  return std::filesystem::read_symlink("/proc/self/exe").parent_path() / name;
}

using Environment = std::vector<std::pair<std::string, std::string>>;

struct ProcessOptions {
  Environment environment{};    ///< beyond the test's
  std::string output{};         ///< a file that standard output goes to; empty: it is heard here
  void (*prepare)() = nullptr;  ///< what the process does before it becomes the program
};

/// Ended with this object, if it has not come to its end before.
class Process {
 public:
  /// The program, one that was built with this test or of the system, and its arguments.
  explicit Process(std::vector<std::string> words, const ProcessOptions& options = {}) {
    if (words[0].find('/') == std::string::npos && std::filesystem::exists(built(words[0])))
      words[0] = built(words[0]);
    int ends[2];
    if (pipe2(ends, O_CLOEXEC) != 0) throw std::runtime_error("pipe");
    out_ = ends[0];
    std::vector<char*> argv;
    argv.reserve(words.size() + 1);
    for (std::string& word : words) argv.push_back(word.data());
    argv.push_back(nullptr);
    id_ = fork();
    if (id_ == 0) {
      const std::string& file = options.output;
      const int output =
          file.empty() ? ends[1] : open(file.c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0600);
      dup2(output, STDOUT_FILENO);
      dup2(ends[1], STDERR_FILENO);
      for (const auto& [name, value] : options.environment) setenv(name.c_str(), value.c_str(), 1);
      if (options.prepare != nullptr) options.prepare();
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

  [[nodiscard]] pid_t id() const { return id_; }
  /// Reads until the output contains `text`; false if the program ends before, or prints nothing
  /// for `timeout_s`.
  bool says(const std::string& text, double timeout_s = kPatience_s) {
    while (said_.find(text) == std::string::npos) {
      if (!read_more(static_cast<int>(1e3 * timeout_s))) return false;
    }
    return true;
  }
  /// The output so far.
  const std::string& said() {
    while (read_more(0)) {
    }
    return said_;
  }
  void send(int signal) const { kill(id_, signal); }
  /// Waits for its end, after this signal if it is one: the exit status, or 128 + the signal that
  /// ended it.
  int end(int signal = 0) {
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

}  // namespace servotwin::test
