#include "daemon/cli/path_gcode.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

#include "daemon/cli/output.h"

namespace servotwin::cli {
namespace {

using Path = std::vector<Eigen::ArrayXd>;
using Eigen::Index;

/// Of row k from the chord between two others, squared.
double from_chord(const Path& path, Index first, Index last, Index k) {
  double along = 0.0, square = 0.0;
  for (const auto& axis : path) {
    const double chord = axis(last) - axis(first);
    along += (axis(k) - axis(first)) * chord;
    square += chord * chord;
  }
  const double t = square > 0.0 ? std::clamp(along / square, 0.0, 1.0) : 0.0;
  double out = 0.0;
  for (const auto& axis : path)
    out += std::pow(axis(k) - axis(first) - t * (axis(last) - axis(first)), 2.0);
  return out;
}

/// Between two rows, squared.
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
  Index begin = 0;  // of what moves
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
      const double d = from_chord(path, from, to, k);
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
  const auto words = [&](Index k) {
    std::string out;
    for (std::size_t i = 0; i < axes.size(); ++i) {
      const double unit = axes[i].rotary ? 180.0 / std::numbers::pi : 1e3;
      out += text(" %s%.6f", axes[i].name.c_str(), unit * path[i](k));
    }
    return out;
  };
  const bool all_rotary =
      std::all_of(axes.begin(), axes.end(), [](const PathAxisText& axis) { return axis.rotary; });
  PathGcode out;
  out.text = text("(corrected path; chords within %.4g um or urad of it)\n", 1e6 * tolerance) +
             text("(original program: %.3f s)\n",
                  sample_time_s * static_cast<double>(path.front().size() - 1)) +
             "(feed in mm/min or deg/min; G4 P in seconds: where the control counts otherwise, "
             "convert)\nG90 G94 G21\nG1 F1000" +
             words(0) + "\n";
  Index at = 0;  // where the last move ended
  for (const Stretch& stretch : stretches_of(original, sample_time_s)) {
    // A path may move while the original rests: towards its next start, or settling.
    const std::vector<Index> ends = chord_ends(path, stretch.first, stretch.last, tolerance);
    for (std::size_t i = 1; i < ends.size(); ++i) {
      const double seconds = sample_time_s * static_cast<double>(ends[i] - ends[i - 1]);
      const double length = std::sqrt(distance(path, at, ends[i]));
      if (length <= (stretch.rests ? tolerance : 0.0)) {
        out.text += text("G4 P%.3f\n", seconds);
        continue;
      }
      const double feed = 60.0 * length / seconds * (all_rotary ? 180.0 / std::numbers::pi : 1e3);
      out.text += "G1" + words(ends[i]) + text(" F%.4f\n", feed);
      at = ends[i];
      ++out.moves;
    }
  }
  out.text += "M2\n";
  return out;
}

}  // namespace servotwin::cli
