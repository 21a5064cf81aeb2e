// Where results and words go: results to their file or to standard output, words for people beside
// them.
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

/// printf into a string.
[[gnu::format(printf, 1, 2)]] [[nodiscard]] std::string text(const char* format, ...);

[[nodiscard]] inline bool is_stdout(const std::filesystem::path& file) { return file == "-"; }

/// Where words for people go: standard output, or standard error if a result is written there. An
/// empty path is no result. Throws UsageError if more than one result goes to standard output,
/// std::runtime_error if one cannot be written: before the work, not after it.
[[nodiscard]] std::FILE* people_beside(std::initializer_list<std::filesystem::path> results);

void say(std::FILE* people, std::string_view line);

/// Writes a result whole or not at all; "-" is standard output. Throws std::runtime_error.
void write_result(const std::filesystem::path& file, std::string_view content);
void write_json(const std::filesystem::path& file, const nlohmann::json& json);

/// A table as CSV, every number with the digits that read back as the same number. Columns are of
/// one length.
struct Column {
  std::string name;  ///< with its unit
  std::vector<double> values;
};
[[nodiscard]] std::string csv(const std::vector<Column>& columns);

/// While it lives and standard error is a terminal, shows there what takes so long, from two
/// seconds on.
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
