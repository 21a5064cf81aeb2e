#include "identification/recording/positions.h"

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <numbers>
#include <optional>

namespace servotwin {
namespace {

using Values = std::vector<double>;

std::string number(double value) {
  std::array<char, 32> out{};
  std::snprintf(out.data(), out.size(), "%.6g", value);
  return out.data();
}

/// In the unit that people read.
std::string size(double value, bool rotary) {
  return rotary ? number(value * 180.0 / std::numbers::pi) + " deg" : number(1e3 * value) + " mm";
}

double median(Values values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

Values finite(const Values& values) {
  Values out;
  std::copy_if(values.begin(), values.end(), std::back_inserter(out),
               [](double v) { return std::isfinite(v); });
  return out;
}

/// A period as it is meant: a part of a turn, or a number of two digits.
double rounded(double period, bool rotary) {
  constexpr double kNear = 0.01, kNearNumber = 1e-3;  // a turn is certain, a round number is not
  if (rotary) {
    for (const double turns : {0.25, 0.5, 1.0, 2.0}) {
      const double meant = 2.0 * std::numbers::pi * turns;
      if (std::abs(period / meant - 1.0) < kNear) return meant;
    }
    return period;
  }
  const double digit = std::pow(10.0, std::floor(std::log10(period)) - 1.0);
  const double meant = digit * std::round(period / digit);
  return std::abs(period / meant - 1.0) < kNearNumber ? meant : period;
}

Values unwrapped(const Values& values, double period) {
  Values out = values;
  double turns = 0.0, last = kAbsent;
  for (double& value : out) {
    if (!std::isfinite(value)) continue;
    if (std::isfinite(last)) turns -= std::round((value - last) / period);
    last = value;
    value += period * turns;
  }
  return out;
}

/// The rows where both are.
std::vector<std::size_t> rows_of_both(const AxisRecord& axis) {
  std::vector<std::size_t> out;
  for (std::size_t i = 0; i < std::min(axis.command.size(), axis.actual.size()); ++i) {
    if (std::isfinite(axis.command[i]) && std::isfinite(axis.actual[i])) out.push_back(i);
  }
  return out;
}

double variance_of_error(const Values& command, const Values& actual) {
  double sum = 0.0, squares = 0.0, count = 0.0;
  for (std::size_t i = 0; i < command.size(); ++i) {
    const double error = command[i] - actual[i];
    if (!std::isfinite(error)) continue;
    sum += error, squares += error * error, count += 1.0;
  }
  return count > 0.0 ? squares / count - sum * sum / count / count : 0.0;
}

/// Unwraps whichever of the two goes round, if they agree much better then.
std::optional<std::string> unwrap(AxisRecord& axis) {
  const double of_command = period_of(axis.command, axis.rotary),
               of_actual = period_of(axis.actual, axis.rotary);
  const double period = of_command > 0.0 ? of_command : of_actual;
  if (!(period > 0.0)) return std::nullopt;
  const bool alone = finite(axis.command).empty() || finite(axis.actual).empty();
  // Without the other one only a turn of a rotary axis is certain.
  const bool certain = axis.rotary && std::fmod(period, 0.5 * std::numbers::pi) < 1e-9;
  if (alone && !certain) return std::nullopt;
  const Values command = of_command > 0.0 ? unwrapped(axis.command, period) : axis.command;
  Values actual = of_actual > 0.0 ? unwrapped(axis.actual, period) : axis.actual;
  constexpr double kMaxVarianceRatio = 0.05;  // of the error, unwrapped over as it is
  if (!alone) {
    if (!(variance_of_error(command, actual) <
          kMaxVarianceRatio * variance_of_error(axis.command, axis.actual)))
      return std::nullopt;
    Values errors;
    for (std::size_t i = 0; i < command.size(); ++i) errors.push_back(command[i] - actual[i]);
    const double turns = std::round(median(finite(errors)) / period);
    for (double& value : actual) value += period * turns;
  }
  axis.command = command;
  axis.actual = std::move(actual);
  const char* who = of_command > 0.0 && of_actual > 0.0 ? "command and encoder go"
                    : of_command > 0.0                  ? "the command goes"
                                                        : "the encoder goes";
  return std::string(who) + " round at " + size(period, axis.rotary) + ": unwrapped";
}

/// The rows at which the command has stood for a while: servo and friction have settled.
std::vector<std::size_t> rows_at_rest(const AxisRecord& axis, double step_s) {
  constexpr double kSettled_s = 0.2;
  constexpr std::size_t kMinRows = 20;
  const std::size_t settled =
      std::max(kMinRows, static_cast<std::size_t>(kSettled_s / std::max(step_s, 1e-6)));
  std::vector<std::size_t> out;
  std::size_t stood = 0;
  double last = kAbsent;
  for (const std::size_t i : rows_of_both(axis)) {
    stood = axis.command[i] == last ? stood + 1 : 0;
    last = axis.command[i];
    if (stood >= settled) out.push_back(i);
  }
  return out.size() >= kMinRows ? out : std::vector<std::size_t>();
}

/// How far the encoder moves over how far its command moves, and what that leaves: RMS of the rest
/// over that of the motion.
struct Ratio {
  double ratio = 0.0, left = 0.0;
  bool at_rest = false;  ///< in motion a lag can look like a ratio
};

/// x = offset + ratio x_r + c1 x_r' + c2 x_r'' at these rows.
std::optional<Ratio> ratio_at(const AxisRecord& axis, const std::vector<std::size_t>& rows) {
  constexpr std::size_t kMinRows = 100;
  if (rows.size() < kMinRows) return std::nullopt;
  const auto n = static_cast<Eigen::Index>(rows.size());
  Eigen::MatrixXd columns(n, 4);
  Eigen::VectorXd actual(n);
  for (Eigen::Index k = 0; k < n; ++k) {
    const std::size_t i = rows[static_cast<std::size_t>(k)];
    const auto command = [&](std::size_t row) {
      const double value = row < axis.command.size() ? axis.command[row] : kAbsent;
      return std::isfinite(value) ? value : axis.command[i];
    };
    const double here = axis.command[i], left = command(i - 1), right = command(i + 1);
    columns.row(k) << 1.0, here, right - left, right - 2.0 * here + left;
    actual(k) = axis.actual[i];
  }
  const double motion = std::sqrt((columns.col(1).array() - columns.col(1).mean()).square().mean());
  if (!(motion > 0.0)) return std::nullopt;
  const Eigen::RowVectorXd scale = columns.colwise().norm().cwiseMax(1e-300);
  const Eigen::MatrixXd scaled = columns * scale.cwiseInverse().asDiagonal();
  const Eigen::VectorXd found = scaled.colPivHouseholderQr().solve(actual);
  const double left = std::sqrt((actual - scaled * found).squaredNorm() / static_cast<double>(n));
  const Ratio out{found(1) / scale(1), left / motion, false};
  return std::isfinite(out.ratio) ? std::optional(out) : std::nullopt;
}

/// From rest, where it rested at places far apart, else from all of the motion.
std::optional<Ratio> ratio_of(const AxisRecord& axis, const std::vector<std::size_t>& at_rest) {
  std::optional<Ratio> all = ratio_at(axis, rows_of_both(axis));
  if (!all || at_rest.empty()) return all;
  const auto by_command = [&](std::size_t a, std::size_t b) {
    return axis.command[a] < axis.command[b];
  };
  const auto [low, high] = std::minmax_element(at_rest.begin(), at_rest.end(), by_command);
  const Values moved = finite(axis.command);
  const auto [least, most] = std::minmax_element(moved.begin(), moved.end());
  constexpr double kMinRestSpan = 0.2;  // of the travel
  if (axis.command[*high] - axis.command[*low] < kMinRestSpan * (*most - *least)) return all;
  if (const std::optional<Ratio> rest = ratio_at(axis, at_rest)) {
    all->ratio = rest->ratio;
    all->at_rest = true;
  }
  return all;
}

void rescale(AxisRecord& axis, double factor, double offset) {
  for (double& value : axis.actual) value = factor * (value - offset);
}

std::optional<std::string> mend_zero(AxisRecord& axis, const std::vector<std::size_t>& at_rest,
                                     const PositionLimits& limits) {
  // In motion the following error looks like an offset.
  if (at_rest.empty()) return std::nullopt;
  Values errors;
  for (const std::size_t i : at_rest) errors.push_back(axis.actual[i] - axis.command[i]);
  if (errors.empty()) return std::nullopt;
  const double offset = median(errors);
  std::sort(errors.begin(), errors.end());
  const std::size_t edge = errors.size() / 100;
  const double spread = errors[errors.size() - 1 - edge] - errors[edge];
  constexpr double kOffsetOverSpread = 3.0;  // else it may be a lag of motion in one direction
  if (!(std::abs(offset) > (axis.rotary ? limits.offset_rad : limits.offset_m)) ||
      !(std::abs(offset) > kOffsetOverSpread * spread))
    return std::nullopt;
  rescale(axis, 1.0, offset);
  return "the zero of the encoder is " + size(offset, axis.rotary) +
         " from that of the command: subtracted";
}

/// A value that is refreshed at a regular interval and by various amounts is held in between. A
/// coarse encoder changes by its step, at intervals that depend on the speed.
std::optional<std::string> held(const AxisRecord& axis, double step_s) {
  Values intervals, sizes;
  std::size_t last = 0, repeats = 0, moving = 0;
  const std::vector<std::size_t> rows = rows_of_both(axis);
  for (std::size_t k = 1; k < rows.size(); ++k) {
    const double by = axis.actual[rows[k]] - axis.actual[rows[k - 1]];
    if (axis.command[rows[k]] == axis.command[rows[k - 1]]) {
      last = 0;
      continue;
    }
    ++moving;
    if (by == 0.0) {
      ++repeats;
      continue;
    }
    if (last > 0) {
      intervals.push_back(static_cast<double>(k - last));
      sizes.push_back(std::abs(by));
    }
    last = k;
  }
  constexpr std::size_t kMinRefreshes = 20;
  if (intervals.size() < kMinRefreshes) return std::nullopt;
  const double typical = median(intervals);
  constexpr double kMinInterval = 3.0;  // rows
  constexpr double kRegular = 0.7;   // share of the intervals within a quarter of the typical one
  constexpr double kMinSizes = 5.0;  // typical change over the least one
  const auto near = [&](double interval) { return std::abs(interval - typical) <= 0.25 * typical; };
  const auto regular = std::count_if(intervals.begin(), intervals.end(), near);
  if (typical < kMinInterval ||
      static_cast<double>(regular) < kRegular * static_cast<double>(intervals.size()) ||
      median(sizes) < kMinSizes * *std::min_element(sizes.begin(), sizes.end()))
    return std::nullopt;
  const double share = static_cast<double>(repeats) / static_cast<double>(moving);
  return "the encoder is refreshed every " + number(1e3 * typical * step_s) +
         " ms only: " + number(std::round(100.0 * share)) +
         " % of the rows in motion repeat the value before; the motion in between is not recorded";
}

}  // namespace

double period_of(const std::vector<double>& all, bool rotary) {
  const Values values = finite(all);
  if (values.size() < 20) return 0.0;
  const auto [low, high] = std::minmax_element(values.begin(), values.end());
  const double range = *high - *low;
  const auto step = [&](std::size_t i) { return values[i + 1] - values[i]; };
  const auto is_jump = [&](std::size_t i) { return std::abs(step(i)) > 0.5 * range; };
  Values periods;
  for (std::size_t i = 0; range > 0.0 && i + 1 < values.size(); ++i) {
    if (!is_jump(i)) continue;
    // The motion around the jump; it goes on in the same direction, against the jump.
    constexpr std::size_t kAround = 20;
    double sum = 0.0, count = 0.0;
    for (std::size_t k = i > kAround ? i - kAround : 0; k <= i + kAround; ++k) {
      if (k + 1 >= values.size() || is_jump(k)) continue;
      sum += step(k), count += 1.0;
    }
    const double motion = count > 0.0 ? sum / count : 0.0;
    if (motion * step(i) >= 0.0 || std::abs(motion) > 0.1 * range) return 0.0;
    periods.push_back(std::abs(step(i) - motion));
  }
  if (periods.empty() || periods.size() > values.size() / 10) return 0.0;
  const double period = median(periods);
  constexpr double kSame = 0.02;
  const auto same = [&](double one) { return std::abs(one / period - 1.0) <= kSame; };
  if (!std::all_of(periods.begin(), periods.end(), same) || range > (1.0 + kSame) * period)
    return 0.0;
  return rounded(period, rotary);
}

std::vector<std::string> mend_positions(Recording& recording, const PositionLimits& limits) {
  std::vector<std::string> out;
  double step_s = 0.0;
  if (recording.time.size() > 1) {
    Values steps;
    for (std::size_t i = 1; i < recording.time.size(); ++i)
      steps.push_back(recording.time[i] - recording.time[i - 1]);
    steps = finite(steps);
    if (!steps.empty()) step_s = median(std::move(steps));
  }
  for (AxisRecord& axis : recording.axes) {
    const auto say = [&](const std::optional<std::string>& line) {
      if (line) out.push_back(axis.name + ": " + *line);
    };
    say(unwrap(axis));
    const std::vector<std::size_t> at_rest = rows_at_rest(axis, step_s);
    if (const auto found = ratio_of(axis, at_rest); found && found->left < limits.unexplained) {
      const double ratio = std::abs(found->ratio);
      if (ratio > 0.5 && ratio < 2.0) {
        if (found->ratio < 0.0) {
          rescale(axis, -1.0, 0.0);
          say("the encoder counts against its command: its sign is reversed");
        }
        if (found->at_rest && std::abs(ratio - 1.0) > limits.ratio) {
          rescale(axis, 1.0 / ratio, 0.0);
          say("the encoder moves " + number(ratio) +
              " times as far as its command (gear ratio, unit or pitch of the screw): divided by "
              "that");
        }
        say(mend_zero(axis, at_rest, limits));
      }
    }
    say(held(axis, step_s));
  }
  return out;
}

}  // namespace servotwin
