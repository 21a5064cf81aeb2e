#include "identification/recording/evidence.h"

#include <algorithm>
#include <cmath>

#include "identification/recording/order_statistics.h"
#include "identification/recording/segments.h"

namespace servotwin {

namespace {

constexpr double kDifferenceSpan_s = 0.01;  // d of the differences [s]
constexpr double kMinLongLegRatio = 0.8;    // least length of a long leg over that of the longest

struct CommandedMotion {
  Eigen::ArrayXd speed, acceleration;  // without sign
};

/// Nothing where the segment is shorter than the differences.
CommandedMotion motion_of(const Segment& s) {
  const auto d = std::max<Eigen::Index>(
      1, static_cast<Eigen::Index>(std::lround(kDifferenceSpan_s / s.sample_time_s)));
  const Eigen::Index n = s.size(), inner = n - 4 * d;
  CommandedMotion out;
  if (inner < 1) return out;
  const double twice = 2.0 * static_cast<double>(d) * s.sample_time_s;
  const Eigen::ArrayXd& x = s.command;
  // At the ends, where no difference exists, the nearest value is used.
  out.speed.resize(n);
  out.speed.segment(d, n - 2 * d) = (x.tail(n - 2 * d) - x.head(n - 2 * d)).abs() / twice;
  out.speed.head(d).setConstant(out.speed(d));
  out.speed.tail(d).setConstant(out.speed(n - 1 - d));
  out.acceleration.resize(n);
  out.acceleration.segment(2 * d, inner) =
      (x.tail(inner) - 2.0 * x.segment(2 * d, inner) + x.head(inner)).abs() / (twice * twice);
  out.acceleration.head(2 * d).setConstant(out.acceleration(2 * d));
  out.acceleration.tail(2 * d).setConstant(out.acceleration(n - 1 - 2 * d));
  return out;
}

Eigen::Index samples(const Segment& s, double seconds) {
  return std::max<Eigen::Index>(1,
                                static_cast<Eigen::Index>(std::lround(seconds / s.sample_time_s)));
}

/// From one sample until before another.
struct Range {
  Eigen::Index begin = 0, end = 0;
};

/// The runs of samples for which `holds`.
template <class Holds>
std::vector<Range> runs(Eigen::Index size, Holds&& holds) {
  std::vector<Range> out;
  for (Eigen::Index i = 0; i < size; ++i) {
    if (!holds(i)) continue;
    if (out.empty() || out.back().end != i) out.push_back({i, i});
    out.back().end = i + 1;
  }
  return out;
}

/// The gaps between the ranges, within another range.
std::vector<Range> between(const std::vector<Range>& ranges, const Range& within) {
  std::vector<Range> out;
  Eigen::Index begin = within.begin;
  for (const Range& r : ranges) {
    if (r.begin > begin) out.push_back({begin, r.begin});
    begin = r.end;
  }
  if (within.end > begin) out.push_back({begin, within.end});
  return out;
}

/// The runs of at least this many samples in which the command is the same.
std::vector<Range> rests(const Eigen::ArrayXd& x, const Range& within, Eigen::Index least) {
  std::vector<Range> out;
  Eigen::Index begin = within.begin;
  for (Eigen::Index i = begin + 1; i <= within.end; ++i) {
    if (i < within.end && x(i) == x(begin)) continue;
    if (i - begin >= least) out.push_back({begin, i});
    begin = i;
  }
  return out;
}

/// The samples at which the command reverses, with more than `least` travel on either side, and
/// both ends.
std::vector<Eigen::Index> turns(const Eigen::ArrayXd& x, const Range& range, double least) {
  std::vector<Eigen::Index> out{range.begin};
  Eigen::Index low = range.begin, high = range.begin;
  int direction = 0;
  for (Eigen::Index i = range.begin; i < range.end; ++i) {
    if (x(i) > x(high)) high = i;
    if (x(i) < x(low)) low = i;
    if (direction >= 0 && x(high) - x(i) >= least) {
      if (direction > 0) out.push_back(high);
      direction = -1;
      low = i;
    } else if (direction <= 0 && x(i) - x(low) >= least) {
      if (direction < 0) out.push_back(low);
      direction = 1;
      high = i;
    }
  }
  out.push_back(range.end);
  return out;
}

/// The parts of a range in which the axis reverses slowly at least twice in a row.
std::vector<Range> slow_reversals(const Segment& s, const CommandedMotion& motion,
                                  const Range& range, double slow, double least) {
  const std::vector<Eigen::Index> at = turns(s.command, range, least);
  std::vector<Range> out;
  std::size_t first = 0;  // of the legs that are slow without a break
  for (std::size_t leg = 0; leg + 1 < at.size(); ++leg) {
    const bool counts = motion.speed.segment(at[leg], at[leg + 1] - at[leg]).maxCoeff() <= slow;
    if (counts && leg + 2 < at.size()) continue;
    // Three legs have two reversals between them.
    if (const std::size_t last = counts ? leg + 1 : leg; last >= first + 3)
      out.push_back({at[first], at[last]});
    first = leg + 1;
  }
  return out;
}

Segment part(const Segment& s, const Range& range) {
  return part_of(s, range.begin, range.end - range.begin);
}

void sort_segment(const Segment& s, const MotionScale& scale, const EvidenceLimits& limits,
                  std::vector<EvidenceStretch>& out) {
  const CommandedMotion motion = motion_of(s);
  if (motion.speed.size() == 0) return;
  const Eigen::Index response = samples(s, limits.response_s);

  std::vector<Range> fast;
  for (const Range& r : runs(s.size(), [&](Eigen::Index i) {
         return motion.acceleration(i) > 0.0 &&
                motion.acceleration(i) >= limits.fast * scale.acceleration;
       })) {
    const Range wide{std::max<Eigen::Index>(0, r.begin - response),
                     std::min(s.size(), r.end + response)};
    // A stretch between two of them that is too short is no evidence.
    if (!fast.empty() && wide.begin - fast.back().end < response) {
      fast.back().end = wide.end;
    } else {
      fast.push_back(wide);
    }
  }

  std::vector<std::pair<Range, Evidence>> found;
  for (const Range& r : fast) found.emplace_back(r, Evidence::kFastMotion);
  for (const Range& quiet : between(fast, {0, s.size()})) {
    const std::vector<Range> standing = rests(s.command, quiet, samples(s, limits.rest_s));
    for (const Range& r : standing) found.emplace_back(r, Evidence::kStandstill);
    for (const Range& moving : between(standing, quiet)) {
      for (const Range& r :
           slow_reversals(s, motion, moving, limits.slow * scale.velocity, limits.presliding))
        found.emplace_back(r, Evidence::kSlowReversals);
    }
  }
  std::sort(found.begin(), found.end(),
            [](const auto& l, const auto& r) { return l.first.begin < r.first.begin; });
  for (const auto& [range, shows] : found) {
    if (range.end - range.begin >= response) out.push_back({shows, part(s, range)});
  }
}

}  // namespace

Eigen::Index lead_in(const Segment& slow, const EvidenceLimits& limits) {
  // Travel of the encoder, not of the command: friction delays the axis.
  const Eigen::ArrayXd& x = slow.actual;
  const std::vector<Eigen::Index> at = turns(x, {0, slow.size()}, limits.presliding);
  const auto travel = [&](std::size_t leg) {
    return std::abs(x(std::min(at[leg + 1], slow.size() - 1)) - x(at[leg]));
  };
  double longest = 0.0;
  for (std::size_t leg = 0; leg + 1 < at.size(); ++leg) longest = std::max(longest, travel(leg));
  const double wipes_out = std::min(kMinLongLegRatio * longest, limits.forgets);
  std::size_t leg = 0;
  while (travel(leg) < wipes_out) ++leg;
  return std::min(slow.size(), std::max(at[leg + 1], samples(slow, limits.response_s)));
}

MotionScale motion_scale(const std::vector<Segment>& segments) {
  std::vector<double> speeds, accelerations;
  for (const Segment& s : segments) {
    const CommandedMotion motion = motion_of(s);
    for (Eigen::Index i = 0; i < motion.speed.size(); ++i) {
      if (motion.speed(i) == 0.0 && motion.acceleration(i) == 0.0) continue;
      speeds.push_back(motion.speed(i));
      accelerations.push_back(motion.acceleration(i));
    }
  }
  return {quantile(std::move(speeds), kPeakQuantile),
          quantile(std::move(accelerations), kPeakQuantile)};
}

MotionScale wider(const MotionScale& left, const MotionScale& right) {
  return {std::max(left.velocity, right.velocity), std::max(left.acceleration, right.acceleration)};
}

std::vector<EvidenceStretch> sorted_by_evidence(const std::vector<Segment>& segments,
                                                const MotionScale& scale,
                                                const EvidenceLimits& limits) {
  std::vector<EvidenceStretch> out;
  for (const Segment& s : segments) sort_segment(s, scale, limits, out);
  return out;
}

}  // namespace servotwin
