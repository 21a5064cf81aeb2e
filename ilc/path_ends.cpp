#include "ilc/path_ends.h"

#include <algorithm>
#include <cmath>

#include "ilc/words.h"

namespace servotwin {
namespace {

using words::number;

constexpr double kStandstillTolerance = 1e-8;  // [m | rad]

/// How long an axis stands after the first row, or before the last row [s].
double rest_s(const Segment& path, bool at_end) {
  const Eigen::Index n = path.size();
  Eigen::Index k = 0;
  while (k + 1 < n) {
    const Eigen::Index next = at_end ? n - 2 - k : k + 1;
    if (std::abs(path.command(next) - path.command(at_end ? n - 1 : 0)) > kStandstillTolerance)
      break;
    ++k;
  }
  return path.sample_time_s * static_cast<double>(k);
}

}  // namespace

bool path_moves(const Segment& path) {
  return rest_s(path, false) < path.sample_time_s * (static_cast<double>(path.size()) - 1.5);
}

std::vector<std::string> short_rests(std::span<const LearnAxis> axes) {
  std::vector<std::string> out;
  for (const bool at_end : {false, true}) {
    const auto shortest =
        std::min_element(axes.begin(), axes.end(), [&](const LearnAxis& a, const LearnAxis& b) {
          return rest_s(a.path, at_end) < rest_s(b.path, at_end);
        });
    const double rest = rest_s(shortest->path, at_end);
    if (rest > kEndRest_s - 0.5 * shortest->path.sample_time_s) continue;
    out.push_back(shortest->name + " rests " + number(rest) + " s at the " +
                  (at_end ? "end" : "start") + " of the path" + ", less than " +
                  number(kEndRest_s) +
                  " s: the correction is 0 there and acts ahead of the motion, so that the error "
                  "next to that end remains; add a dwell at the " +
                  (at_end ? "end" : "start"));
  }
  return out;
}

}  // namespace servotwin
