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

}  // namespace

std::string why_at_another_time(std::span<const Segment> segments) {
  const Segment* longest = nullptr;
  for (const Segment& s : segments) {
    if (longest == nullptr || s.size() > longest->size()) longest = &s;
  }
  if (longest == nullptr || longest->actual.size() != longest->size()) return {};
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

}  // namespace servotwin
