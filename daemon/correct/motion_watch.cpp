#include "daemon/correct/motion_watch.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <string_view>

#include "daemon/loop/program_matcher.h"
#include "drivers/common/checksum.h"

namespace servotwin::daemon {
namespace {

// Steps of the time beyond this are cycles that are missing [cycles].
constexpr double kLongestStep = 1.5;

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
    if (still_ <= longest_pause_ &&
        news.time[row] - time_.back() > kLongestStep * machine_.cycle_s) {
      for (std::vector<double>& axis : command_) axis.push_back(kAbsent);
      time_.push_back(time_.back());
    }
    add(news.time[row], news, row);
    still_ = 0;
    moved_ = true;
  }
  if (time_.size() * command_.size() > kMaxWatchedValues) drop_oldest();
  return ended;
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
}

void MotionWatch::forget() {
  time_.clear();
  for (std::vector<double>& axis : command_) axis.clear();
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
