// Output: results go to a file or to standard output; text for people goes to the other stream.
#pragma once

#include <chrono>
#include <condition_variable>
#include <cstdio>
#include <filesystem>
#include <mutex>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <string_view>
#include <thread>
#include <vector>

namespace servotwin::cli {

/// A string formatted as by printf, without powers of ten from 100 to 99999 (diagnosis/text.h).
[[gnu::format(printf, 1, 2)]] [[nodiscard]] std::string text(const char* format, ...);

[[nodiscard]] inline bool is_stdout(const std::filesystem::path& file) { return file == "-"; }

/// The stream for text: standard output, or standard error if one of the results goes to standard
/// output. An empty path is no result. Checks all results before the work begins: throws UsageError
/// if two go to standard output or to the same file, std::runtime_error if a file cannot be
/// written.
[[nodiscard]] std::FILE* people_beside(std::initializer_list<std::filesystem::path> results);

/// Prints one line.
void say(std::FILE* people, std::string_view line);

/// Writes a result completely or not at all; "-" is standard output. Throws std::runtime_error.
void write_result(const std::filesystem::path& file, std::string_view content);
void write_json(const std::filesystem::path& file, const nlohmann::json& json);

/// A table as CSV, every number with as many digits as are needed to read back the same number. All
/// columns have the same length.
struct Column {
  std::string name;  ///< with its unit
  std::vector<double> values;
};
[[nodiscard]] std::string csv(const std::vector<Column>& columns);

/// During its lifetime, if standard error is a terminal, shows there what the program is doing,
/// beginning after two seconds.
class Progress {
 public:
  explicit Progress(std::string what);
  ~Progress();
  Progress(const Progress&) = delete;
  Progress& operator=(const Progress&) = delete;

 private:
  void run();

  std::string what_;
  std::mutex mutex_;
  std::condition_variable done_changed_;
  bool done_ = false;
  std::thread thread_;
};

}  // namespace servotwin::cli
