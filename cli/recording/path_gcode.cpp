#include "cli/recording/path_gcode.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

#include "cli/common/output.h"

namespace servotwin::cli {
namespace {

using Path = std::vector<Eigen::ArrayXd>;
using Eigen::Index;

/// The squared distance of row k from the point that a move at constant feed between rows `first`
/// and `last` has reached at the same time. The distance from the chord is not enough: a correction
/// is valid at its time only, and a path may turn back on itself.
double from_move(const Path& path, Index first, Index last, Index k) {
  const double t = static_cast<double>(k - first) / static_cast<double>(last - first);
  double out = 0.0;
  for (const auto& axis : path)
    out += std::pow(axis(k) - axis(first) - t * (axis(last) - axis(first)), 2.0);
  return out;
}

/// The squared distance between two rows.
double distance(const Path& path, Index from, Index to) {
  double out = 0.0;
  for (const auto& axis : path) out += std::pow(axis(to) - axis(from), 2.0);
  return out;
}

/// A stretch of rows in which the original moves, or rests.
struct Stretch {
  Index first = 0, last = 0;
  bool rests = false;
};

std::vector<Stretch> stretches_of(const Path& original, double h) {
  const Index n = original.front().size();
  const auto shortest = static_cast<Index>(std::ceil(kRest_s / h));
  std::vector<Stretch> out;
  Index begin = 0;  // of the moving stretch
  for (Index k = 0; k < n;) {
    Index end = k;
    while (end + 1 < n && distance(original, end, end + 1) == 0.0) ++end;
    if (end - k >= shortest) {
      if (k > begin) out.push_back({begin, k, false});
      out.push_back({k, end, true});
      begin = end;
    }
    k = std::max(end, k + 1);
  }
  if (begin < n - 1) out.push_back({begin, n - 1, false});
  return out;
}

}  // namespace

std::vector<Index> chord_ends(const Path& path, Index first, Index last, double tolerance) {
  std::vector<Index> out{first, last};
  std::vector<std::pair<Index, Index>> open{{first, last}};
  while (!open.empty()) {
    const auto [from, to] = open.back();
    open.pop_back();
    double furthest = tolerance * tolerance;
    Index at = -1;
    for (Index k = from + 1; k < to; ++k) {
      const double d = from_move(path, from, to, k);
      if (d > furthest) furthest = d, at = k;
    }
    if (at < 0) continue;
    out.push_back(at);
    open.push_back({from, at});
    open.push_back({at, to});
  }
  std::sort(out.begin(), out.end());
  return out;
}

PathGcode path_gcode(const std::vector<PathAxisText>& axes, const Path& original, const Path& path,
                     double sample_time_s, double tolerance) {
  // In mm and degrees, rounded as written: feeds are computed from the numbers that the control
  // reads.
  const auto word = [&](std::size_t axis, Index k) {
    constexpr double kDigits = 1e6;
    const double unit = axes[axis].rotary ? 180.0 / std::numbers::pi : 1e3;
    return std::round(kDigits * unit * path[axis](k)) / kDigits;
  };
  const auto words = [&](Index k) {
    std::string out;
    for (std::size_t i = 0; i < axes.size(); ++i)
      out += text(" %s%.6f", axes[i].name.c_str(), word(i, k));
    return out;
  };
  // A feed counts along the linear axes; along the rotary ones where no other moves.
  const auto travel = [&](Index from, Index to) {
    double linear = 0.0, rotary = 0.0;
    for (std::size_t i = 0; i < axes.size(); ++i)
      (axes[i].rotary ? rotary : linear) += std::pow(word(i, to) - word(i, from), 2.0);
    return std::sqrt(linear > 0.0 ? linear : rotary);
  };
  PathGcode out;
  out.text = text("(corrected path; at any time within %.4g um or urad of it)\n", 1e6 * tolerance) +
             text("(original program: %.9g s)\n",
                  sample_time_s * static_cast<double>(path.front().size() - 1)) +
             "(feed in mm/min or deg/min; G4 P in seconds: if the control uses other units, "
             "convert)\nG90 G94 G21\nG1 F1000" +
             words(0) + "\n";
  // A move after a dwell begins where the one before it ended.
  const double settled = 0.25 * tolerance;
  Index at = 0;  // where the last move ended
  for (const Stretch& stretch : stretches_of(original, sample_time_s)) {
    // A corrected path may move while the original rests: towards its next start, or while it
    // settles.
    const std::vector<Index> ends =
        chord_ends(path, stretch.first, stretch.last, tolerance - settled);
    for (std::size_t i = 1; i < ends.size(); ++i) {
      const double seconds = sample_time_s * static_cast<double>(ends[i] - ends[i - 1]);
      const double length = std::sqrt(distance(path, at, ends[i]));
      if (length <= (stretch.rests ? settled : 0.0) || travel(at, ends[i]) == 0.0) {
        out.text += text("G4 P%.9g\n", seconds);
        continue;
      }
      const double feed = 60.0 * travel(at, ends[i]) / seconds;
      out.text += "G1" + words(ends[i]) + text(" F%.7g\n", feed);
      at = ends[i];
      ++out.moves;
    }
  }
  out.text += "M2\n";
  return out;
}

}  // namespace servotwin::cli
