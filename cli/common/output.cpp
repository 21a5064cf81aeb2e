#include "cli/common/output.h"

#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <charconv>
#include <cstdarg>
#include <nlohmann/json.hpp>

#include "cli/common/command.h"
#include "diagnosis/statistics/text.h"
#include "drivers/common/file_handle.h"

namespace servotwin::cli {

std::string text(const char* format, ...) {
  std::va_list arguments, again;
  va_start(arguments, format);
  va_copy(again, arguments);
  const int length = std::vsnprintf(nullptr, 0, format, arguments);
  va_end(arguments);
  std::string out(static_cast<std::size_t>(std::max(length, 0)), '\0');
  std::vsnprintf(out.data(), out.size() + 1, format, again);
  va_end(again);
  return without_powers(std::move(out));
}

std::FILE* people_beside(std::initializer_list<std::filesystem::path> results) {
  const auto on_stdout = std::count_if(results.begin(), results.end(), is_stdout);
  if (on_stdout > 1)
    throw UsageError("only one result can go to standard output; name a file for the others");
  for (const auto& file : results) {
    if (file.empty() || is_stdout(file)) continue;
    if (std::count(results.begin(), results.end(), file) > 1)
      throw UsageError(file.string() +
                       " is named for two results; the second would replace the first");
    AtomicFile probe(file);
  }
  return on_stdout == 1 ? stderr : stdout;
}

namespace {

std::atomic<bool> quiet{false};

void put_line(std::FILE* out, std::string_view line) {
  std::fwrite(line.data(), 1, line.size(), out);
  std::fputc('\n', out);
  std::fflush(out);  // in a pipe as well, people see it when it is said
}

}  // namespace

void keep_quiet() { quiet = true; }

void say(std::FILE* people, std::string_view line) {
  if (!quiet) put_line(people, line);
}

void tell(std::FILE* people, std::string_view line) {
  if (!quiet || people == stdout) put_line(people, line);
}

void complain(std::string_view line) { put_line(stderr, line); }

void write_line(std::string_view line) { put_line(stdout, line); }

void write_result(const std::filesystem::path& file, std::string_view content) {
  if (is_stdout(file)) {
    std::fwrite(content.data(), 1, content.size(), stdout);
    return;
  }
  AtomicFile out(file);
  out.write(content);
  out.commit();
}

void write_json(const std::filesystem::path& file, const nlohmann::json& json) {
  write_result(file, json.dump(2) + "\n");
}

void say_written(std::FILE* people, std::initializer_list<std::filesystem::path> results) {
  std::string files;
  for (const std::filesystem::path& file : results) {
    if (!file.empty() && !is_stdout(file)) files += (files.empty() ? "" : ", ") + file.string();
  }
  if (!files.empty()) say(people, "written     " + files);
}

std::string csv(const std::vector<Column>& columns) {
  std::string out;
  for (const Column& column : columns) out += (out.empty() ? "" : ",") + column.name;
  out += '\n';
  for (std::size_t row = 0; !columns.empty() && row < columns.front().values.size(); ++row) {
    for (const Column& column : columns) {
      char digits[32];
      out.append(digits, std::to_chars(digits, digits + sizeof digits, column.values[row]).ptr);
      out += ',';
    }
    out.back() = '\n';
  }
  return out;
}

Progress::Progress(std::string what, std::FILE* out, std::chrono::milliseconds period)
    : what_(std::move(what)), out_(out), period_(period) {
  if (quiet) return;
  const bool terminal = ::isatty(::fileno(out)) == 1;
  thread_ = std::thread(terminal ? &Progress::run_on_terminal : &Progress::run_in_lines, this);
}

Progress::~Progress() {
  if (!thread_.joinable()) return;
  {
    const std::lock_guard lock(mutex_);
    done_ = true;
  }
  done_changed_.notify_one();
  thread_.join();
}

void Progress::trying(std::string_view what) {
  const std::lock_guard lock(mutex_);
  trying_ = what;
}

std::string Progress::now() {
  const std::lock_guard lock(mutex_);
  return trying_.empty() ? what_ : what_ + ", trying " + trying_;
}

bool Progress::done_within(std::chrono::milliseconds time) {
  std::unique_lock lock(mutex_);
  return done_changed_.wait_for(lock, time, [&] { return done_; });
}

void Progress::run_on_terminal() {
  using namespace std::chrono_literals;
  auto waited = 2s;
  if (done_within(waited)) return;
  do {
    std::fprintf(out_, "\r\x1b[K%s ... %d s", now().c_str(), static_cast<int>(waited.count()));
    std::fflush(out_);
    waited += 1s;
  } while (!done_within(1s));
  std::fputs("\r\x1b[K", out_);  // the line is erased
}

void Progress::run_in_lines() {
  for (auto waited = period_; !done_within(period_); waited += period_)
    put_line(out_, text("%s, %g s", now().c_str(), 1e-3 * static_cast<double>(waited.count())));
}

}  // namespace servotwin::cli
