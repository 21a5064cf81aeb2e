#include "identification/recording/slow_command.h"

#include <algorithm>
#include <cmath>

#include "identification/recording/order_statistics.h"

namespace servotwin {
namespace {

constexpr double kLongestPeriods = 1.5;  // between two values that follow each other

struct Knot {
  double row = 0.0, value = 0.0;
};

}  // namespace

void interpolate_refreshed(std::vector<double>& command, double period) {
  const double longest = kLongestPeriods * period;
  std::vector<Knot> knots;  // where a value appears, and where a rest ends
  double known = -1e300;    // the last row with a value
  for (std::size_t k = 0; k < command.size(); ++k) {
    if (!std::isfinite(command[k])) continue;
    const auto row = static_cast<double>(k);
    if (knots.empty() || command[k] != knots.back().value) {
      if (!knots.empty() && row - knots.back().row > longest)
        knots.push_back({row - period, knots.back().value});
      knots.push_back({row, command[k]});
    } else if (row - known <= longest) {
      std::fill(command.begin() + static_cast<std::ptrdiff_t>(known),
                command.begin() + static_cast<std::ptrdiff_t>(k), command[k]);
    }
    known = row;
  }
  const auto slope = [&](std::size_t k) {
    if (k == 0 || k + 1 >= knots.size()) return 0.0;
    const Knot &before = knots[k - 1], &after = knots[k + 1];
    return (after.value - before.value) / (after.row - before.row);
  };
  for (std::size_t k = 0; k + 1 < knots.size(); ++k) {
    const Knot &from = knots[k], &to = knots[k + 1];
    const double width = to.row - from.row;
    if (width > longest || from.value == to.value) continue;
    const double m0 = width * slope(k), m1 = width * slope(k + 1);
    for (auto row = static_cast<std::size_t>(std::floor(from.row)) + 1;
         static_cast<double>(row) < to.row; ++row) {
      const double t = (static_cast<double>(row) - from.row) / width, u = 1.0 - t;
      command[row] = u * u * ((1.0 + 2.0 * t) * from.value + t * m0) +
                     t * t * ((1.0 + 2.0 * u) * to.value - u * m1);
    }
  }
}

double period_of_sparse(const std::vector<double>& command) {
  constexpr std::size_t kMinValues = 50;
  constexpr double kMinRegularShare = 0.9;
  std::vector<double> intervals;
  std::size_t last = command.size();
  for (std::size_t k = 0; k < command.size(); ++k) {
    if (!std::isfinite(command[k])) continue;
    if (last < k) intervals.push_back(static_cast<double>(k - last));
    last = k;
  }
  if (intervals.size() < kMinValues) return 0.0;
  const double period = median(intervals);
  const auto regular = std::count(intervals.begin(), intervals.end(), period);
  return period >= 2.0 && static_cast<double>(regular) >=
                              kMinRegularShare * static_cast<double>(intervals.size())
             ? period
             : 0.0;
}

}  // namespace servotwin
