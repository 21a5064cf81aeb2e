#include "identification/recording/run_in.h"

#include <algorithm>
#include <cmath>

#include "identification/recording/order_statistics.h"
#include "identification/recording/values.h"

namespace servotwin {

std::optional<std::string> leave_out_run_in(AxisRecord& axis, const std::vector<double>& time) {
  constexpr std::size_t kMinRows = 200;
  constexpr double kLongest = 0.2;    // of the rows
  constexpr double kMinRatio = 20.0;  // of the error at the beginning, over the largest later
  constexpr double kArrived = 1.5;    // of the error, over the largest later
  constexpr double kMinTravel = 0.2;  // of the command later, over the way to its place
  constexpr double kLeast_m = 1e-3, kLeast_rad = 0.01;  // another zero of the encoder may be less
  std::vector<std::size_t> rows;
  for (std::size_t i = 0; i < std::min(axis.command.size(), axis.actual.size()); ++i) {
    if (std::isfinite(axis.command[i]) && std::isfinite(axis.actual[i])) rows.push_back(i);
  }
  if (rows.size() < kMinRows || time.size() < axis.actual.size()) return std::nullopt;
  const auto first_later = static_cast<std::size_t>(kLongest * static_cast<double>(rows.size()));
  std::vector<double> later;
  double low = 1e300, high = -1e300;
  for (std::size_t k = first_later; k < rows.size(); ++k) {
    later.push_back(axis.command[rows[k]] - axis.actual[rows[k]]);
    low = std::min(low, axis.command[rows[k]]);
    high = std::max(high, axis.command[rows[k]]);
  }
  const double usual = median(later);
  double largest = 0.0;
  for (const double error : later) largest = std::max(largest, std::abs(error - usual));
  const auto off = [&](std::size_t k) {
    return std::abs(axis.command[rows[k]] - axis.actual[rows[k]] - usual);
  };
  const double way = off(0),
               away = std::abs(axis.command[rows.front()] - axis.actual[rows.front()]);
  // An axis that sets off has no error yet, and its lag after.
  if (!(way > std::max(kMinRatio * largest, axis.rotary ? kLeast_rad : kLeast_m)) ||
      !(away > way - largest) || !(high - low > kMinTravel * way))
    return std::nullopt;
  std::size_t arrived = first_later;
  while (arrived > 0 && off(arrived - 1) <= kArrived * largest) --arrived;
  // It has not arrived within the rows that may be left out: then this is its motion.
  if (arrived == first_later || !std::isfinite(time[rows[arrived]])) return std::nullopt;
  for (std::size_t k = 0; k < arrived; ++k) axis.actual[rows[k]] = kAbsent;
  return "the axis begins " + values::size_text(away, axis.rotary) +
         " from its command and has run to it at " + values::number(time[rows[arrived]]) +
         " s: left out until then";
}

}  // namespace servotwin
