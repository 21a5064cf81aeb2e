#include "twin/feed_axis/reversing_motion.h"

#include <array>
#include <cmath>
#include <stdexcept>

namespace servotwin {
namespace {

/// A stretch of constant acceleration, from where the one before ends.
struct Stretch {
  double duration = 0.0, acceleration = 0.0;
  double start = 0.0, position = 0.0, velocity = 0.0;
};

}  // namespace

Eigen::ArrayXd sampled(const ReversingMotion& motion, double rate_hz) {
  if (!(motion.speed > 0.0 && motion.travel > 0.0 && motion.acceleration > 0.0 &&
        motion.half_s >= 0.0 && motion.rest_s >= 0.0 && motion.cycles > 0 && rate_hz > 0.0))
    throw std::invalid_argument(
        "a reversing motion needs a speed, a travel, an acceleration and cycles above 0");
  const double a = motion.acceleration, half = motion.half_s,
               most = a * (std::hypot(half, 2.0 * std::sqrt(motion.travel / a)) - half) / 2.0,
               v = std::min(motion.speed, most), ramp = v / 2.0 / a,
               cruise = std::max(0.0, (motion.travel - v * v / a - v * half) / v);
  std::array<Stretch, 8> way{{{ramp, a},
                              {half, 0.0},
                              {ramp, a},
                              {cruise, 0.0},
                              {ramp, -a},
                              {half, 0.0},
                              {ramp, -a},
                              {motion.rest_s, 0.0}}};
  for (std::size_t i = 1; i < way.size(); ++i) {
    const Stretch& last = way[i - 1];
    const double t = last.duration;
    way[i].start = last.start + t;
    way[i].position = last.position + t * (last.velocity + t * last.acceleration / 2.0);
    way[i].velocity = last.velocity + t * last.acceleration;
  }
  const double one_way = way.back().start + way.back().duration,
               all = 2.0 * motion.cycles * one_way;
  Eigen::ArrayXd out(static_cast<Eigen::Index>(std::floor(all * rate_hz + 1e-9)) + 1);
  for (Eigen::Index k = 0; k < out.size(); ++k) {
    const double time = static_cast<double>(k) / rate_hz,
                 turns = std::min(std::floor(time / one_way), 2.0 * motion.cycles - 1.0),
                 here = time - turns * one_way;
    std::size_t i = 0;
    while (i + 1 < way.size() && here >= way[i + 1].start) ++i;
    const double t = here - way[i].start,
                 gone = way[i].position + t * (way[i].velocity + t * way[i].acceleration / 2.0);
    out(k) = std::fmod(turns, 2.0) == 0.0 ? gone : motion.travel - gone;
  }
  return out;
}

}  // namespace servotwin
