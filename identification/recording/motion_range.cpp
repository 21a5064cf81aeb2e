#include "identification/recording/motion_range.h"

#include <algorithm>
#include <cmath>

namespace servotwin {

MotionRange motion_range(std::span<const Segment> segments) {
  MotionRange out;
  for (const Segment& segment : segments) {
    const double h = segment.sample_time_s;
    const Eigen::Index d = std::max<Eigen::Index>(1, std::lround(MotionRange::kSpan_s / h));
    const Eigen::Index steps = segment.size() - d;
    if (steps <= d) continue;
    const double span_s = h * static_cast<double>(d);
    const Eigen::ArrayXd v = (segment.command.tail(steps) - segment.command.head(steps)) / span_s;
    const double a = (v.tail(steps - d) - v.head(steps - d)).abs().maxCoeff() / span_s;
    out.speed = std::fmax(out.speed, v.abs().maxCoeff());
    out.acceleration = std::fmax(out.acceleration, a);
  }
  return out;
}

}  // namespace servotwin
