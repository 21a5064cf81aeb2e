// Times as tables write them: a date with a time, or a time of day.
//
//   2024-05-16T06:16:50.001   2024-05-16 06:16:50,001Z   16.05.2024 06:16:50.001   06:16:50.001
// A zone at the end (Z, +02:00) is read and ignored: differences of stamps are what counts. With
// points the day comes first, as in Germany; dates with slashes are not read, because their order
// differs from country to country. Any thread; errors: none, other text is an empty optional.
#pragma once

#include <cstdint>
#include <optional>
#include <string_view>

namespace servotwin {

struct TimeStamp {
  std::optional<std::int64_t> day;  ///< since 1970-01-01; absent: a time of day
  double second = 0.0;              ///< of the day
};

[[nodiscard]] std::optional<TimeStamp> parse_time_stamp(std::string_view text);

/// Seconds of stamps that follow each other, counted from midnight of the day of the first one. A
/// time of day that goes back by more than half a day is one of the next day.
class StampClock {
 public:
  [[nodiscard]] double seconds(const TimeStamp& stamp) noexcept;

 private:
  std::optional<std::int64_t> first_day_;
  std::int64_t midnights_ = 0;
  double last_second_ = 0.0;
};

}  // namespace servotwin
