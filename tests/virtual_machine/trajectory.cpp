#include "tests/virtual_machine/trajectory.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <stdexcept>
#include <string>

#include "tests/virtual_machine/require.h"

namespace servotwin::virtual_machine {
namespace {

/// Durations of the ramps of a symmetric seven-phase move.
struct Profile {
  double jerk_time = 0.0;
  double constant_acceleration_time = 0.0;
  double cruise_time = 0.0;
};

Profile profile_of(double stroke, const Limits& limits) {
  const double a = limits.acceleration;
  const double j = limits.jerk;
  const double knee = a * a / j;  // peak velocity above which the acceleration limit is reached
  const auto ramp_time = [&](double v) {
    return v >= knee ? v / a + a / j : 2.0 * std::sqrt(v / j);
  };

  double v = limits.velocity;
  const bool cruises = v * ramp_time(v) <= stroke;
  if (!cruises) {
    v = 0.5 * (-knee + std::sqrt(knee * knee + 4.0 * a * stroke));
    if (v < knee) v = std::cbrt(stroke * stroke * j / 4.0);
  }
  Profile p;
  p.jerk_time = v >= knee ? a / j : std::sqrt(v / j);
  p.constant_acceleration_time = v >= knee ? v / a - a / j : 0.0;
  p.cruise_time = cruises ? (stroke - v * ramp_time(v)) / v : 0.0;
  return p;
}

}  // namespace

Trajectory::Trajectory(double start_position)
    : start_position_(start_position), end_position_(start_position) {}

void Trajectory::dwell(double seconds) {
  require_positive(seconds, "trajectory: dwell");
  Phase rest;
  rest.start = duration_;
  rest.origin = end_position_;
  phases_.push_back(rest);
  duration_ += seconds;
}

void Trajectory::move_to(double target, const Limits& limits) {
  const double displacement = target - end_position_;
  if (displacement == 0.0) return;
  line(displacement, std::abs(displacement), limits);
  end_position_ = target;  // free of the rounding of start + displacement
}

void Trajectory::line(double displacement, double length, const Limits& limits) {
  require_positive(length, "trajectory: path length");
  if (!(std::abs(displacement) <= length)) {
    throw std::invalid_argument("trajectory: a displacement of " + std::to_string(displacement) +
                                " on a path of length " + std::to_string(length));
  }
  Phase line;
  line.origin = end_position_;
  line.direction = displacement / length;
  run(length, limits, line, end_position_ + displacement);
}

void Trajectory::arc(double radius, double start_angle, double sweep, const Limits& limits) {
  require_positive(radius, "trajectory: radius");
  if (sweep == 0.0) return;
  Phase arc;
  arc.origin = end_position_ - radius * std::cos(start_angle);
  arc.direction = sweep > 0.0 ? 1.0 : -1.0;
  arc.radius = radius;
  arc.angle = start_angle;
  run(radius * std::abs(sweep), limits, arc, arc.origin + radius * std::cos(start_angle + sweep));
}

void Trajectory::run(double stroke, const Limits& limits, const Phase& shape, double end_position) {
  require_positive(limits.velocity, "trajectory: velocity limit");
  require_positive(limits.acceleration, "trajectory: acceleration limit");
  require_positive(limits.jerk, "trajectory: jerk limit");

  const Profile p = profile_of(stroke, limits);
  const double j = limits.jerk;
  const std::array<std::array<double, 2>, 7> ramps{{{p.jerk_time, j},
                                                    {p.constant_acceleration_time, 0.0},
                                                    {p.jerk_time, -j},
                                                    {p.cruise_time, 0.0},
                                                    {p.jerk_time, -j},
                                                    {p.constant_acceleration_time, 0.0},
                                                    {p.jerk_time, j}}};
  Phase phase = shape;
  for (const auto& [time, jerk] : ramps) {
    if (time <= 0.0) continue;
    phase.start = duration_;
    phase.jerk = jerk;
    phases_.push_back(phase);
    phase.s += time * (phase.velocity + time * (phase.acceleration / 2.0 + time * jerk / 6.0));
    phase.velocity += time * (phase.acceleration + time * jerk / 2.0);
    phase.acceleration += time * jerk;
    duration_ += time;
  }
  end_position_ = end_position;
}

Setpoint Trajectory::at(double time) const {
  if (time >= duration_) return {end_position_};
  if (time < 0.0 || phases_.empty()) return {start_position_};
  const auto after = std::upper_bound(phases_.begin(), phases_.end(), time,
                                      [](double t, const Phase& p) { return t < p.start; });
  const Phase& p = *std::prev(after);
  const double dt = time - p.start;
  const double s = p.s + dt * (p.velocity + dt * (p.acceleration / 2.0 + dt * p.jerk / 6.0));
  const double v = p.velocity + dt * (p.acceleration + dt * p.jerk / 2.0);
  const double a = p.acceleration + dt * p.jerk;
  if (p.radius == 0.0) {
    return {p.origin + p.direction * s, p.direction * v, p.direction * a, p.direction * p.jerk};
  }
  const double r = p.radius;
  const double angle = p.angle + p.direction * s / r;
  const double cosine = std::cos(angle);
  const double sine = p.direction * std::sin(angle);  // d cos(angle) / ds = -sine / r
  return {p.origin + r * cosine, -sine * v, -cosine * v * v / r - sine * a,
          sine * v * v * v / (r * r) - 3.0 * cosine * v * a / r - sine * p.jerk};
}

}  // namespace servotwin::virtual_machine
