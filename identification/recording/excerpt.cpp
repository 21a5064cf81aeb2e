#include "identification/recording/excerpt.h"

#include <algorithm>
#include <cmath>

#include "identification/recording/evidence.h"
#include "identification/recording/segments.h"

namespace servotwin {

namespace {

/// A window of a segment.
struct Window {
  const Segment* of = nullptr;
  Eigen::Index begin = 0, size = 0;
  double evidence_s = 0.0;

  [[nodiscard]] double length_s() const { return of->sample_time_s * static_cast<double>(size); }
  [[nodiscard]] double start_s() const {
    return of->start_s + of->sample_time_s * static_cast<double>(begin);
  }
};

/// Seconds of these stretches within a span of time.
double seconds_in(const std::vector<EvidenceStretch>& stretches, double from_s, double to_s) {
  double sum = 0.0;
  for (const EvidenceStretch& one : stretches) {
    if (one.shows == Evidence::kStandstill) continue;
    sum +=
        std::max(0.0, std::min(to_s, one.segment.end_s()) - std::max(from_s, one.segment.start_s));
  }
  return sum;
}

std::vector<Window> windows_of(const std::vector<Segment>& segments, double window_s) {
  const MotionScale scale = motion_scale(segments);
  std::vector<Window> out;
  for (const Segment& segment : segments) {
    const std::vector<EvidenceStretch> stretches = sorted_by_evidence({segment}, scale);
    const auto size = std::min<Eigen::Index>(
        segment.size(), std::max<Eigen::Index>(1, std::lround(window_s / segment.sample_time_s)));
    for (Eigen::Index begin = 0; begin + size <= segment.size(); begin += size) {
      Window window{&segment, begin, size, 0.0};
      window.evidence_s =
          seconds_in(stretches, window.start_s(),
                     window.start_s() + segment.sample_time_s * static_cast<double>(size));
      out.push_back(window);
    }
  }
  return out;
}

}  // namespace

std::vector<Segment> excerpt(const std::vector<Segment>& segments, const ExcerptLimits& limits) {
  double length_s = 0.0;
  for (const Segment& segment : segments)
    length_s += segment.sample_time_s * static_cast<double>(segment.size());
  if (length_s <= limits.longest_s) return segments;
  const std::vector<Window> windows = windows_of(segments, limits.window_s);
  // Windows of short segments are shorter: then more of each part are taken.
  std::vector<bool> taken(windows.size());
  double taken_s = 0.0;
  for (auto parts = static_cast<std::size_t>(std::lround(limits.used_s / limits.window_s));
       taken_s < limits.used_s; parts *= 2) {
    parts = std::min(parts, windows.size());
    for (std::size_t part = 0; part < parts && taken_s < limits.used_s; ++part) {
      std::size_t best = windows.size();
      for (std::size_t i = windows.size() * part / parts; i < windows.size() * (part + 1) / parts;
           ++i) {
        if (!taken[i] &&
            (best == windows.size() || windows[i].evidence_s > windows[best].evidence_s))
          best = i;
      }
      if (best == windows.size()) continue;
      taken[best] = true;
      taken_s += windows[best].length_s();
    }
    if (parts == windows.size()) break;
  }
  std::vector<Segment> out;
  const Window* last = nullptr;
  for (std::size_t i = 0; i < windows.size(); ++i) {
    if (!taken[i]) continue;
    const Window& window = windows[i];
    Eigen::Index begin = window.begin;
    if (last != nullptr && last->of == window.of && last->begin + last->size == window.begin) {
      begin -= out.back().size();
      out.pop_back();
    }
    out.push_back(part_of(*window.of, begin, window.begin + window.size - begin));
    last = &window;
  }
  return out;
}

}  // namespace servotwin
