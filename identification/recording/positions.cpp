#include "identification/recording/positions.h"

#include <optional>
#include <utility>

#include "identification/recording/order_statistics.h"
#include "identification/recording/regression.h"
#include "identification/recording/run_in.h"
#include "identification/recording/slow_command.h"
#include "identification/recording/spikes.h"
#include "identification/recording/turns.h"
#include "identification/recording/values.h"

namespace servotwin {
namespace {

using values::command_bend;
using values::command_slope;
using values::finite;
using values::number;
using values::range_of;
using values::size_text;
using values::Values;

/// The rows where both are.
std::vector<std::size_t> rows_of_both(const AxisRecord& axis) {
  std::vector<std::size_t> out;
  for (std::size_t i = 0; i < std::min(axis.command.size(), axis.actual.size()); ++i) {
    if (std::isfinite(axis.command[i]) && std::isfinite(axis.actual[i])) out.push_back(i);
  }
  return out;
}

/// Rows at which the command has stood for a while, each with the row at which that while began.
std::vector<std::pair<std::size_t, std::size_t>> standing(const AxisRecord& axis, double step_s) {
  constexpr double kWhile_s = 0.2;  // a servo of Kv 30/s is then within 0.3 % of its last lag
  constexpr std::size_t kMinRows = 20;
  const std::size_t window =
      std::max(kMinRows, static_cast<std::size_t>(kWhile_s / std::max(step_s, 1e-6)));
  const std::vector<std::size_t> rows = rows_of_both(axis);
  std::vector<std::pair<std::size_t, std::size_t>> out;
  std::size_t stood = 0;
  for (std::size_t k = 1; k < rows.size(); ++k) {
    stood = axis.command[rows[k]] == axis.command[rows[k - 1]] ? stood + 1 : 0;
    if (stood >= window) out.emplace_back(rows[k - window], rows[k]);
  }
  return out;
}

/// Standard deviation of the encoder where its command stands, by second differences: settling is
/// slow and hardly adds to them.
double noise_of(const AxisRecord& axis,
                const std::vector<std::pair<std::size_t, std::size_t>>& standing) {
  constexpr std::size_t kMaxMedianRows = 100'000;   // a median of that many is certain enough
  constexpr double kPerDeviation = 0.6745 * 2.449;  // median of |a - 2 b + c| of white noise
  Values bends;
  for (std::size_t k = 0; k < standing.size(); k += 1 + standing.size() / kMaxMedianRows) {
    const std::size_t i = standing[k].second;
    bends.push_back(std::abs(axis.actual[i] - 2.0 * axis.actual[i - 1] + axis.actual[i - 2]));
  }
  bends = finite(bends);
  return bends.empty() ? 0.0 : median(std::move(bends)) / kPerDeviation;
}

/// The rows at which command and encoder have come to rest. A slow axis (Kv 5/s) still moves when
/// its command has stood for a while.
std::vector<std::size_t> rows_at_rest(const AxisRecord& axis, double step_s) {
  constexpr std::size_t kMinRows = 20;
  constexpr double kMaxChange = 1e-4;  // of the travel: what is left to come is of that order, and
                                       // small against the least ratio that is repaired
  constexpr double kMaxNoise = 3.0;    // standard deviations
  const auto all = standing(axis, step_s);
  const double most =
      std::max(kMaxChange * range_of(axis.command), kMaxNoise * noise_of(axis, all));
  std::vector<std::size_t> out;
  for (const auto& [since, row] : all) {
    if (std::abs(axis.actual[row] - axis.actual[since]) <= most) out.push_back(row);
  }
  return out.size() >= kMinRows ? out : std::vector<std::size_t>();
}

/// How far the encoder moves over how far its command moves, and what that leaves: RMS of the rest
/// over that of the motion.
struct Ratio {
  double ratio = 0.0, left = 0.0;
  double ahead_rows = 0.0;  ///< of the command, at constant speed; negative: it lags; 0: not known
  bool at_rest = false;     ///< in motion a lag can look like a ratio
};

/// x = offset + ratio x_r + c1 x_r' + c2 x_r'' at these rows.
std::optional<Ratio> ratio_at(const AxisRecord& axis, const std::vector<std::size_t>& rows) {
  constexpr std::size_t kMinRows = 100;
  if (rows.size() < kMinRows) return std::nullopt;
  Regression<3> regression;
  double slopes = 0.0;
  for (const std::size_t i : rows) {
    slopes += command_slope(axis, i);
    regression.add(
        {axis.command[i], command_slope(axis, i), command_bend(axis, i), axis.actual[i]});
  }
  const double motion = regression.deviation(0);
  if (!(motion > 0.0)) return std::nullopt;
  const auto fit = regression.fit();
  // At one speed a lag is another zero of the encoder.
  constexpr double kMinVariation = 0.3;  // of the speed, over its mean
  const bool one_speed =
      regression.deviation(1) < kMinVariation * std::abs(slopes) / static_cast<double>(rows.size());
  // The slope of the command is twice its change per row.
  const Ratio out{fit.slopes(0), fit.rms / motion,
                  one_speed ? 0.0 : 2.0 * fit.slopes(1) / fit.slopes(0), false};
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
  constexpr double kMinRestSpan = 0.2;  // of the travel
  if (axis.command[*high] - axis.command[*low] < kMinRestSpan * range_of(axis.command)) return all;
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
  const double offset = quantile(errors, 0.5);
  const double spread = quantile(errors, 0.99) - quantile(errors, 0.01);
  constexpr double kOffsetOverSpread = 3.0;  // else it may be a lag of motion in one direction
  if (!(std::abs(offset) > (axis.rotary ? limits.offset_rad : limits.offset_m)) ||
      !(std::abs(offset) > kOffsetOverSpread * spread))
    return std::nullopt;
  const std::string size = size_text(offset, axis.rotary);
  const double other_zero = std::min(axis.rotary ? limits.other_zero_rad : limits.other_zero_m,
                                     limits.other_zero_share * range_of(axis.command));
  if (!(std::abs(offset) > other_zero)) {
    return "the encoder stands " + size +
           " from its command at rest; left as it is: if that is another zero, subtract " + size +
           " from the encoder in the file; if not, the axis does not reach its command (load, "
           "friction, no integral action)";
  }
  rescale(axis, 1.0, offset);
  return "the zero of the encoder is " + size + " from that of the command: subtracted";
}

/// A value that is refreshed at a regular interval and by various amounts is held in between. A
/// coarse encoder changes by its step, at intervals that depend on the speed. `other` tells which
/// rows are in motion.
struct Held {
  double period = 0.0;  // [rows]
  std::string words;
};

std::optional<Held> held(const AxisRecord& axis, const char* what, const std::vector<double>& value,
                         const std::vector<double>& other, double step_s) {
  Values intervals, sizes;
  std::size_t last = 0, repeats = 0, moving = 0;
  const std::vector<std::size_t> rows = rows_of_both(axis);
  for (std::size_t k = 1; k < rows.size(); ++k) {
    const double by = value[rows[k]] - value[rows[k - 1]];
    if (other[rows[k]] == other[rows[k - 1]]) {
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
  constexpr double kMinRegularShare =
      0.7;                           // share of the intervals within a quarter of the typical one
  constexpr double kMinSizes = 5.0;  // typical change over the least one
  const auto near = [&](double interval) { return std::abs(interval - typical) <= 0.25 * typical; };
  const auto regular = std::count_if(intervals.begin(), intervals.end(), near);
  if (typical < kMinInterval ||
      static_cast<double>(regular) < kMinRegularShare * static_cast<double>(intervals.size()) ||
      median(sizes) < kMinSizes * *std::min_element(sizes.begin(), sizes.end()))
    return std::nullopt;
  const double share = static_cast<double>(repeats) / static_cast<double>(moving);
  return Held{typical, std::string("the ") + what + " is refreshed every " +
                           number(1e3 * typical * step_s) +
                           " ms only: " + number(std::round(100.0 * share)) +
                           " % of the rows in motion repeat the value before; "};
}

constexpr const char* kNotRecorded = "the motion in between is not recorded";
constexpr const char* kInterpolated =
    "it is interpolated, as drives do (--as-recorded takes it as steps)";

/// A command that is recorded more slowly than the encoder beside it is interpolated.
std::optional<std::string> mend_command(AxisRecord& axis, double step_s) {
  std::size_t alone = 0, absent = 0;  // rows of the encoder without a command
  for (std::size_t i = 0; i < std::min(axis.command.size(), axis.actual.size()); ++i) {
    if (std::isfinite(axis.command[i])) continue;
    ++absent;
    alone += std::isfinite(axis.actual[i]) ? 1 : 0;
  }
  // Where both are absent, the rows are those of another axis.
  if (const double period = period_of_sparse(axis.command); period > 0.0 && 2 * alone > absent) {
    interpolate_refreshed(axis.command, period);
    return "the command is recorded every " + number(1e3 * period * step_s) +
           " ms only, the encoder in every row: it is interpolated, as drives do";
  }
  const auto slow = held(axis, "command", axis.command, axis.actual, step_s);
  if (!slow) return std::nullopt;
  interpolate_refreshed(axis.command, slow->period);
  return slow->words + kInterpolated;
}

double step_of(const std::vector<double>& time) {
  Values steps;
  for (std::size_t i = 1; i < time.size(); ++i) steps.push_back(time[i] - time[i - 1]);
  steps = finite(steps);
  return steps.empty() ? 0.0 : median(std::move(steps));
}

/// Positions in metres that are called millimetres.
std::optional<std::string> tiny(const AxisRecord& axis) {
  constexpr double kMaxTravel_m = 0.5e-3, kMaxStep_m = 0.5e-9;
  const double travel = range_of(axis.command);
  if (axis.rotary || !(travel > 0.0) || !(travel < kMaxTravel_m)) return std::nullopt;
  double step = HUGE_VAL;
  for (std::size_t i = 1; i < axis.actual.size(); ++i) {
    if (const double by = std::abs(axis.actual[i] - axis.actual[i - 1]); by > 0.0)
      step = std::min(step, by);
  }
  if (!(step < kMaxStep_m)) return std::nullopt;
  return "travels " + number(1e6 * travel) + " um in all, in steps of " + number(1e9 * step) +
         " nm: is their unit right? If the positions are in m, write [m] behind their names";
}

/// Sign, ratio and zero of the encoder, if it follows its command at all.
std::vector<std::string> mend_encoder(AxisRecord& axis, double step_s,
                                      const PositionLimits& limits) {
  std::vector<std::string> out;
  const std::vector<std::size_t> at_rest = rows_at_rest(axis, step_s);
  const std::optional<Ratio> found = ratio_of(axis, at_rest);
  if (!found || !(found->left < limits.unexplained)) return out;
  const double ratio = std::abs(found->ratio);
  if (!(ratio * kMaxEncoderRatio > 1.0 && ratio < kMaxEncoderRatio)) return out;
  if (found->ratio < 0.0) {
    rescale(axis, -1.0, 0.0);
    out.push_back("the encoder counts against its command: its sign is reversed");
  }
  if (found->at_rest && std::abs(ratio - 1.0) > limits.ratio) {
    rescale(axis, 1.0 / ratio, 0.0);
    out.push_back("the encoder moves " + number(ratio) +
                  " times as far as its command (gear ratio, unit or pitch of the screw): divided "
                  "by that");
  }
  if (const auto line = mend_zero(axis, at_rest, limits)) out.push_back(*line);
  constexpr double kMinAhead_rows = 2.0;  // less may be the order in which a cycle is recorded
  if (const double ahead_s = found->ahead_rows * step_s;
      found->ahead_rows > kMinAhead_rows && ahead_s > limits.ahead_s) {
    out.push_back("the encoder is " + number(std::round(1e4 * ahead_s) / 10.0) +
                  " ms ahead of its command at constant speed: more velocity feedforward than the "
                  "axis needs, or the two were not recorded at the same time");
  }
  return out;
}

/// The motor's encoder, which has faults of its own, is repaired as the only one of its axis. Its
/// zero is left: none of the load's is meant by it.
std::vector<std::string> mend_motor(AxisRecord& axis, const std::vector<double>& time,
                                    double step_s, PositionLimits limits) {
  std::vector<std::string> out;
  AxisRecord motor{axis.name, axis.rotary, axis.command, std::move(axis.actual_motor), {}, {}};
  limits.offset_m = limits.offset_rad = HUGE_VAL;
  if (const auto line = unwrap(motor)) out.push_back(*line);
  if (const auto line = leave_out_spikes(motor, time, step_s)) out.push_back(*line);
  for (const std::string& line : mend_encoder(motor, step_s, limits)) out.push_back(line);
  if (const auto slow = held(motor, "encoder", motor.actual, motor.command, step_s))
    out.push_back(slow->words + kNotRecorded);
  axis.actual_motor = std::move(motor.actual);
  return out;
}

}  // namespace

std::vector<std::string> mend_positions(Recording& recording, const std::string& only,
                                        const PositionLimits& limits) {
  std::vector<std::string> out;
  const double step_s = step_of(recording.time);
  for (AxisRecord& axis : recording.axes) {
    const auto say = [&](const std::string& line) { out.push_back(axis.name + ": " + line); };
    if (const auto line = unwrap(axis)) say(*line);
    if (const auto line = mend_command(axis, step_s)) say(*line);
    if (!only.empty() && axis.name != only) {
      // Its motion may act on the axis that is looked at, but is not what is asked about.
      (void)leave_out_spikes(axis, recording.time, step_s);
      (void)leave_out_run_in(axis, recording.time);
      (void)mend_encoder(axis, step_s, limits);
      continue;
    }
    // Not before: where positions go round, noise makes single values of the other end.
    if (const auto line = leave_out_spikes(axis, recording.time, step_s)) say(*line);
    if (const auto line = leave_out_run_in(axis, recording.time)) say(*line);
    if (const auto line = tiny(axis)) say(*line);
    for (const std::string& line : mend_encoder(axis, step_s, limits)) say(line);
    if (const auto slow = held(axis, "encoder", axis.actual, axis.command, step_s))
      say(slow->words + kNotRecorded);
    if (axis.actual_motor.empty()) continue;
    for (const std::string& line : mend_motor(axis, recording.time, step_s, limits))
      out.push_back(axis.name + ".actual_motor: " + line);
  }
  recording.notes.insert(recording.notes.end(), out.begin(), out.end());
  return out;
}

}  // namespace servotwin
