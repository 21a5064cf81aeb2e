// Runs the command-line tool as a user does, and returns its output and exit status.
#pragma once

#include <sys/types.h>

#include <filesystem>
#include <ostream>
#include <string>
#include <vector>

#include "tests/support/temporary_directory.h"

namespace servotwin {

struct Answer {
  int status = -1;  ///< exit status; 128 + the signal that ended it
  std::string out, err;

  /// The lines of standard error, without the progress that work of more than ten seconds tells:
  /// how long it takes depends on the machine.
  [[nodiscard]] std::vector<std::string> complaints() const;
};
std::ostream& operator<<(std::ostream& out, const Answer& answer);

/// A folder for one test, deleted after it.
class Folder : public test::TemporaryDirectory {
 public:
  [[nodiscard]] std::string operator/(const std::string& name) const {
    return (path() / name).string();
  }
  /// Writes a file and gives its name.
  std::string write(const std::string& name, const std::string& content) const;
  /// The names of its files, sorted.
  [[nodiscard]] std::vector<std::string> list() const;
};

[[nodiscard]] std::string content_of(const std::string& file);

/// A started tool, with its output in a folder of its own.
class Program {
 public:
  /// `out`: where standard output goes instead of into the answer.
  explicit Program(const std::vector<std::string>& arguments, const std::string& out = "");
  Program(const Program&) = delete;
  Program& operator=(const Program&) = delete;
  ~Program();

  void interrupt() const;
  /// Its standard output so far; empty if that is redirected.
  [[nodiscard]] std::string so_far() const;
  /// Waits for its end.
  [[nodiscard]] Answer answer();

 private:
  Folder folder_;
  std::string out_, err_;
  pid_t id_ = -1;
};

/// Runs it to its end.
[[nodiscard]] Answer servotwin_says(const std::vector<std::string>& arguments,
                                    const std::string& out = "");

}  // namespace servotwin
