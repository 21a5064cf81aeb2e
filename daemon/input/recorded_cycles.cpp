#include "daemon/input/recorded_cycles.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "drivers/common/text.h"
#include "identification/recording/segments.h"
#include "identification/recording/stamps.h"

namespace servotwin::daemon {
namespace {

/// Calls `action` with every column that the recording has, time aside.
template <class R, class Action>
void for_each_column(R& recording, Action&& action) {
  for (auto& axis : recording.axes) {
    for (auto* column : {&axis.command, &axis.actual, &axis.actual_motor, &axis.torque}) {
      if (!column->empty()) action(*column);
    }
  }
}

bool same_values(const Recording& recording, std::size_t a, std::size_t b) {
  bool same = true;
  for_each_column(recording, [&](const std::vector<double>& column) {
    same = same && (column[a] == column[b] || (std::isnan(column[a]) && std::isnan(column[b])));
  });
  return same;
}

/// The position of a cycle between two rows; both are the same row if the cycle is that of a row.
struct Place {
  std::int64_t cycle = 0;
  std::size_t before = 0, after = 0;
  double share = 0.0;  // position between `before` (0) and `after` (1)

  [[nodiscard]] double in(const std::vector<double>& column) const {
    // NaN times zero is NaN: a row must not take what is missing in another.
    if (share == 0.0) return column[before];
    return column[before] + share * (column[after] - column[before]);
  }
};

std::vector<Place> numbered(const Stamps& stamps) {
  std::vector<Place> places;
  places.reserve(stamps.row.size());
  std::int64_t cycle = 0;
  for (std::size_t i = 0; i < stamps.row.size(); ++i) {
    cycle += stamps.advance[i];
    places.push_back({cycle, stamps.row[i], stamps.row[i], 0.0});
  }
  return places;
}

std::vector<Place> resampled(const Stamps& stamps) {
  const SegmentLimits limits;
  const double most_missing = std::max(static_cast<double>(limits.bridge_samples),
                                       std::floor(limits.bridge_gap_s / stamps.step_s + 1e-6));
  const auto cycles_to = [&](std::size_t i) {
    return (stamps.time[i] - stamps.time[0]) / stamps.step_s;
  };
  std::vector<Place> places{{0, stamps.row[0], stamps.row[0], 0.0}};
  for (std::size_t i = 1; i < stamps.row.size(); ++i) {
    const double from = cycles_to(i - 1), until = cycles_to(i);
    if (std::round(until - from) - 1.0 > most_missing) continue;
    const auto last = static_cast<long long>(std::floor(until));
    for (auto cycle = static_cast<long long>(std::floor(from)) + 1; cycle <= last; ++cycle) {
      places.push_back({cycle, stamps.row[i - 1], stamps.row[i],
                        (static_cast<double>(cycle) - from) / (until - from)});
    }
  }
  return places;
}

std::vector<std::string> notes_of(const std::string& source, const Stamps& stamps, std::size_t rows,
                                  std::size_t cycles) {
  std::vector<std::string> notes;
  const auto note = [&](std::size_t count, const std::string& what) {
    if (count > 0) notes.push_back(source + ": " + std::to_string(count) + what);
  };
  note(stamps.repeated, " rows dropped: the stamp of the row before was repeated");
  note(stamps.repaired, " wrong stamps replaced by the place between their neighbours");
  note(stamps.unplaced, " rows dropped: no usable stamp");
  if (stamps.resolution_s > 0.0) {
    notes.push_back(source + ": stamps are only written to " + number(1e3 * stamps.resolution_s) +
                    " ms: rows taken as evenly spaced at the mean step");
  }
  if (stamps.spacing == Spacing::kUneven) {
    notes.push_back(source + ": time stamps have a jitter of " + number(1e2 * stamps.jitter_rms) +
                    " % RMS of the step: " + std::to_string(rows) +
                    " rows resampled linearly onto " + std::to_string(cycles) + " cycles of " +
                    number(1e3 * stamps.step_s) + " ms");
  }
  return notes;
}

}  // namespace

RecordedCycles recorded_cycles(Recording recording) {
  const Stamps stamps =
      read_stamps(recording.source, recording.time,
                  [&](std::size_t a, std::size_t b) { return same_values(recording, a, b); });
  const std::vector<Place> places =
      stamps.spacing == Spacing::kEven ? numbered(stamps) : resampled(stamps);

  RecordedCycles out;
  out.cycle_s = stamps.step_s;
  out.notes = notes_of(recording.source, stamps, recording.time.size(), places.size());
  out.recording = std::move(recording);
  const auto place_all = [&](std::vector<double>& column) {
    std::vector<double> placed(places.size());
    std::transform(places.begin(), places.end(), placed.begin(),
                   [&](const Place& place) { return place.in(column); });
    column = std::move(placed);
  };
  for_each_column(out.recording, place_all);
  out.recording.time.resize(places.size());
  std::transform(places.begin(), places.end(), out.recording.time.begin(), [&](const Place& p) {
    return stamps.time[0] + static_cast<double>(p.cycle) * stamps.step_s;
  });
  return out;
}

}  // namespace servotwin::daemon
