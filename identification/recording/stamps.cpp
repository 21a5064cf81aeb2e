#include "identification/recording/stamps.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <optional>
#include <stdexcept>

namespace servotwin {
namespace {

using SameValues = std::function<bool(std::size_t, std::size_t)>;

// Rows that belong to one unbroken stretch are no further apart than this many steps, for
// statistics.
constexpr double kMaxContiguousSteps = 3.0;
// Share of bad stamps up to which they count as accidents of the recorder.
constexpr double kMaxBadStampShare = 0.01;
constexpr std::size_t kFewestIrregular = 10;  // fewer irregular steps are no sign of coarse stamps

std::string text_of(double seconds) {
  char text[32];
  std::snprintf(text, sizeof text, "%.13g", seconds);
  return text;
}

std::optional<double> median_positive(std::vector<double> values) {
  std::erase_if(values, [](double v) { return !(v > 0.0 && std::isfinite(v)); });
  if (values.empty()) return std::nullopt;
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

std::vector<double> steps_of(const std::vector<double>& time) {
  std::vector<double> steps;
  steps.reserve(time.size());
  for (std::size_t i = 1; i < time.size(); ++i) steps.push_back(time[i] - time[i - 1]);
  return steps;
}

// The mean of the steps within [lowest, highest].
double mean_within(const std::vector<double>& steps, double lowest, double highest) {
  double sum = 0.0;
  std::size_t count = 0;
  for (const double step : steps) {
    if (step >= lowest && step <= highest) {
      sum += step;
      ++count;
    }
  }
  return count == 0 ? 0.0 : sum / static_cast<double>(count);
}

// A clock is not known to better than some ppm: within 10 ppm of a whole rate in hertz, or of four
// digits, the round number is what was meant, and all recordings of a machine get the same step.
double nominal_step(double step) {
  constexpr double kClockTolerance = 1e-5;
  const auto near = [&](double candidate) {
    return std::abs(candidate / step - 1.0) < kClockTolerance;
  };
  const double rate = std::round(1.0 / step);
  if (rate >= 1.0 && near(1.0 / rate)) return 1.0 / rate;
  const double per_digit = std::pow(10.0, 3.0 - std::floor(std::log10(step)));
  const double rounded = std::round(step * per_digit) / per_digit;
  return near(rounded) ? rounded : step;
}

/// Stamps on their way to an increasing sequence, each with its row.
class Repair {
 public:
  Repair(const std::string& source, const std::vector<double>& time, Stamps& stamps)
      : source_(source), stamps_(stamps), time_(stamps.time), row_(stamps.row) {
    time_ = time;
    row_.resize(time.size());
    for (std::size_t i = 0; i < row_.size(); ++i) row_[i] = i;
    const std::vector<double> steps = steps_of(time_);
    const auto median = median_positive(steps);
    if (!median) fail_standing();
    median_ = *median;
    // Coarse stamps have zero steps that count, so that the mean is right where the median is not.
    step_ = mean_within(steps, 0.0, kMaxContiguousSteps * median_);
  }

  [[nodiscard]] double step() const { return step_; }
  [[nodiscard]] double median_step() const { return median_; }

  void place_rows_without_stamp() {
    const auto stamped = [&](std::size_t i) { return std::isfinite(time_[i]); };
    for (std::size_t i = 0; i < time_.size(); ++i) {
      if (stamped(i)) continue;
      const bool between = i > 0 && i + 1 < time_.size() && stamped(i - 1) && stamped(i + 1);
      if (between && one_missing(i - 1, i + 1)) {
        replace(i, middle(i - 1, i + 1));
      } else {
        drop(i);
      }
    }
    compact();
  }

  void mend_backward_steps() {
    const std::size_t n = time_.size();
    const auto most = static_cast<std::size_t>(kMaxBadStampShare * static_cast<double>(n)) + 3;
    std::size_t accidents = 0;
    for (std::size_t i = 1; i < n; ++i) {
      if (time_[i] >= time_[i - 1]) continue;
      if (++accidents > most) fail_backward(i);
      mend_backward_step(i);
    }
    compact();
  }

  void drop_repeats(const SameValues& same_values) {
    const std::size_t n = time_.size();
    std::size_t before = 0;  // the last row that is kept
    for (std::size_t i = 1; i < n; ++i) {
      if (time_[i] > time_[before]) {
        before = i;
        continue;
      }
      // One wrong stamp looks like a repeat, with a hole on one side and values of its own.
      const bool own_values = !same_values(row_[before], row_[i]);
      if (own_values && i + 1 < n && one_missing(before, i + 1)) {
        replace(i, middle(before, i + 1));
        before = i;
      } else if (own_values && before > 0 && before + 1 == i && one_missing(before - 1, i)) {
        replace(before, middle(before - 1, i));
        before = i;
      } else {
        time_[i] = kDropped;
        ++stamps_.repeated;
      }
    }
    compact();
  }

 private:
  static constexpr double kDropped = -HUGE_VAL;

  // Is there room for exactly one row between these two?
  [[nodiscard]] bool one_missing(std::size_t a, std::size_t b) const {
    return std::abs(time_[b] - time_[a] - 2.0 * step_) <= 0.5 * step_;
  }
  [[nodiscard]] bool room_between(std::size_t a, std::size_t b) const {
    return time_[b] - time_[a] >= 1.5 * step_;
  }
  [[nodiscard]] double middle(std::size_t a, std::size_t b) const {
    return 0.5 * (time_[a] + time_[b]);
  }
  void replace(std::size_t i, double time) {
    time_[i] = time;
    ++stamps_.repaired;
  }
  void drop(std::size_t i) {
    time_[i] = kDropped;
    ++stamps_.unplaced;
  }

  // Row i is stamped before row i - 1: one of the two is wrong, and its neighbours tell which.
  void mend_backward_step(std::size_t i) {
    const std::size_t n = time_.size();
    const bool after = i + 1 < n, before = i >= 2;
    const bool last = !after && before && time_[i - 1] > time_[i - 2];
    const bool first = i == 1 && after && time_[2] > time_[1] && !room_between(1, 2);
    if (after && one_missing(i - 1, i + 1)) {
      replace(i, middle(i - 1, i + 1));
    } else if (before && one_missing(i - 2, i)) {
      replace(i - 1, middle(i - 2, i));
    } else if (first) {
      replace(0, time_[1] - step_);
    } else if (last) {
      replace(i, time_[i - 1] + step_);
    } else if (after && room_between(i - 1, i + 1)) {
      // Dropped rows take the stamp before them until compact(), so that the order stays to be
      // seen.
      dropped_.push_back(i);
      time_[i] = time_[i - 1];
    } else if (before && room_between(i - 2, i)) {
      dropped_.push_back(i - 1);
      time_[i - 1] = time_[i - 2];
    } else {
      fail_backward(i);
    }
  }

  // No step is forward: all stamps are the same, or none is there, or they run backwards.
  [[noreturn]] void fail_standing() const {
    for (std::size_t i = 1; i < time_.size(); ++i) {
      if (time_[i] < time_[i - 1]) fail_backward(i);
    }
    throw std::runtime_error(source_ + ": time does not advance: it is " + text_of(time_[0]) +
                             " s in every row that has one");
  }

  [[noreturn]] void fail_backward(std::size_t i) const {
    throw std::runtime_error(source_ + ": time runs backwards at row " +
                             std::to_string(row_[i] + 1) + ": " + text_of(time_[i]) + " s after " +
                             text_of(time_[i - 1]) +
                             " s; sort the rows, or split the file where its clock was set");
  }

  void compact() {
    for (const std::size_t i : dropped_) drop(i);
    dropped_.clear();
    std::size_t kept = 0;
    for (std::size_t i = 0; i < time_.size(); ++i) {
      if (time_[i] == kDropped) continue;
      time_[kept] = time_[i];
      row_[kept] = row_[i];
      ++kept;
    }
    time_.resize(kept);
    row_.resize(kept);
  }

  const std::string& source_;
  Stamps& stamps_;
  std::vector<double>& time_;
  std::vector<std::size_t>& row_;
  std::vector<std::size_t> dropped_;
  double median_ = 0.0, step_ = 0.0;
};

// The largest power of ten, down to a nanosecond, of which all stamps are multiples; 0 if there is
// none.
double resolution_of(const std::vector<double>& time, double median_step) {
  for (double exponent = std::floor(std::log10(kMaxContiguousSteps * median_step));
       exponent >= -9.0; --exponent) {
    const double unit = std::pow(10.0, exponent);
    const bool all = std::all_of(time.begin(), time.end(), [&](double t) {
      const double multiple = (t - time.front()) / unit;
      // A missing stamp (NaN) gives no information about the resolution.
      return !(std::abs(multiple - std::round(multiple)) > 1e-3);
    });
    if (all) return unit;
  }
  return 0.0;
}

// Do rows with a repeated stamp change their values as often as others? Copies do not.
bool repeats_are_samples(const Stamps& stamps, const SameValues& same_values) {
  std::size_t repeats = 0, repeats_changed = 0, others = 0, others_changed = 0;
  for (std::size_t i = 1; i < stamps.time.size(); ++i) {
    const bool changed = !same_values(stamps.row[i - 1], stamps.row[i]);
    const bool repeat = stamps.time[i] == stamps.time[i - 1];
    (repeat ? repeats : others) += 1;
    (repeat ? repeats_changed : others_changed) += changed ? 1 : 0;
  }
  return 2 * repeats_changed * others >= others_changed * repeats;
}

// The slope of the best straight line through the stamps over their row numbers, the same for all
// stretches. The ends alone would give it with an error of the resolution over the length.
double slope_of(const std::vector<double>& time, double longest_step) {
  double products = 0.0, squares = 0.0;
  for (std::size_t begin = 0, end = 0; begin < time.size(); begin = end) {
    double sum = 0.0;
    for (end = begin; end < time.size(); ++end) {
      if (end > begin && time[end] - time[end - 1] > longest_step) break;
      sum += time[end] - time[begin];
    }
    const auto rows = static_cast<double>(end - begin);
    for (std::size_t i = begin; i < end; ++i) {
      const double from_middle = static_cast<double>(i - begin) - 0.5 * (rows - 1.0);
      products += from_middle * (time[i] - time[begin] - sum / rows);
      squares += from_middle * from_middle;
    }
  }
  return squares > 0.0 ? products / squares : 0.0;
}

// The step if the stamps are those of even rows, rounded to the resolution; else nothing.
std::optional<double> even_step_behind(const Stamps& stamps, double resolution, double step,
                                       const SameValues& same_values) {
  const std::vector<double> steps = steps_of(stamps.time);
  // Rounding moves a step by less than one unit; what is longer is a gap.
  const double longest = step + 1.001 * resolution;
  const double slope = slope_of(stamps.time, longest);
  std::size_t irregular = 0;
  for (const double s : steps)
    irregular += s <= longest && std::abs(s - slope) > 0.1 * slope ? 1 : 0;
  if (irregular < kFewestIrregular || !repeats_are_samples(stamps, same_values))
    return std::nullopt;

  // Rows of an even grid stay within one unit of a straight line; true repeats wander off it. A
  // block of twenty irregular steps tells the two apart and is short enough for a clock that
  // drifts.
  const std::size_t block = std::max<std::size_t>(200, 20 * steps.size() / irregular);
  std::size_t blocks = 0, straight = 0, in_block = 0;
  double offset = 0.0, lowest = 0.0, highest = 0.0;
  for (std::size_t i = 0; i <= steps.size(); ++i) {
    const bool broken = i == steps.size() || steps[i] > longest;
    if (!broken) {
      offset += steps[i] - slope;
      lowest = std::min(lowest, offset);
      highest = std::max(highest, offset);
      ++in_block;
    }
    if (broken || in_block == block) {
      if (in_block > 0) {
        ++blocks;
        straight += highest - lowest <= 1.2 * resolution ? 1 : 0;
      }
      in_block = 0;
      offset = lowest = highest = 0.0;
    }
  }
  const bool mostly = static_cast<double>(straight) >= 0.9 * static_cast<double>(blocks);
  return mostly ? std::optional(slope) : std::nullopt;
}

// Steps of the grid between rows with coarse stamps: one, except over gaps. The stamps around a gap
// are averaged, because a single one is off by up to its resolution.
void place_coarse_rows(Stamps& stamps) {
  constexpr std::size_t kAveragedRows = 50;
  const std::vector<double>& t = stamps.time;
  const double longest = stamps.step_s + 1.001 * stamps.resolution_s;
  std::vector<std::size_t> begin{0};  // of each stretch, and the end of the last
  for (std::size_t i = 1; i < t.size(); ++i) {
    if (t[i] - t[i - 1] > longest) begin.push_back(i);
  }
  begin.push_back(t.size());
  // The time of row `at`, from rows of its stretch next to it.
  const auto place = [&](std::size_t at, std::size_t from, std::size_t to) {
    double sum = 0.0;
    for (std::size_t i = from; i < to; ++i) {
      sum += t[i] + (static_cast<double>(at) - static_cast<double>(i)) * stamps.step_s;
    }
    return sum / static_cast<double>(to - from);
  };
  stamps.advance.assign(t.size(), 1);
  for (std::size_t s = 1; s + 1 < begin.size(); ++s) {
    const std::size_t at = begin[s];
    const double after = place(at, at, std::min(at + kAveragedRows, begin[s + 1]));
    const double before =
        place(at - 1, std::max(begin[s - 1] + kAveragedRows, at) - kAveragedRows, at);
    stamps.advance[at] = std::max<std::int64_t>(1, std::llround((after - before) / stamps.step_s));
  }
}

void place_rows(Stamps& stamps, const StampLimits& limits) {
  const std::vector<double> steps = steps_of(stamps.time);
  const double median = median_positive(steps).value_or(0.0);
  stamps.step_s = mean_within(steps, 0.5 * median, 1.5 * median);

  stamps.advance.assign(stamps.time.size(), 1);
  std::size_t counted = 0, misplaced = 0;
  double squares = 0.0;
  for (std::size_t i = 0; i < steps.size(); ++i) {
    const double share = steps[i] / stamps.step_s;
    const double whole = std::max(1.0, std::round(share));
    stamps.advance[i + 1] = static_cast<std::int64_t>(whole);
    if (share > kMaxContiguousSteps) continue;
    const double off = std::abs(share - whole);
    ++counted;
    misplaced += off > limits.jitter_share ? 1 : 0;
    squares += off * off;
    stamps.jitter_max = std::max(stamps.jitter_max, off);
  }
  if (counted == 0) return;
  stamps.jitter_rms = std::sqrt(squares / static_cast<double>(counted));
  if (static_cast<double>(misplaced) > limits.misplaced_rows * static_cast<double>(counted)) {
    stamps.spacing = Spacing::kUneven;
    stamps.step_s = median;
    return;
  }
  // A row that is only stamped late causes a long and a short step, but no row is missing.
  for (std::size_t i = 0; i + 1 < steps.size(); ++i) {
    const bool late = stamps.advance[i + 1] == 2 && stamps.advance[i + 2] == 1 &&
                      std::llround((steps[i] + steps[i + 1]) / stamps.step_s) == 2;
    if (late) stamps.advance[i + 1] = 1;
  }
}

}  // namespace

Stamps read_stamps(const std::string& source, const std::vector<double>& time,
                   const SameValues& same_values, const StampLimits& limits) {
  if (time.size() < 2) {
    throw std::runtime_error(source + ": " + (time.empty() ? "no rows" : "only one row") +
                             ": a recording needs at least two to have a sampling time");
  }
  Stamps stamps;
  Repair repair(source, time, stamps);
  repair.place_rows_without_stamp();
  repair.mend_backward_steps();

  const double resolution = resolution_of(time, repair.median_step());
  if (resolution > limits.jitter_share * repair.step()) {
    if (const auto step = even_step_behind(stamps, resolution, repair.step(), same_values)) {
      stamps.resolution_s = resolution;
      stamps.step_s = *step;
      place_coarse_rows(stamps);
    }
  }
  if (stamps.advance.empty()) {
    repair.drop_repeats(same_values);
    place_rows(stamps, limits);
  }
  stamps.step_s = nominal_step(stamps.step_s);
  stamps.advance.front() = 0;
  return stamps;
}

}  // namespace servotwin
