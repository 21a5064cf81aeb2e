// A program beside the test, as a user starts it: what it says, and how it ends.
#pragma once

#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <filesystem>
#include <stdexcept>
#include <string>
#include <vector>

namespace servotwin::test {

/// A program that was built with this test.
inline std::string built(const std::string& name) {
  return std::filesystem::read_symlink("/proc/self/exe").parent_path() / name;
}

class Process {
 public:
  /// `output`: a file that standard output goes to; empty: it is read with standard error here.
  explicit Process(std::vector<std::string> words, const std::string& output = "") {
    int ends[2];
    if (pipe2(ends, O_CLOEXEC) != 0) throw std::runtime_error("pipe");
    said_ = ends[0];
    std::vector<char*> argv;
    for (std::string& word : words) argv.push_back(word.data());
    argv.push_back(nullptr);
    id_ = fork();
    if (id_ == 0) {
      const int out =
          output.empty() ? ends[1] : open(output.c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0600);
      dup2(out, STDOUT_FILENO);
      dup2(ends[1], STDERR_FILENO);
      execvp(argv[0], argv.data());
      _exit(127);
    }
    close(ends[1]);
  }
  Process(const Process&) = delete;
  Process& operator=(const Process&) = delete;
  ~Process() {
    if (id_ > 0) (void)end(SIGKILL);
    close(said_);
  }

  /// Reads on until it has said this; false if it ends before, or is quiet for half a minute.
  bool has_said(const std::string& text) {
    while (text_.find(text) == text_.npos) {
      if (!read_more(30'000)) return false;
    }
    return true;
  }
  /// All that it has said up to now.
  const std::string& said() {
    while (read_more(0)) {
    }
    return text_;
  }
  /// Waits for its end: the exit status, or 128 + the signal.
  int end() {
    while (read_more(240'000)) {
    }
    int status = 0;
    waitpid(id_, &status, 0);
    id_ = -1;
    return WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
  }
  /// The same after a signal.
  int end(int signal) {
    kill(id_, signal);
    return end();
  }

 private:
  bool read_more(int timeout_ms) {
    pollfd waiting{said_, POLLIN, 0};
    if (poll(&waiting, 1, timeout_ms) <= 0) return false;
    char block[4096];
    const ssize_t count = read(said_, block, sizeof block);
    if (count <= 0) return false;
    text_.append(block, static_cast<std::size_t>(count));
    return true;
  }

  pid_t id_ = -1;
  int said_ = -1;
  std::string text_;
};

}  // namespace servotwin::test
