// Output: results go to a file or to standard output; text for people goes to the other stream.
#pragma once

#include <chrono>
#include <condition_variable>
#include <cstdio>
#include <filesystem>
#include <initializer_list>
#include <mutex>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <string_view>
#include <thread>
#include <vector>

namespace servotwin::cli {

/// A string formatted as by printf, without powers of ten from 100 to 99999
/// (diagnosis/statistics/text.h).
[[gnu::format(printf, 1, 2)]] [[nodiscard]] std::string text(const char* format, ...);

[[nodiscard]] inline bool is_stdout(const std::filesystem::path& file) { return file == "-"; }

/// The stream for text: standard output, or standard error if one of the results goes to standard
/// output. An empty path is no result. Checks all results before the work begins: throws UsageError
/// if two go to standard output or to the same file, std::runtime_error if a file cannot be
/// written.
[[nodiscard]] std::FILE* people_beside(std::initializer_list<std::filesystem::path> results);

/// --quiet: from now on say() and Progress print nothing. Any thread.
void keep_quiet();
/// Prints one line of text for people.
void say(std::FILE* people, std::string_view line);
/// The same of what was asked for: a verdict, a figure. On standard output also after keep_quiet().
void tell(std::FILE* people, std::string_view line);
/// Prints one line of an error on standard error, also after keep_quiet(). For work that goes on;
/// an error that ends it is thrown.
void complain(std::string_view line);
/// Prints one line of a result on standard output, also after keep_quiet().
void write_line(std::string_view line);

/// Writes a result completely or not at all; "-" is standard output. Throws std::runtime_error.
void write_result(const std::filesystem::path& file, std::string_view content);
void write_json(const std::filesystem::path& file, const nlohmann::json& json);

/// Says which files the results went to; nothing of standard output, and nothing where no result
/// was asked for.
void say_written(std::FILE* people, std::initializer_list<std::filesystem::path> results);

/// A table as CSV, every number with as many digits as are needed to read back the same number. All
/// columns have the same length.
struct Column {
  std::string name;  ///< with its unit
  std::vector<double> values;
};
[[nodiscard]] std::string csv(const std::vector<Column>& columns);

/// During its lifetime shows what the program is doing, and for how long: on a terminal in one line
/// that changes every second, beginning after two; in a pipe or a file in a new line per `period`,
/// so that nobody waits before a silent log. Nothing after keep_quiet(). trying(): any thread.
class Progress {
 public:
  explicit Progress(std::string what, std::FILE* out = stderr,
                    std::chrono::milliseconds period = std::chrono::seconds(10));
  ~Progress();
  Progress(const Progress&) = delete;
  Progress& operator=(const Progress&) = delete;

  /// What of it is being tried now.
  void trying(std::string_view what);

 private:
  [[nodiscard]] std::string now();
  void run_on_terminal();
  void run_in_lines();
  /// Whether the work is done after at most this time.
  [[nodiscard]] bool done_within(std::chrono::milliseconds time);

  std::string what_, trying_;
  std::FILE* out_;
  std::chrono::milliseconds period_;
  std::mutex mutex_;
  std::condition_variable done_changed_;
  bool done_ = false;
  std::thread thread_;
};

}  // namespace servotwin::cli
