#include "identification/recording/segments.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <stdexcept>
#include <utility>

#include "identification/recording/motion_range.h"
#include "identification/recording/time_shift.h"
#include "identification/recording/values.h"

namespace servotwin {
namespace {

bool same(double a, double b) { return a == b || (std::isnan(a) && std::isnan(b)); }

bool all_missing(const std::vector<double>& values) {
  return std::none_of(values.begin(), values.end(), [](double v) { return std::isfinite(v); });
}

const AxisRecord& find_axis(const Recording& recording, std::string_view name) {
  std::string there;
  for (const AxisRecord& axis : recording.axes) {
    if (axis.name == name) return axis;
    there += (there.empty() ? "" : ", ") + axis.name;
  }
  throw std::runtime_error(recording.source + ": no axis '" + std::string(name) + "'; it has " +
                           (there.empty() ? "none" : there));
}

/// The channels of one axis that go into segments, and which of them exist.
struct Channels {
  explicit Channels(const AxisRecord& axis, std::size_t rows)
      : command(axis.command),
        actual(axis.actual),
        actual_motor(axis.actual_motor),
        torque(axis.torque),
        has_actual(axis.actual.size() == rows && !all_missing(axis.actual)),
        has_motor(has_actual && axis.actual_motor.size() == rows &&
                  !all_missing(axis.actual_motor)),
        has_torque(axis.torque.size() == rows && !all_missing(axis.torque)) {}

  [[nodiscard]] bool valid(std::size_t row) const {
    return std::isfinite(command[row]) && (!has_actual || std::isfinite(actual[row]));
  }
  [[nodiscard]] bool same_values(std::size_t a, std::size_t b) const {
    return same(command[a], command[b]) && (!has_actual || same(actual[a], actual[b])) &&
           (!has_motor || same(actual_motor[a], actual_motor[b])) &&
           (!has_torque || same(torque[a], torque[b]));
  }

  const std::vector<double>& command;
  const std::vector<double>& actual;
  const std::vector<double>& actual_motor;
  const std::vector<double>& torque;
  bool has_actual, has_motor, has_torque;
};

/// Rows of one unbroken stretch, all with values, each with its place in steps from the first.
struct Stretch {
  std::vector<std::size_t> row;
  std::vector<double> place;

  [[nodiscard]] std::size_t samples() const {
    return static_cast<std::size_t>(std::floor(place.back() - place.front() + 1e-6)) + 1;
  }
};

/// Linear interpolation of one channel onto the whole steps of a stretch.
Eigen::ArrayXd interpolated(const Stretch& stretch, const std::vector<double>& values) {
  Eigen::ArrayXd even(static_cast<Eigen::Index>(stretch.samples()));
  std::size_t right = 0;
  for (Eigen::Index k = 0; k < even.size(); ++k) {
    const double at = stretch.place.front() + static_cast<double>(k);
    while (right + 1 < stretch.place.size() && stretch.place[right] < at) ++right;
    const double after = values[stretch.row[right]];
    const double beyond = stretch.place[right] - at;
    if (right == 0 || beyond <= 0.0) {
      even[k] = after;
      continue;
    }
    const double before = values[stretch.row[right - 1]];
    const double width = stretch.place[right] - stretch.place[right - 1];
    even[k] = after + (before - after) * (beyond / width);
  }
  return even;
}

/// Bridges short gaps of a channel that splits nothing; longer gaps, and gaps at an end, stay NaN.
void bridge(Eigen::ArrayXd& values, Eigen::Index most, SegmentReport::Gaps& gaps) {
  Eigen::Index i = 0;
  while (i < values.size()) {
    if (std::isfinite(values[i])) {
      ++i;
      continue;
    }
    Eigen::Index end = i;
    while (end < values.size() && !std::isfinite(values[end])) ++end;
    const bool inside = i > 0 && end < values.size();
    if (inside && end - i <= most) {
      const double slope = (values[end] - values[i - 1]) / static_cast<double>(end - i + 1);
      for (Eigen::Index k = i; k < end; ++k) values[k] = values[k - 1] + slope;
      gaps.bridged += static_cast<std::size_t>(end - i);
    } else {
      values.segment(i, end - i).setConstant(kAbsent);
      gaps.missing += static_cast<std::size_t>(end - i);
    }
    i = end;
  }
}

/// Collects rows into stretches and turns each into a segment.
class Cutter {
 public:
  Cutter(const Stamps& stamps, const Channels& channels, const SegmentLimits& limits,
         SegmentedAxis& out)
      : stamps_(stamps), channels_(channels), limits_(limits), out_(out) {
    const double step = stamps.step_s;
    most_missing_ = std::max(static_cast<double>(limits.bridge_samples),
                             std::floor(limits.bridge_gap_s / step + 1e-6));
  }

  void run() {
    std::size_t without_values = 0;  // rows since the last one that has values
    std::size_t last = 0;
    double place = 0.0;  // of the present row
    for (std::size_t i = 0; i < stamps_.row.size(); ++i) {
      const bool even = stamps_.spacing == Spacing::kEven;
      place = even ? place + static_cast<double>(stamps_.advance[i])
                   : (stamps_.time[i] - stamps_.time[0]) / stamps_.step_s;
      if (!channels_.valid(stamps_.row[i])) {
        ++without_values;
        continue;
      }
      if (stretch_.row.empty()) {
        out_.report.nan_dropped += without_values;
      } else {
        join(last, i, place, without_values);
      }
      stretch_.row.push_back(stamps_.row[i]);
      stretch_.place.push_back(place);
      if (stretch_.row.size() == 1) begin_s_ = stamps_.time[i];
      without_values = 0;
      last = i;
    }
    out_.report.nan_dropped += without_values;
    close();
  }

 private:
  // Row i follows row `last` of the stretch: over a bridge, or with a split between them.
  void join(std::size_t last, std::size_t i, double place, std::size_t without_values) {
    const double missing = std::round(place - stretch_.place.back()) - 1.0;
    const double length = stamps_.time[i] - stamps_.time[last];
    SegmentReport& report = out_.report;
    if (missing > most_missing_) {
      report.nan_dropped += without_values;
      close();
      report.splits.push_back({stamps_.time[last], length});
      return;
    }
    report.nan_bridged += without_values;
    if (missing < 1.0) return;
    report.gaps_bridged += 1;
    report.samples_bridged += static_cast<std::size_t>(missing);
    report.longest_bridged_s = std::max(report.longest_bridged_s, length);
  }

  void close() {
    if (stretch_.row.empty()) return;
    const std::size_t samples = stretch_.samples();
    SegmentReport& report = out_.report;
    longest_ = std::max(longest_, samples);
    if (samples < static_cast<std::size_t>(std::max(limits_.shortest, 2))) {
      report.short_stretches += 1;
      report.short_rows += stretch_.row.size();
    } else {
      Segment segment;
      segment.start_s = begin_s_;
      segment.sample_time_s = stamps_.step_s;
      segment.command = interpolated(stretch_, channels_.command);
      if (channels_.has_actual) segment.actual = interpolated(stretch_, channels_.actual);
      const auto most = static_cast<Eigen::Index>(most_missing_);
      if (channels_.has_motor) {
        segment.actual_motor = interpolated(stretch_, channels_.actual_motor);
        bridge(segment.actual_motor, most, report.motor);
      }
      if (channels_.has_torque) {
        segment.torque = interpolated(stretch_, channels_.torque);
        bridge(segment.torque, most, report.torque);
      }
      report.used_rows += stretch_.row.size();
      report.segments.push_back({segment.start_s, segment.end_s(), samples});
      out_.segments.push_back(std::move(segment));
    }
    stretch_ = {};
  }

 public:
  [[nodiscard]] std::size_t longest() const { return longest_; }

 private:
  const Stamps& stamps_;
  const Channels& channels_;
  const SegmentLimits& limits_;
  SegmentedAxis& out_;
  Stretch stretch_;
  double begin_s_ = 0.0;
  double most_missing_ = 0.0;
  std::size_t longest_ = 0;
};

using values::number;

// To the microsecond, without idle zeros.
std::string seconds(double value) {
  char text[64];
  std::snprintf(text, sizeof text, "%.6f", value);
  std::string shown = text;
  shown.erase(shown.find_last_not_of('0') + 1);
  if (shown.back() == '.') shown.pop_back();
  return shown + " s";
}
std::string milliseconds(double value_s) { return number(1e3 * value_s) + " ms"; }
std::string percent(double share) { return number(std::round(1e4 * share) / 100.0) + " %"; }
std::string count(std::size_t n, const std::string& what) {
  return std::to_string(n) + " " + what + (n == 1 ? "" : "s");
}

}  // namespace

std::vector<std::string> SegmentReport::lines() const {
  constexpr std::size_t kMaxListedEntries =
      8;  // segments and splits listed; more make the report unreadable
  std::vector<std::string> lines;
  const auto more = [](std::size_t n) {
    return n > kMaxListedEntries ? " and " + std::to_string(n - kMaxListedEntries) + " more"
                                 : std::string();
  };
  lines.push_back("axis " + axis + ": " + count(rows, "row") + " over " + seconds(duration_s) +
                  ", " + std::to_string(used_rows) + " used, step " + milliseconds(sample_time_s) +
                  " (" + number(rate_hz) + " Hz)");
  std::string list;
  for (std::size_t i = 0; i < std::min(segments.size(), kMaxListedEntries); ++i) {
    const Stretch& s = segments[i];
    list += (i == 0 ? ": " : ", ") + seconds(s.begin_s) + " to " + seconds(s.end_s) + " (" +
            count(s.samples, "sample") + ")";
  }
  lines.push_back(count(segments.size(), "segment") + list + more(segments.size()));
  list.clear();
  for (std::size_t i = 0; i < std::min(splits.size(), kMaxListedEntries); ++i) {
    list += (i == 0 ? "split at " : ", at ") + seconds(splits[i].time_s) + " by a gap of " +
            seconds(splits[i].length_s);
  }
  if (!splits.empty()) lines.push_back(list + more(splits.size()));
  if (short_stretches > 0) {
    lines.push_back("dropped " + count(short_rows, "row") + " in " +
                    std::to_string(short_stretches) + " too short to be a segment");
  }
  if (gaps_bridged > 0) {
    lines.push_back("bridged " + count(gaps_bridged, "gap") +
                    " by linear interpolation, the longest " + milliseconds(longest_bridged_s) +
                    "; " + count(samples_bridged, "sample") + " filled");
  }
  if (nan_bridged > 0) lines.push_back(count(nan_bridged, "row") + " without a value bridged");
  if (nan_dropped > 0) lines.push_back(count(nan_dropped, "row") + " without a value dropped");
  const auto say_gaps = [&](const Gaps& gaps, const std::string& what) {
    if (gaps.bridged > 0) lines.push_back(count(gaps.bridged, what) + " bridged");
    if (gaps.missing > 0) lines.push_back(count(gaps.missing, what) + " missing, not bridged");
  };
  say_gaps(motor, "motor encoder value");
  say_gaps(torque, "torque value");
  if (repeated > 0) {
    lines.push_back(count(repeated, "row") + " dropped: the stamp of the row before was repeated");
  }
  if (repaired > 0) {
    lines.push_back(count(repaired, "wrong stamp") +
                    " replaced by interpolation between the neighbours");
  }
  if (unplaced > 0) lines.push_back(count(unplaced, "row") + " dropped: no usable stamp");
  if (resolution_s > 0.0) {
    lines.push_back("stamps are only written to " + milliseconds(resolution_s) +
                    ": samples treated as evenly spaced at the mean step");
  }
  if (spacing == Spacing::kUneven) {
    lines.push_back("jitter " + percent(jitter_rms) + " of the step rms, " + percent(jitter_max) +
                    " at most: resampled linearly onto a grid of " + milliseconds(sample_time_s));
  } else if (jitter_max >= 1e-3) {
    lines.push_back("jitter " + percent(jitter_rms) + " of the step rms, " + percent(jitter_max) +
                    " at most: samples treated as evenly spaced");
  }
  return lines;
}

namespace {

SegmentedAxis segmented(const Recording& recording, std::string_view axis,
                        const SegmentLimits& limits) {
  const AxisRecord& record = find_axis(recording, axis);
  const std::size_t rows = recording.time.size();
  if (record.command.size() != rows || (rows > 0 && all_missing(record.command))) {
    throw std::runtime_error(recording.source + ": " + record.name +
                             ".command has no values; the setpoint of the axis is needed" +
                             (record.torque.empty()
                                  ? ""
                                  : ". Position and torque alone are explained by "
                                    "'servotwin diagnose'"));
  }
  const Channels channels(record, rows);
  const Stamps stamps = read_stamps(
      recording.source, recording.time,
      [&](std::size_t a, std::size_t b) { return channels.same_values(a, b); }, limits.stamps);

  SegmentedAxis out;
  out.source = recording.source;
  out.axis = record.name;
  out.rotary = record.rotary;
  out.torque_unit = channels.has_torque ? record.torque_unit : "";
  out.sample_time_s = stamps.step_s;
  SegmentReport& report = out.report;
  report.axis = record.name;
  report.rows = rows;
  report.duration_s = stamps.time.back() - stamps.time.front();
  report.sample_time_s = stamps.step_s;
  report.rate_hz = 1.0 / stamps.step_s;
  report.spacing = stamps.spacing;
  report.repeated = stamps.repeated;
  report.repaired = stamps.repaired;
  report.unplaced = stamps.unplaced;
  report.resolution_s = stamps.resolution_s;
  report.jitter_rms = stamps.jitter_rms;
  report.jitter_max = stamps.jitter_max;

  Cutter cutter(stamps, channels, limits, out);
  cutter.run();
  if (out.segments.empty() && rows < static_cast<std::size_t>(limits.shortest))
    throw std::runtime_error(recording.source + ": axis " + record.name + " has " +
                             count(rows, "row") + "; at least " + std::to_string(limits.shortest) +
                             " are needed");
  if (out.segments.empty()) {
    throw std::runtime_error(recording.source + ": axis " + record.name + " has no segment of " +
                             std::to_string(limits.shortest) +
                             " samples without a gap; the longest has " +
                             std::to_string(cutter.longest()) + " of " + count(rows, "row"));
  }
  set_length_scale(out.segments, out.rotary);
  return out;
}

/// Whether both were cut at the same samples.
bool in_step(const SegmentedAxis& left, const SegmentedAxis& right) {
  return std::equal(left.segments.begin(), left.segments.end(), right.segments.begin(),
                    right.segments.end(), [](const Segment& l, const Segment& r) {
                      return l.size() == r.size() && l.start_s == r.start_s;
                    });
}

/// Where readings are missing at the ends, as after a run-in, the axis moves as its command does.
void continue_to_the_ends(Eigen::ArrayXd& readings, const Eigen::ArrayXd& command) {
  const auto known = [&](Eigen::Index k) { return std::isfinite(readings(k)); };
  Eigen::Index first = 0, last = readings.size() - 1;
  while (first <= last && !known(first)) ++first;
  while (last > first && !known(last)) --last;
  if (first > last) return;
  for (Eigen::Index k = first - 1; k >= 0; --k)
    readings(k) = readings(k + 1) + command(k) - command(k + 1);
  for (Eigen::Index k = last + 1; k < readings.size(); ++k)
    readings(k) = readings(k - 1) + command(k) - command(k - 1);
}

}  // namespace

SegmentedAxis segment_axis(const Recording& recording, std::string_view axis,
                           const SegmentLimits& limits, std::string_view wanted) {
  SegmentedAxis out = segmented(recording, axis, limits);
  for (const AxisRecord& other : recording.axes) {
    if (other.name == out.axis || (!wanted.empty() && other.name != wanted) ||
        other.command.size() != recording.time.size() || all_missing(other.command))
      continue;
    // Its encoder as one whose gaps split nothing.
    SegmentedAxis neighbour;
    const auto stands_beside = [&](const std::vector<double>& actual) {
      AxisRecord bare{other.name, other.rotary, other.command, other.command, {}, {}, actual};
      Recording alone{recording.source, recording.time, {std::move(bare)}, {}};
      try {
        neighbour = segmented(alone, other.name, limits);
      } catch (const std::runtime_error&) {
        return false;  // an axis without segments cannot be the neighbour
      }
      return in_step(out, neighbour);
    };
    if (!stands_beside(other.actual) && !stands_beside({})) continue;
    out.neighbour = other.name;
    for (std::size_t i = 0; i < out.segments.size(); ++i) {
      out.segments[i].neighbour = std::move(neighbour.segments[i].command);
      Eigen::ArrayXd& motion = neighbour.segments[i].actual_motor;
      continue_to_the_ends(motion, out.segments[i].neighbour);
      const auto moves = [](const Eigen::ArrayXd& x) { return (x != x(0)).any(); };
      const bool dead = motion.size() > 0 && !moves(motion) && moves(out.segments[i].neighbour);
      if (motion.size() > 0 && motion.isFinite().all() && !dead)
        out.segments[i].neighbour_motion = std::move(motion);
      out.segments[i].in_plane = !out.rotary && !other.rotary;
    }
    break;
  }
  return out;
}

double append(SegmentedAxis& axis, SegmentedAxis next) {
  constexpr double kBetween_s = 1.0;      // a gap that no fit takes for motion
  constexpr double kMaxRateRatio = 1e-3;  // 1 ms and 1.0001 ms are one rate, measured twice
  const auto refuse = [&](const std::string& why) {
    throw std::runtime_error(next.source + " cannot be used together with " + axis.source + ": " +
                             why);
  };
  const auto apiece = [&](const std::string& this_one, const std::string& other) {
    return this_one + " there, " + other + " here";
  };
  if (next.rotary != axis.rotary)
    refuse("the axis is " +
           apiece(axis.rotary ? "rotary" : "linear", next.rotary ? "rotary" : "linear"));
  if (std::abs(next.sample_time_s / axis.sample_time_s - 1.0) > kMaxRateRatio) {
    refuse("one sample every " +
           apiece(milliseconds(axis.sample_time_s), milliseconds(next.sample_time_s)) +
           "; record both at one rate");
  }
  const auto all_have = [&](const Eigen::ArrayXd Segment::*values) {
    const auto has = [&](const Segment& s) { return (s.*values).size() == s.size(); };
    return std::all_of(axis.segments.begin(), axis.segments.end(), has) &&
           std::all_of(next.segments.begin(), next.segments.end(), has);
  };
  if ((axis.segments.front().actual.size() > 0) != (next.segments.front().actual.size() > 0))
    refuse("only one of them has an encoder");
  if (!axis.torque_unit.empty() && !next.torque_unit.empty() &&
      axis.torque_unit != next.torque_unit)
    refuse("the torque is in " + apiece(axis.torque_unit, next.torque_unit));
  const double begin_s = axis.segments.back().end_s() + kBetween_s;
  const double shift_s = begin_s - next.segments.front().start_s;
  const bool torque = all_have(&Segment::torque), motor = all_have(&Segment::actual_motor),
             neighbour = all_have(&Segment::neighbour) && axis.neighbour == next.neighbour,
             moves = neighbour && all_have(&Segment::neighbour_motion),
             cuts = all_have(&Segment::in_cut);
  for (Segment& s : next.segments) {
    s.start_s += shift_s;
    s.sample_time_s = axis.sample_time_s;
    axis.segments.push_back(std::move(s));
  }
  for (Segment& s : axis.segments) {
    if (!torque) s.torque.resize(0);
    if (!motor) s.actual_motor.resize(0);
    if (!neighbour) s.neighbour.resize(0), s.in_plane = false;
    if (!moves) s.neighbour_motion.resize(0);
    if (!cuts) s.in_cut.resize(0);
  }
  set_length_scale(axis.segments, axis.rotary);
  if (!torque) axis.torque_unit.clear();
  if (!neighbour) axis.neighbour.clear();
  axis.source += ", " + next.source;
  return begin_s;
}

bool has_torque(const SegmentedAxis& axis) {
  return std::any_of(axis.segments.begin(), axis.segments.end(),
                     [](const Segment& s) { return s.torque.size() > 0; });
}

Segment part_of(const Segment& whole, Eigen::Index begin, Eigen::Index size) {
  const auto channel = [&](const Eigen::ArrayXd& of) {
    return of.size() == whole.size() ? Eigen::ArrayXd(of.segment(begin, size)) : Eigen::ArrayXd();
  };
  Segment out;
  out.start_s = whole.start_s + whole.sample_time_s * static_cast<double>(begin);
  out.sample_time_s = whole.sample_time_s;
  out.command = channel(whole.command);
  out.actual = channel(whole.actual);
  out.actual_motor = channel(whole.actual_motor);
  out.torque = channel(whole.torque);
  out.neighbour = channel(whole.neighbour);
  out.neighbour_motion = channel(whole.neighbour_motion);
  out.in_cut = channel(whole.in_cut);
  out.in_plane = whole.in_plane;
  out.length_scale = whole.length_scale;
  out.lead = std::clamp<Eigen::Index>(whole.lead - begin, 0, size);
  return out;
}

std::vector<Segment> cut(const std::vector<Segment>& segments, double from_s, double to_s) {
  constexpr double kMinSamples = 20.0;
  std::vector<Segment> out;
  for (const Segment& s : segments) {
    const double h = s.sample_time_s;
    const double first = std::max(0.0, std::ceil((from_s - s.start_s) / h - 1e-9));
    const double last =
        std::min(static_cast<double>(s.size()) - 1.0, std::floor((to_s - s.start_s) / h + 1e-9));
    if (last - first + 1.0 < kMinSamples) continue;
    out.push_back(
        part_of(s, static_cast<Eigen::Index>(first), static_cast<Eigen::Index>(last - first) + 1));
  }
  return out;
}

std::vector<Segment> with_lead_in(const std::vector<Segment>& parts,
                                  const std::vector<Segment>& segments, double travel) {
  std::vector<Segment> out;
  auto whole = segments.begin();
  for (const Segment& part : parts) {
    const double middle = part.start_s + 0.5 * part.sample_time_s;
    while (whole + 1 != segments.end() && (whole + 1)->start_s < middle) ++whole;
    const Eigen::Index first = std::lround((part.start_s - whole->start_s) / part.sample_time_s);
    Eigen::Index begin = first;
    double low = part.actual(0), high = low;
    for (; begin > 0 && high - low < travel; --begin) {
      low = std::min(low, whole->actual(begin - 1));
      high = std::max(high, whole->actual(begin - 1));
    }
    out.push_back(part_of(*whole, begin, first - begin + part.size()));
    out.back().lead = std::max(out.back().lead, first - begin + part.lead);
  }
  return out;
}

void require_encoder(const SegmentedAxis& axis) {
  for (const Segment& segment : axis.segments) {
    if (segment.actual.size() == 0)
      throw UnusableRecording(axis.source + ": " + axis.axis +
                              ".actual has no values; the encoder is needed for comparison");
  }
}

void require_motion(const SegmentedAxis& axis) {
  require_encoder(axis);
  constexpr double kMinSamplingTime_s = 1e-5;  // ten times below that of the fastest drives
  // A slow position loop has its bandwidth at 5 Hz, which four samples in a period still show.
  constexpr double kMaxSamplingTime_s = 0.05;
  if (axis.sample_time_s < kMinSamplingTime_s) {
    throw UnusableRecording(axis.source + ": " + axis.axis + ": " +
                            number(1.0 / axis.sample_time_s) +
                            " samples per second is no rate of a servo: is the unit of the time "
                            "right?");
  }
  if (axis.sample_time_s > kMaxSamplingTime_s) {
    throw UnusableRecording(
        axis.source + ": " + axis.axis + ": one sample every " + number(axis.sample_time_s) +
        " s is too slow to identify a servo loop, whose transient lasts some "
        "10 ms: record at least every " +
        number(kMaxSamplingTime_s) + " s, better every ms. Is the time in ms or us?");
  }
  const auto require = [&](const char* channel, const Eigen::ArrayXd Segment::*values) {
    const std::string name = axis.source + ": " + axis.axis + "." + channel;
    Eigen::Index samples = 0;
    double lowest = HUGE_VAL, highest = -HUGE_VAL;
    for (const Segment& segment : axis.segments) {
      const Eigen::ArrayXd& x = segment.*values;
      samples += x.size();
      lowest = std::min(lowest, x.minCoeff());
      highest = std::max(highest, x.maxCoeff());
    }
    if (lowest < highest) return;
    throw std::runtime_error(name + " does not move: it is " + number(lowest) +
                             (axis.rotary ? " rad" : " m") + " in all " + std::to_string(samples) +
                             " samples; record a motion of the axis");
  };
  require("command", &Segment::command);
  require("actual", &Segment::actual);
  if (const std::string why = why_implausible(axis.segments, axis.rotary); !why.empty())
    throw UnusableRecording(axis.source + ": " + axis.axis + ".command " + why);
  if (const std::string why = why_not_following(axis.segments, axis.rotary); !why.empty())
    throw UnusableRecording(axis.source + ": " + axis.axis + ".actual " + why);
  if (const std::string why = why_at_another_time(axis.segments); !why.empty())
    throw UnusableRecording(axis.source + ": " + axis.axis + ".actual " + why);
}

}  // namespace servotwin
