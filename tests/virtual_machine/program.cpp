#include "tests/virtual_machine/program.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>

#include "tests/virtual_machine/require.h"

namespace servotwin::virtual_machine {
namespace {

constexpr double kLongestMove =
    1.0;  // [s] at full velocity, so that slow moves do not fill the record

/// Uniform numbers, the same on every platform.
class Uniform {
 public:
  explicit Uniform(std::uint64_t seed) : engine_(seed) {}
  double between(double low, double high) {
    return low + (high - low) * (static_cast<double>(engine_() >> 11) * 0x1p-53);
  }
  double log_between(double low, double high) {
    return std::exp(between(std::log(low), std::log(high)));
  }

 private:
  std::mt19937_64 engine_;
};

}  // namespace

void PlanePath::dwell(double seconds) {
  x_.dwell(seconds);
  y_.dwell(seconds);
}

void PlanePath::line_to(double x, double y, const Limits& limits) {
  line_by(x - x_.end_position(), y - y_.end_position(), limits);
}

void PlanePath::line_by(double dx, double dy, const Limits& limits) {
  const double length = std::hypot(dx, dy);
  x_.line(dx, length, limits);
  y_.line(dy, length, limits);
}

void PlanePath::arc(double radius, double start_angle, double sweep, const Limits& limits) {
  x_.arc(radius, start_angle, sweep, limits);
  y_.arc(radius, start_angle - std::numbers::pi / 2.0, sweep, limits);
}

void reverse(Trajectory& trajectory, double amplitude, int count, const Limits& limits) {
  const double from = trajectory.end_position();
  for (int i = 0; i < count; ++i) trajectory.move_to(i % 2 == 0 ? from + amplitude : from, limits);
}

Trajectory moves(const MoveMix& mix, std::uint64_t seed) {
  require_positive(mix.duration, "move_mix.duration");
  require_positive(mix.stroke, "move_mix.stroke");
  require_positive(mix.slowest, "move_mix.slowest");
  require_positive(mix.longest_dwell, "move_mix.longest_dwell");
  Uniform uniform(seed);
  Trajectory trajectory;
  const auto with_velocity = [&](double velocity) {
    Limits limits = mix.limits;
    limits.velocity = velocity;
    return limits;
  };
  trajectory.dwell(std::min(0.2, mix.duration / 4.0));
  for (;;) {
    Trajectory next = trajectory;
    if (uniform.between(0.0, 1.0) < 0.2) {
      const double amplitude = uniform.log_between(1e-4, 1e-3);
      reverse(next, amplitude, 4, with_velocity(uniform.between(5.0, 20.0) * amplitude));
    } else {
      const double velocity = uniform.log_between(mix.slowest, 1.0) * mix.limits.velocity;
      const double here = next.end_position();
      const double reach = velocity * kLongestMove;
      next.move_to(std::clamp(uniform.between(-0.5, 0.5) * mix.stroke, here - reach, here + reach),
                   with_velocity(velocity));
    }
    next.dwell(uniform.between(0.01, mix.longest_dwell));
    if (next.duration() > mix.duration) break;
    trajectory = next;
  }
  if (trajectory.duration() < mix.duration) trajectory.dwell(mix.duration - trajectory.duration());
  return trajectory;
}

}  // namespace servotwin::virtual_machine
