#include "daemon/correct/motion_watch.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <string_view>

#include "daemon/loop/program_matcher.h"
#include "drivers/common/checksum.h"

namespace servotwin::daemon {
namespace {

// Before a step of the time beyond this cycles may be missing [cycles]; or its stamp is late, as of
// a bus whose adapter or host is busy. The stamps around it tell: of missing cycles all later
// stamps are late, and the least late of so many rows is on time. Not more rows than end a move.
constexpr double kLongestStep = 1.5, kMissing = 0.5;
constexpr std::size_t kRowsAround = ProgramMatcher::kStandstillCycles;

/// A command that was not heard has not changed, as far as anybody knows.
bool stands(double before, double now) { return before == now || std::isnan(now); }

/// The CRC-32 of the rows with motion, without the rests, whose length may vary.
std::uint32_t crc32_of_motion(const std::vector<Eigen::ArrayXd>& command) {
  const Eigen::Index rows = command.front().size();
  Eigen::Index first = rows, end = 0;
  for (const Eigen::ArrayXd& axis : command) {
    for (Eigen::Index k = 1; k < rows; ++k) {
      if (axis(k) == axis(k - 1)) continue;
      first = std::min(first, k);
      end = std::max(end, k + 1);
    }
  }
  std::uint32_t crc32 = 0;
  for (const Eigen::ArrayXd& axis : command) {
    if (first >= end) continue;
    const auto* const bytes = reinterpret_cast<const char*>(axis.data() + first);
    crc32 = crc32_of({bytes, static_cast<std::size_t>(end - first) * sizeof(double)}, crc32);
  }
  return crc32;
}

}  // namespace

MotionWatch::MotionWatch(const MachineDescription& machine, double tolerance)
    : machine_(machine),
      tolerance_(tolerance),
      longest_pause_(static_cast<std::size_t>(std::ceil(kLongestInnerPause_s / machine.cycle_s)) +
                     1),
      command_(machine.axes.size()) {}

bool MotionWatch::take(const Recording& news) {
  bool ended = false;
  for (std::size_t row = 0; row < news.time.size(); ++row) {
    const bool moves = !time_.empty() &&
                       !std::equal(command_.begin(), command_.end(), news.axes.begin(),
                                   [&](const std::vector<double>& known, const AxisRecord& axis) {
                                     return stands(known.back(), axis.command[row]);
                                   });
    if (!moves) {
      // What stands has not moved in cycles that are missing.
      if (++still_ <= longest_pause_) repeat_last(news, row);
      ended = ended || (moved_ && still_ == ProgramMatcher::kStandstillCycles);
      if (still_ == ProgramMatcher::kStandstillCycles) moved_ = false;
      continue;
    }
    if (still_ <= longest_pause_ && news.time[row] - time_.back() > kLongestStep * machine_.cycle_s)
      long_steps_.push_back(time_.size());
    add(news.time[row], news, row);
    still_ = 0;
    moved_ = true;
  }
  mark_missing();
  if (time_.size() * command_.size() > kMaxWatchedValues) drop_oldest();
  return ended;
}

void MotionWatch::mark_missing() {
  const auto least_late = [&](std::size_t from, std::size_t to) {
    double least = std::numeric_limits<double>::infinity();
    for (std::size_t k = from; k < to; ++k)
      least = std::min(least, time_[k] / machine_.cycle_s - static_cast<double>(k));
    return least;
  };
  // The newest first: a row that is inserted moves those behind it. What has too few rows behind it
  // waits for them.
  std::vector<std::size_t> waiting;
  for (auto step = long_steps_.rbegin(); step != long_steps_.rend(); ++step) {
    const std::size_t at = *step;
    if (at + kRowsAround > time_.size()) {
      waiting.push_back(at);
      continue;
    }
    const double before = least_late(at - std::min(at, kRowsAround), at);
    if (least_late(at, at + kRowsAround) - before < kMissing) continue;
    const auto place = static_cast<std::ptrdiff_t>(at);
    for (std::vector<double>& axis : command_) axis.insert(axis.begin() + place, kAbsent);
    time_.insert(time_.begin() + place, time_[at - 1]);
    for (std::size_t& later : waiting) ++later;
  }
  long_steps_.assign(waiting.rbegin(), waiting.rend());
}

void MotionWatch::repeat_last(const Recording& news, std::size_t row) {
  if (time_.empty()) return add(news.time[row], news, row);
  time_.push_back(news.time[row]);
  for (std::vector<double>& axis : command_) axis.push_back(axis.back());
}

void MotionWatch::add(double time_s, const Recording& news, std::size_t row) {
  time_.push_back(time_s);
  for (std::size_t i = 0; i < command_.size(); ++i)
    command_[i].push_back(news.axes[i].command[row]);
}

void MotionWatch::drop_oldest() {
  const auto rows = static_cast<std::ptrdiff_t>(time_.size() / 4);
  time_.erase(time_.begin(), time_.begin() + rows);
  for (std::vector<double>& axis : command_) axis.erase(axis.begin(), axis.begin() + rows);
  // Those that wait are among the last rows.
  for (std::size_t& at : long_steps_) at -= static_cast<std::size_t>(rows);
}

void MotionWatch::forget() {
  time_.clear();
  for (std::vector<double>& axis : command_) axis.clear();
  long_steps_.clear();
  still_ = 0;
  moved_ = false;
}

std::optional<RepeatingMotion> MotionWatch::repetition() const {
  return repeating_motion(command_, machine_.cycle_s, tolerance_);
}

std::pair<double, double> MotionWatch::periods_s(const RepeatingMotion& found) const {
  double shortest = std::numeric_limits<double>::infinity(), longest = 0.0;
  for (std::size_t i = 1; i < found.begins.size(); ++i) {
    const double period_s = time_[found.begins[i]] - time_[found.begins[i - 1]];
    shortest = std::min(shortest, period_s);
    longest = std::max(longest, period_s);
  }
  return {shortest, longest};
}

CommandedPath MotionWatch::program_of(const RepeatedPart& part) const {
  CommandedPath out;
  out.learn = true;
  for (std::size_t i = 0; i < command_.size(); ++i) {
    if ((part.axes >> i & 1U) == 0) continue;
    out.axes.push_back(i);
    out.command.emplace_back(Eigen::Map<const Eigen::ArrayXd>(
        command_[i].data() + part.first, static_cast<Eigen::Index>(part.rows)));
  }
  out.name = "motion-" + crc32_text(crc32_of_motion(out.command));
  return out;
}

}  // namespace servotwin::daemon
