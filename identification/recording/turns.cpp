#include "identification/recording/turns.h"

#include <utility>

#include "identification/recording/order_statistics.h"
#include "identification/recording/regression.h"
#include "identification/recording/values.h"

namespace servotwin {
namespace {

using values::command_bend;
using values::command_slope;
using values::finite;
using values::range_of;
using values::size_text;
using values::Values;

constexpr double kTurn = 2.0 * std::numbers::pi;
// Excess of a range over its period, and of one jump over another, by noise and speed.
constexpr double kPeriodTolerance = 0.02;

/// The multiple of `unit` with two digits that is nearest.
double two_digits(double period, double unit) {
  const double digit = std::pow(10.0, std::floor(std::log10(period / unit)) - 1.0);
  return unit * digit * std::round(period / unit / digit);
}

/// A period as it is meant: a part of a turn, a number of two digits in metres or inches, or a
/// power of two of counts of 1 um, 0.1 um, 10 nm or 1 nm.
double rounded(double period, bool rotary) {
  const auto near = [&](double meant, double tolerance) {
    return std::abs(period / meant - 1.0) < tolerance;
  };
  if (rotary) {
    constexpr double kTurnTolerance = 0.01;  // a part of a turn is likelier than a round number
    for (const double turns : {0.25, 0.5, 1.0, 2.0}) {
      if (near(kTurn * turns, kTurnTolerance)) return kTurn * turns;
    }
    return period;
  }
  // The other periods are further from a round number: 8.192 is 9.8e-4 from 8.2.
  constexpr double kNumberTolerance = 8e-4;
  // A following error of 20 um shifts a fit by 3e-5; there are many such numbers.
  constexpr double kRareTolerance = 1e-4;
  constexpr double kInch_m = 0.0254;
  if (const double meant = two_digits(period, 1.0); near(meant, kNumberTolerance)) return meant;
  if (const double meant = two_digits(period, kInch_m); near(meant, kRareTolerance)) return meant;
  for (const double count_m : {1e-6, 1e-7, 1e-8, 1e-9}) {
    const double meant = count_m * std::exp2(std::round(std::log2(period / count_m)));
    if (near(meant, kRareTolerance)) return meant;
  }
  return period;
}

/// Jumps of more than half of the range from one row to the next.
struct Jumps {
  Values sizes;           ///< less the motion around them
  bool as_motion = true;  ///< each against a motion that goes on in one direction
};

Jumps jumps_of(const Values& values) {
  const double range = range_of(values);
  const auto step = [&](std::size_t i) { return values[i + 1] - values[i]; };
  const auto is_jump = [&](std::size_t i) { return std::abs(step(i)) > 0.5 * range; };
  Jumps out;
  for (std::size_t i = 0; range > 0.0 && i + 1 < values.size(); ++i) {
    if (!is_jump(i)) continue;
    constexpr std::size_t kRowsOnEachSide = 20;  // rows
    double sum = 0.0, count = 0.0;
    for (std::size_t k = i > kRowsOnEachSide ? i - kRowsOnEachSide : 0; k <= i + kRowsOnEachSide;
         ++k) {
      if (k + 1 >= values.size() || is_jump(k)) continue;
      sum += step(k), count += 1.0;
    }
    const double motion = count > 0.0 ? sum / count : 0.0;
    constexpr double kMaxShareOfRange = 0.1;  // of the range per row; faster is a step
    if (motion * step(i) >= 0.0 || std::abs(motion) > kMaxShareOfRange * range)
      out.as_motion = false;
    out.sizes.push_back(std::abs(step(i) - motion));
  }
  return out;
}

/// Their mean, if they are few and all of one size, which the values do not exceed; else 0.
double mean_size(const Jumps& jumps, const Values& values) {
  constexpr double kMaxShare = 0.1;  // of the rows; more is a motion of steps
  if (jumps.sizes.empty() ||
      static_cast<double>(jumps.sizes.size()) > kMaxShare * static_cast<double>(values.size()))
    return 0.0;
  double mean = 0.0;
  for (const double size : jumps.sizes) mean += size / static_cast<double>(jumps.sizes.size());
  const auto same = [&](double size) { return std::abs(size / mean - 1.0) <= kPeriodTolerance; };
  const bool one_size = std::all_of(jumps.sizes.begin(), jumps.sizes.end(), same);
  return one_size && range_of(values) <= (1.0 + kPeriodTolerance) * mean ? mean : 0.0;
}

double variance_of_error(const Values& command, const Values& actual) {
  double sum = 0.0, squares = 0.0, count = 0.0;
  for (std::size_t i = 0; i < std::min(command.size(), actual.size()); ++i) {
    const double error = command[i] - actual[i];
    if (!std::isfinite(error)) continue;
    sum += error, squares += error * error, count += 1.0;
  }
  return count > 0.0 ? squares / count - sum * sum / count / count : 0.0;
}

/// A channel while it is unwrapped.
struct Channel {
  Channel(const Values& values, double a_period)
      : raw(values),
        out(values),
        period(a_period),
        goes_round(range_of(values) <= (1.0 + kPeriodTolerance) * a_period) {}

  /// `moved`: how far it should be from its last value, unless it is from the row before.
  void take(std::size_t row, double moved) {
    if (goes_round && any) turns -= std::round((raw[row] - raw[last] - moved) / period);
    out[row] += period * turns;
    turned = turned || turns != 0.0;
    last = row, any = true;
  }
  [[nodiscard]] bool has(std::size_t row) const {
    return row < raw.size() && std::isfinite(raw[row]);
  }
  [[nodiscard]] bool goes_on_at(std::size_t row) const { return any && last + 1 == row; }

  const Values& raw;
  Values out;
  double period;
  bool goes_round;
  double turns = 0.0;
  std::size_t last = 0;
  bool any = false, turned = false;
};

/// How far `other` moved since the last row of `channel`; 0 if it does not say.
double moved_meanwhile(const Channel& channel, const Channel& other, std::size_t row) {
  if (channel.goes_on_at(row) || !channel.any || !other.any || other.last != row) return 0.0;
  return other.has(channel.last) ? other.out[row] - other.out[channel.last] : 0.0;
}

/// Each by itself, and over its gaps by the other.
std::pair<Channel, Channel> unwrapped(const AxisRecord& axis, double period) {
  Channel command(axis.command, period), actual(axis.actual, period);
  for (std::size_t row = 0; row < std::max(axis.command.size(), axis.actual.size()); ++row) {
    // The one without a gap first: it tells the other.
    const bool encoder_first = actual.goes_on_at(row) && !command.goes_on_at(row);
    Channel& first = encoder_first ? actual : command;
    Channel& second = encoder_first ? command : actual;
    if (first.has(row)) first.take(row, moved_meanwhile(first, second, row));
    if (second.has(row)) second.take(row, moved_meanwhile(second, first, row));
  }
  return {std::move(command), std::move(actual)};
}

/// Greatest change from one row to the next, over the rows at which a turn was added, or the
/// others.
double greatest_step(const Values& raw, const Values& out, double period, bool where_turned) {
  double most = 0.0;
  for (std::size_t i = 1; i < raw.size(); ++i) {
    const double step = out[i] - out[i - 1];
    const bool turned = std::abs(step - (raw[i] - raw[i - 1])) > 0.5 * period;
    if (turned == where_turned && std::isfinite(step)) most = std::max(most, std::abs(step));
  }
  return most;
}

/// Whether nothing jumps where turns were added: a single false value is no turn.
bool seamless(const AxisRecord& axis, const Values& command, const Values& actual, double period) {
  constexpr double kMinSeam = 0.05;  // of the period: noise
  constexpr double kMaxSeam = 2.0;   // times the greatest step of the command elsewhere
  const double elsewhere = greatest_step(axis.command, command, period, false),
               of_command = greatest_step(axis.command, command, period, true);
  const auto fits = [&](double seam, double step) {
    return seam <= std::max(kMinSeam * period, kMaxSeam * step);
  };
  return fits(of_command, elsewhere) &&
         fits(greatest_step(axis.actual, actual, period, true), std::max(elsewhere, of_command));
}

/// Rows at which the encoder jumps by this much.
std::size_t jumps_by(const Values& values, double period) {
  std::size_t out = 0;
  for (std::size_t i = 1; i < values.size(); ++i) {
    if (std::abs(std::abs(values[i] - values[i - 1]) / period - 1.0) < kPeriodTolerance) ++out;
  }
  return out;
}

/// The period that fits best where one channel goes round and the other does not: every turn adds
/// its error. whole = c + ratio (wrapped + period turns) + lag terms of the command.
double fitted(const Channel& wrapped, const Channel& whole, const Values& unwrapped_command) {
  AxisRecord smooth;
  smooth.command = unwrapped_command;
  Regression<3> as_far;  // ratio 1
  Regression<4> any_ratio;
  for (std::size_t i = 0; i < smooth.command.size(); ++i) {
    if (!wrapped.has(i) || !whole.has(i)) continue;
    const double turns = std::round((wrapped.out[i] - wrapped.raw[i]) / wrapped.period);
    const double slope = command_slope(smooth, i), bend = command_bend(smooth, i);
    as_far.add({turns, slope, bend, whole.raw[i] - wrapped.raw[i]});
    any_ratio.add(
        (Regression<4>::Row() << turns, wrapped.raw[i], slope, bend, whole.raw[i]).finished());
  }
  // What the lag terms lack looks like a ratio of up to 1.001, which would add up with every turn.
  constexpr double kMinRatio = 0.003;  // deviation from 1; as PositionLimits::ratio
  const auto free = any_ratio.fit();
  return std::abs(free.slopes(1) - 1.0) < kMinRatio ? as_far.fit().slopes(0)
                                                    : free.slopes(0) / free.slopes(1);
}

/// The period of which jumps show that it is about `rough`.
double refined(const AxisRecord& axis, double rough) {
  const auto [command, actual] = unwrapped(axis, rough);
  double period = rough;  // where both go round, an error of it moves both
  if (command.goes_round != actual.goes_round) {
    period = command.goes_round ? fitted(command, actual, command.out)
                                : fitted(actual, command, command.out);
  }
  // A fit that leaves the jumps' own period is of something else.
  const bool fits = std::abs(period / rough - 1.0) < kPeriodTolerance;
  return rounded(fits ? period : rough, axis.rotary);
}

/// Periods to try, the likeliest first.
Values periods_to_try(const AxisRecord& axis) {
  Values out;
  if (axis.rotary) out.push_back(kTurn);
  for (const Values* channel : {&axis.command, &axis.actual}) {
    const Values values = finite(*channel);
    const double rough = mean_size(jumps_of(values), values);
    if (!(rough > 0.0)) continue;
    const double period = refined(axis, rough);
    if (out.empty() || std::abs(period / out.front() - 1.0) > kPeriodTolerance)
      out.push_back(period);
    break;
  }
  return out;
}

std::string done(bool command, bool actual, double period, bool rotary) {
  const char* who = command && actual ? "command and encoder go"
                    : command         ? "the command goes"
                                      : "the encoder goes";
  return std::string(who) + " round at " + size_text(period, rotary) + ": unwrapped";
}

/// Of a channel without the other one only a part of a turn of a rotary axis is certain.
std::optional<std::string> unwrap_alone(AxisRecord& axis) {
  const bool is_command = !finite(axis.command).empty();
  Values& values = is_command ? axis.command : axis.actual;
  const double period = period_of(values, axis.rotary);
  constexpr double kQuarter = 0.25 * kTurn, kRounding = 1e-9;
  if (!axis.rotary || !(period > 0.0) ||
      std::abs(std::remainder(period, kQuarter)) > kRounding * period)
    return std::nullopt;
  auto [command, actual] = unwrapped(axis, period);
  values = is_command ? std::move(command.out) : std::move(actual.out);
  return done(is_command, !is_command, period, axis.rotary);
}

/// Whole turns of all rows, so that command and encoder are within half a turn of one another.
void bring_together(const Values& command, Values& actual, double period) {
  Values errors;
  for (std::size_t i = 0; i < std::min(command.size(), actual.size()); ++i)
    errors.push_back(command[i] - actual[i]);
  errors = finite(errors);
  if (errors.empty()) return;
  const double turns = std::round(median(std::move(errors)) / period);
  for (double& value : actual) value += period * turns;
}

/// Each row of the encoder by the turns that bring it next to the command: for an axis that moves
/// more than half a turn in one row.
Values next_to(const Values& command, const Values& actual, double period) {
  Values out = actual;
  for (std::size_t i = 0; i < std::min(command.size(), actual.size()); ++i) {
    const double turns = std::round((command[i] - actual[i]) / period);
    if (std::isfinite(turns)) out[i] += period * turns;
  }
  return out;
}

std::optional<std::string> unwrap_at(AxisRecord& axis, double period) {
  auto [command, actual] = unwrapped(axis, period);
  if (!command.turned && !actual.turned) return std::nullopt;
  bring_together(command.out, actual.out, period);
  // Of the variance of the error, unwrapped over as it is. No encoder moves by a period in one row:
  // where it jumps, it must only not be worse, because an axis that steps is far from its command.
  constexpr double kMaxVarianceRatio = 0.05, kMaxVarianceRatioOfJumps = 1.0 + 1e-6;
  const double most =
      variance_of_error(axis.command, axis.actual) *
      (jumps_by(axis.actual, period) > 0 ? kMaxVarianceRatioOfJumps : kMaxVarianceRatio);
  double left = variance_of_error(command.out, actual.out);
  if (actual.goes_round) {
    Values nearest = next_to(command.out, axis.actual, period);
    const double of_nearest = variance_of_error(command.out, nearest);
    if (of_nearest < kMaxVarianceRatio * left) {
      left = of_nearest;
      actual.out = std::move(nearest);
    }
  }
  if (!(left <= most) || !seamless(axis, command.out, actual.out, period)) return std::nullopt;
  axis.command = std::move(command.out);
  axis.actual = std::move(actual.out);
  return done(command.turned, actual.turned, period, axis.rotary);
}

/// An encoder that jumps by a period although its command does not, or by a turn.
std::optional<std::string> left_wrapped(const AxisRecord& axis, const Values& periods) {
  for (const double period : periods) {
    const std::size_t jumps = jumps_by(axis.actual, period);
    if (jumps == 0 || range_of(axis.actual) > (1.0 + kPeriodTolerance) * period) continue;
    if (!axis.rotary && jumps_by(axis.command, period) > 0) continue;
    return "the encoder jumps by " + size_text(period, axis.rotary) + " within one row, " +
           std::to_string(jumps) + (jumps == 1 ? " time" : " times") +
           ", and does not agree with its command when it is unwrapped: left as recorded; check "
           "that both columns are of this axis, or unwrap the positions in the file";
  }
  return std::nullopt;
}

}  // namespace

double period_of(const std::vector<double>& all, bool rotary) {
  constexpr std::size_t kMinRows = 20;
  const Values values = finite(all);
  if (values.size() < kMinRows) return 0.0;
  const Jumps jumps = jumps_of(values);
  const double period = jumps.as_motion ? mean_size(jumps, values) : 0.0;
  return period > 0.0 ? rounded(period, rotary) : 0.0;
}

std::optional<std::string> unwrap(AxisRecord& axis) {
  const auto absent = [](const Values& values) {
    return std::none_of(values.begin(), values.end(), [](double v) { return std::isfinite(v); });
  };
  if (absent(axis.command) || absent(axis.actual)) return unwrap_alone(axis);
  const Values periods = periods_to_try(axis);
  for (const double period : periods) {
    if (std::optional<std::string> line = unwrap_at(axis, period)) return line;
  }
  return left_wrapped(axis, periods);
}

}  // namespace servotwin
