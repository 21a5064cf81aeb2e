#include "identification/recording/time_shift.h"

#include <algorithm>
#include <cmath>
#include <sstream>

#include "identification/recording/regression.h"

namespace servotwin {

namespace {

constexpr double kGrid_s = 0.01;                  // of the comparison
constexpr double kMaxShift_s = 5.0;               // searched, and at most a quarter of the segment
constexpr Eigen::Index kMaxComparedRows = 10000;  // compared; more do not change the answer
// Later than any servo: a loop of Kv 4/s lags by this time, and smooths what it follows.
constexpr double kMinLate_s = 0.25;
constexpr double kMinRemarked_s = 0.05;  // no fit takes a longer delay for one
// Ahead of its command by more than an overdone feedforward makes it.
constexpr double kMinEarly_s = 0.05;
constexpr double kMaxLeft = 0.02;           // RMS left by the shift, over that of the motion
constexpr double kMaxLeftOverOther = 0.33;  // over that left by a lag, or by no shift

/// RMS of the difference of two signals of the same length, without a constant.
double left(const Eigen::Ref<const Eigen::ArrayXd>& a, const Eigen::Ref<const Eigen::ArrayXd>& b) {
  const Eigen::ArrayXd difference = a - b;
  return std::sqrt((difference - difference.mean()).square().mean());
}

/// RMS left by the command, its slope and its bend: a short lag or lead of any kind.
double left_by_slopes(const Eigen::ArrayXd& command, const Eigen::ArrayXd& actual) {
  Regression<3> regression;
  for (Eigen::Index k = 1; k + 1 < command.size(); ++k) {
    regression.add({command(k), command(k + 1) - command(k - 1),
                    command(k + 1) - 2.0 * command(k) + command(k - 1), actual(k)});
  }
  return regression.fit().rms;
}

double left_by_shift(const Eigen::ArrayXd& command, const Eigen::ArrayXd& actual,
                     Eigen::Index rows) {
  const Eigen::Index n = command.size() - std::abs(rows);
  return rows >= 0 ? left(command.head(n), actual.tail(n)) : left(command.tail(n), actual.head(n));
}

double least_left_by_lag(const Eigen::ArrayXd& command, const Eigen::ArrayXd& actual,
                         double grid_s) {
  double least = HUGE_VAL;
  for (double constant_s = 0.02; constant_s < 2.0 * kMaxShift_s; constant_s *= 1.2) {
    const double keeps = std::exp(-grid_s / constant_s);
    Eigen::ArrayXd lagging(command.size());
    lagging(0) = command(0);
    for (Eigen::Index k = 1; k < command.size(); ++k)
      lagging(k) = keeps * lagging(k - 1) + (1.0 - keeps) * command(k);
    least = std::min(least, left(lagging, actual));
  }
  return least;
}

/// The longest segment, and nothing if it has no encoder.
const Segment* longest_of(std::span<const Segment> segments) {
  const auto shorter = [](const Segment& a, const Segment& b) { return a.size() < b.size(); };
  const auto longest = std::max_element(segments.begin(), segments.end(), shorter);
  return longest == segments.end() || longest->actual.size() != longest->size() ? nullptr
                                                                                : &*longest;
}

}  // namespace

std::string why_at_another_time(std::span<const Segment> segments) {
  const Segment* longest = longest_of(segments);
  if (longest == nullptr) return {};
  const auto every = std::max<Eigen::Index>(
      1, static_cast<Eigen::Index>(std::lround(kGrid_s / longest->sample_time_s)));
  const double grid_s = static_cast<double>(every) * longest->sample_time_s;
  const Eigen::Index rows = std::min(kMaxComparedRows, longest->size() / every);
  Eigen::ArrayXd command(rows), actual(rows);
  for (Eigen::Index k = 0; k < rows; ++k) {
    command(k) = longest->command(k * every);
    actual(k) = longest->actual(k * every);
  }
  const auto most = std::min(rows / 4, static_cast<Eigen::Index>(kMaxShift_s / grid_s));
  if (most < 1) return {};
  const double motion = std::sqrt((command - command.mean()).square().mean());
  if (!(motion > 0.0) || left_by_slopes(command, actual) < kMaxLeft * motion) return {};
  // The nearest shift that leaves little: a motion that repeats fits a period later as well.
  const auto remains = [&](Eigen::Index shift) { return left_by_shift(command, actual, shift); };
  Eigen::Index best = 0;
  for (Eigen::Index by = 1; by < most && best == 0; ++by) {
    for (const Eigen::Index shift : {by, -by}) {
      if (remains(shift) < kMaxLeft * motion) best = shift;
    }
  }
  if (best == 0) return {};
  const Eigen::Index outwards = best > 0 ? 1 : -1;
  while (std::abs(best) < most && remains(best + outwards) < remains(best)) best += outwards;
  const double least = remains(best);
  const double shift_s = static_cast<double>(best) * grid_s;
  if (!(shift_s > kMinLate_s) && !(shift_s < -kMinEarly_s)) return {};
  const double otherwise = shift_s > 0.0 ? least_left_by_lag(command, actual, grid_s)
                                         : left_by_shift(command, actual, 0);
  if (!(least < kMaxLeftOverOther * otherwise)) return {};
  std::ostringstream out;
  out.precision(2);
  out << "shows the commanded motion " << std::abs(shift_s)
      << (shift_s > 0.0 ? " s later and otherwise unchanged" : " s before it was commanded")
      << ": the two were not recorded at the same time; record both with one clock, or shift one";
  return out.str();
}

std::string remark_on_time(std::span<const Segment> segments) {
  const Segment* longest = longest_of(segments);
  if (longest == nullptr) return {};
  const double h = longest->sample_time_s;
  const auto rows_of = [&](double time_s) { return static_cast<Eigen::Index>(time_s / h); };
  const Eigen::Index most = rows_of(kMinLate_s), least = rows_of(kMinRemarked_s);
  const Eigen::Index rows = longest->size() - most;
  if (least < 1 || rows < 4 * most) return {};
  // Of the grid, or fewer, each after the longest delay that is tried.
  const Eigen::Index every = std::max<Eigen::Index>({1, rows_of(kGrid_s), rows / kMaxComparedRows});
  const auto after = [&](Eigen::Index delay) {
    Eigen::ArrayXd out(rows / every);
    for (Eigen::Index k = 0; k < out.size(); ++k)
      out(k) = longest->command(most + k * every - delay);
    return out;
  };
  Eigen::ArrayXd actual(rows / every);
  for (Eigen::Index k = 0; k < actual.size(); ++k) actual(k) = longest->actual(most + k * every);
  const auto remains = [&](Eigen::Index delay) { return left(after(delay), actual); };
  // It falls towards the best delay from either side.
  Eigen::Index low = 0, high = most;
  while (high - low > 2) {
    const Eigen::Index third = (high - low) / 3;
    if (remains(low + third) < remains(high - third)) {
      high -= third;
    } else {
      low += third;
    }
  }
  const Eigen::Index best = low + 1;
  if (best < least || best + 2 >= most ||
      !(remains(best) < kMaxLeftOverOther * left_by_slopes(after(0), actual)))
    return {};
  std::ostringstream out;
  out.precision(2);
  const double delay_s = h * static_cast<double>(best);
  out << "shows the commanded motion " << delay_s
      << " s later and hardly changed: as late as a loop with a velocity gain of " << 1.0 / delay_s
      << " 1/s, which would smooth it; where two clocks recorded them, shift one";
  return out.str();
}

}  // namespace servotwin
