#include "daemon/record/recorder.h"

#include <algorithm>
#include <cmath>
#include <compare>
#include <cstdio>
#include <optional>
#include <regex>
#include <stdexcept>
#include <thread>
#include <utility>
#include <vector>

#include "daemon/between/clock.h"
#include "drivers/common/text.h"
#include "drivers/recordings/table/csv.h"

namespace servotwin::daemon {
namespace {

// The ring holds seconds of rows and identification waits for seconds of motion: this is often
// enough.
constexpr auto kRecorderPause = std::chrono::milliseconds(20);
// Without a row for this long the file is finished.
constexpr auto kSilence_ns = static_cast<std::int64_t>(Recorder::kFile_s * 1e9);

// The longest number is "-2.2250738585072014e-308,".
constexpr double kBytesPerNumber = 25.0;

double largest_file(const MachineDescription& machine) {
  double columns = 1.0;
  for (const AxisDescription& axis : machine.axes) columns += axis.torque_unit.empty() ? 2.0 : 3.0;
  return kBytesPerNumber * columns * (Recorder::kFile_s / machine.cycle_s + 1.0);
}

/// "2026-01-31T120000.000Z.csv", and "2026-01-31T120000.000Z_000002.csv" for the second of one
/// stamp.
struct FileName {
  std::string stamp;
  int number = 1;

  auto operator<=>(const FileName&) const = default;
};

/// Nothing if the recorder did not write a file of this name.
std::optional<FileName> parsed(const std::string& name) {
  static const std::regex ours(R"((\d{4}-\d\d-\d\dT\d{6}\.\d{3}Z)(?:_(\d{2,9}))?\.csv)");
  std::smatch parts;
  if (!std::regex_match(name, parts, ours)) return std::nullopt;
  return FileName{parts[1], parts[2].matched ? std::stoi(parts[2]) : 1};
}

/// A name that sorts after all existing ones ('_' sorts after the '.' of the extension). It has the
/// time of the wall clock, or that of the newest file if the clock was set back.
std::string name_of_file(const std::filesystem::path& directory) {
  std::string stamp = iso_time(wall_ns());
  std::erase(stamp, ':');
  FileName next{stamp, 1};
  std::error_code unreadable;  // reported when the file is written
  for (std::filesystem::directory_iterator entry(directory, unreadable), end;
       !unreadable && entry != end; entry.increment(unreadable)) {
    const std::optional<FileName> there = parsed(entry->path().filename());
    if (there && *there >= next) next = {there->stamp, there->number + 1};
  }
  if (next.number == 1) return next.stamp + ".csv";
  char number[16];
  std::snprintf(number, sizeof number, "_%06d.csv", next.number);
  return next.stamp + number;
}

}  // namespace

Recorder::Recorder(const MachineDescription& machine, const std::string& machine_name,
                   const std::filesystem::path& directory, const RecordingRoom& room,
                   Ring<CycleRow>& rows, MotionMemory& memory, ResidualWatch& watch,
                   EventLog& events)
    : directory_(directory / "recordings" / machine_name),
      budget_bytes_(room.budget_mb * 1e6),
      most_bytes_(room.most_mb * 1e6),
      file_bytes_(largest_file(machine)),
      rows_(rows),
      memory_(memory),
      watch_(watch),
      events_(events) {
  empty_.source = machine_name;
  for (const AxisDescription& axis : machine.axes) {
    AxisRecord record;
    record.name = axis.name;
    record.rotary = axis.rotary;
    record.torque_unit = axis.torque_unit;
    empty_.axes.push_back(std::move(record));
  }
  file_ = empty_;
  if (budget_bytes_ <= 0.0) return;
  std::error_code error;
  std::filesystem::create_directories(directory_, error);
  if (error)
    throw std::runtime_error("recordings " + directory_.string() +
                             ": cannot be created: " + error.message());
  // Removes files that a crash left incomplete; the lock of the store excludes other writers.
  for (const auto& entry : std::filesystem::directory_iterator(directory_)) {
    if (entry.path().filename().string().find(".csv.part-") != std::string::npos) {
      std::filesystem::remove(entry.path());
    }
  }
}

void Recorder::run(const std::stop_token& stop) {
  std::int64_t last_ns = steady_ns();
  while (!stop.stop_requested()) {
    if (drain()) {
      last_ns = steady_ns();
    } else {
      // Without new rows the file is finished, so that the last rows are on the disk if the host is
      // switched off as well.
      if (steady_ns() - last_ns > kSilence_ns) finish_file();
      std::this_thread::sleep_for(kRecorderPause);
    }
  }
  while (drain()) {
  }
  finish_file();
}

bool Recorder::drain() {
  bool any = false;
  CycleRow row;
  while (rows_.pop(row)) {
    any = true;
    memory_.append(row);
    watch_.append(row);
    if (budget_bytes_ > 0.0) collect(row);
  }
  return any;
}

void Recorder::collect(const CycleRow& row) {
  const auto since_start_s = [&] {
    return 1e-9 * static_cast<double>(between_ns(file_start_ns_, row.time_ns));
  };
  // A repeated stamp only has a coarse resolution; a stamp that goes back means a restarted source.
  if (!file_.time.empty() && (since_start_s() < file_.time.back() || since_start_s() >= kFile_s)) {
    finish_file();
  }
  if (file_.time.empty() && !begin_file(row)) {
    not_recorded_.fetch_add(1, std::memory_order_relaxed);
    return;
  }
  {
    const std::lock_guard lock(spans_mutex_);
    spans_.back().until_s = memory_.newest_s();
  }
  file_.time.push_back(since_start_s());
  for (std::size_t i = 0; i < file_.axes.size(); ++i) {
    AxisRecord& axis = file_.axes[i];
    axis.command.push_back(row.axes[i].command);
    axis.actual.push_back(row.axes[i].actual);
    if (!axis.torque_unit.empty()) axis.torque.push_back(row.axes[i].torque);
  }
}

bool Recorder::begin_file(const CycleRow& row) {
  // The directory is missing if recording was off at the start; errors are reported when writing.
  std::error_code ignored;
  std::filesystem::create_directories(directory_, ignored);
  const auto since_look_s = [&] {
    return 1e-9 * static_cast<double>(between_ns(*looked_ns_, row.time_ns));
  };
  if (!looked_ns_ || (is(State::kFull) && (since_look_s() < 0.0 || since_look_s() >= kFile_s))) {
    looked_ns_ = row.time_ns;
    keep_within_budget();
  }
  if (is(State::kFull)) return false;
  file_start_ns_ = row.time_ns;
  file_name_ = name_of_file(directory_);
  const std::lock_guard lock(spans_mutex_);
  spans_.push_back({file_name_, memory_.newest_s(), memory_.newest_s()});
  return true;
}

std::string Recorder::problem() const {
  if (budget_bytes_ <= 0.0) return {};
  switch (state_.load(std::memory_order_relaxed)) {
    case State::kRefused:
      return "cycles are not recorded: they cannot be written to the disk";
    case State::kFull:
      return "cycles are not recorded: the recordings that models were fitted to or judged on "
             "leave no room below store.recordings_max_mb = " +
             number(most_bytes_ / 1e6);
    case State::kRecords:
      break;
  }
  return {};
}

void Recorder::finish_file() {
  if (file_.time.empty()) return;
  const std::uint64_t rows = file_.time.size();
  try {
    write_recording_csv(directory_ / file_name_, file_);
    if (is(State::kRefused)) {
      events_.note("recording", "",
                   "recordings are stored again; missing: " + counted(rows_not_recorded(), "row"));
    }
    become(State::kRecords);
  } catch (const std::exception& error) {
    not_recorded_.fetch_add(rows, std::memory_order_relaxed);
    if (!is(State::kRefused))
      events_.error("recording", "", std::string("recordings are not stored: ") + error.what());
    become(State::kRefused);
  }
  file_ = empty_;
  keep_within_budget();
}

std::vector<std::string> Recorder::files_with(double from_s, double until_s) const {
  const std::lock_guard lock(spans_mutex_);
  std::vector<std::string> out;
  for (const Span& span : spans_) {
    if (span.from_s <= until_s && from_s <= span.until_s) out.push_back(span.name);
  }
  return out;
}

void Recorder::keep_within_budget() {
  try {
    delete_oldest();
    over_budget_ = false;
  } catch (const std::exception& error) {
    if (!over_budget_) {
      events_.error("recording", "",
                    std::string("the oldest recordings are not deleted: ") + error.what());
    }
    over_budget_ = true;
  }
}

void Recorder::delete_oldest() {
  struct File {
    std::filesystem::path path;
    double bytes;
  };
  std::vector<File> files;
  double bytes = 0.0;
  for (const auto& entry : std::filesystem::directory_iterator(directory_)) {
    if (!entry.is_regular_file() || !parsed(entry.path().filename())) continue;
    std::error_code gone;  // another program may delete files, too
    const auto size = static_cast<double>(entry.file_size(gone));
    if (gone) continue;
    files.push_back({entry.path(), size});
    bytes += size;
  }
  const double budget = budget_bytes_, most = most_before_file();
  std::size_t spared = 0;
  if (bytes > std::min(budget, most) && !files.empty()) {
    std::sort(files.begin(), files.end(),
              [](const File& a, const File& b) { return a.path < b.path; });
    files.pop_back();  // the newest stays
    const std::set<std::string> cited = cited_ ? cited_() : std::set<std::string>();
    spared = std::erase_if(files,
                           [&](const File& file) { return cited.contains(file.path.filename()); });
    for (const File& file : files) {
      if (bytes <= std::min(budget, most)) break;
      bytes -= file.bytes;
      remove(file.path);
    }
  }
  judge_room(bytes);
  const bool over = bytes > budget && spared > 0;
  if (over && !spared_) {
    events_.note("recording", "",
                 "kept beyond store.recordings_mb = " + number(budget / 1e6) + ": " +
                     counted(spared, "recording") +
                     " that models were fitted to or judged on; raise that limit, or delete "
                     "recordings that are no longer needed");
  }
  spared_ = over;
}

void Recorder::judge_room(double bytes) {
  const bool full = bytes > most_before_file();
  if (full && !is(State::kFull)) {
    events_.error("recording", "",
                  "recording stops: there are " + number(std::round(bytes / 1e5) / 10.0) +
                      " MB of recordings, and another file could exceed "
                      "store.recordings_max_mb = " +
                      number(most_bytes_ / 1e6) +
                      "; prediction and identification continue. Raise that limit, or delete "
                      "recordings that are no longer needed: recording then resumes by itself");
    become(State::kFull);
  } else if (!full && is(State::kFull)) {
    become(State::kRecords);
    events_.note(
        "recording", "",
        "recording resumed; missing since the start: " + counted(rows_not_recorded(), "row"));
  }
}

void Recorder::remove(const std::filesystem::path& file) {
  std::filesystem::remove(file);
  const std::lock_guard lock(spans_mutex_);
  std::erase_if(spans_, [&](const Span& span) { return span.name == file.filename(); });
  if (!deleted_) {
    events_.note("recording", "",
                 "the oldest recordings are deleted, to stay within " +
                     std::to_string(static_cast<long>(budget_bytes_ / 1e6)) + " MB");
  }
  deleted_ = true;
}

}  // namespace servotwin::daemon
