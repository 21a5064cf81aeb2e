#include "drivers/common/time_stamp.h"

#include <chrono>
#include <cmath>

#include "drivers/common/text.h"

namespace servotwin {
namespace {

constexpr double kSecondsPerDay = 86'400.0;

/// Reads a text from its beginning.
class Reader {
 public:
  explicit Reader(std::string_view text) : left_(text) {}

  [[nodiscard]] bool at_end() const { return left_.empty(); }
  bool take(char wanted) {
    if (left_.empty() || left_.front() != wanted) return false;
    left_.remove_prefix(1);
    return true;
  }
  /// A number of `least` to `most` digits.
  std::optional<int> digits(std::size_t least, std::size_t most) {
    std::size_t count = 0;
    int value = 0;
    while (count < most && count < left_.size() && is_digit(left_[count]))
      value = 10 * value + (left_[count++] - '0');
    if (count < least) return std::nullopt;
    left_.remove_prefix(count);
    return value;
  }
  /// The digits behind a decimal mark, as a share of 1.
  double fraction() {
    double value = 0.0, scale = 1.0;
    while (!left_.empty() && is_digit(left_.front())) {
      value = 10.0 * value + (left_.front() - '0');
      scale *= 10.0;
      left_.remove_prefix(1);
    }
    return value / scale;
  }

 private:
  static bool is_digit(char c) { return '0' <= c && c <= '9'; }
  std::string_view left_;
};

/// 2024-05-16 or 16.05.2024, and what separates it from the time.
std::optional<std::int64_t> take_date(Reader& reader) {
  namespace date = std::chrono;
  int year = 0, month = 0, day = 0;
  const auto first = reader.digits(1, 4);
  if (!first) return std::nullopt;
  const char mark = reader.take('-') ? '-' : '.';
  constexpr int kFirstYear = 1000;
  if (mark == '-' && *first < kFirstYear) return std::nullopt;  // 16-05-24 may be any order
  if (mark == '.' && !reader.take('.')) return std::nullopt;
  const auto second = reader.digits(1, 2);
  if (!second || !reader.take(mark)) return std::nullopt;
  const auto third = mark == '-' ? reader.digits(1, 2) : reader.digits(4, 4);
  if (!third) return std::nullopt;
  year = mark == '-' ? *first : *third;
  month = *second;
  day = mark == '-' ? *third : *first;
  if (!reader.take('T') && !reader.take(' ')) return std::nullopt;
  while (reader.take(' ')) {
  }
  const date::year_month_day ymd{date::year(year), date::month(static_cast<unsigned>(month)),
                                 date::day(static_cast<unsigned>(day))};
  if (!ymd.ok()) return std::nullopt;
  return date::sys_days(ymd).time_since_epoch().count();
}

/// 06:16:50.001, with an optional zone, to the end.
std::optional<double> take_time(Reader& reader) {
  const auto hour = reader.digits(1, 2);
  if (!hour || *hour > 23 || !reader.take(':')) return std::nullopt;
  const auto minute = reader.digits(2, 2);
  if (!minute || *minute > 59 || !reader.take(':')) return std::nullopt;
  const auto second = reader.digits(2, 2);
  if (!second || *second > 60) return std::nullopt;
  const double fraction = reader.take('.') || reader.take(',') ? reader.fraction() : 0.0;
  if (!reader.take('Z') && (reader.take('+') || reader.take('-'))) {
    if (!reader.digits(2, 2)) return std::nullopt;
    reader.take(':');
    if (!reader.digits(2, 2)) return std::nullopt;
  }
  if (!reader.at_end()) return std::nullopt;
  return 3600.0 * *hour + 60.0 * *minute + *second + fraction;
}

}  // namespace

std::optional<TimeStamp> parse_time_stamp(std::string_view text) {
  text = trimmed(text);
  Reader alone(text);
  if (const auto second = take_time(alone)) return TimeStamp{std::nullopt, *second};
  Reader dated(text);
  const auto day = take_date(dated);
  if (!day) return std::nullopt;
  const auto second = take_time(dated);
  if (!second) return std::nullopt;
  return TimeStamp{day, *second};
}

double StampClock::seconds(const TimeStamp& stamp) noexcept {
  if (stamp.day) {
    if (!first_day_) first_day_ = stamp.day;
    return kSecondsPerDay * static_cast<double>(*stamp.day - *first_day_) + stamp.second;
  }
  if (stamp.second < last_second_ - 0.5 * kSecondsPerDay) ++midnights_;
  last_second_ = stamp.second;
  return kSecondsPerDay * static_cast<double>(midnights_) + stamp.second;
}

}  // namespace servotwin
