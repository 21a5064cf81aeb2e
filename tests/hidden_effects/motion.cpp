#include "tests/hidden_effects/motion.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace servotwin::hidden_effects {
namespace {

using virtual_machine::Limits;
using virtual_machine::Trajectory;

constexpr double kMaxFeedMove_s = 1.2;          // so that no slow move fills the record
constexpr double kMaxReversalInterval_s = 5.0;  // between slow reversals

class Mix {
 public:
  Mix(const Motion& motion, Random& random) : motion_(motion), random_(random) {}

  void add(Trajectory& path) {
    if (path.duration() - last_reversals_ > kMaxReversalInterval_s) return slow_reversals(path);
    const double pick = random_.uniform();
    switch (motion_.style) {
      case Motion::Style::kProduction:
        if (pick < 0.3) return position(path);
        if (pick < 0.55) return feed(path);
        if (pick < 0.7) return pocket(path);
        if (pick < 0.88) return circle(path);
        return slow_reversals(path);
      case Motion::Style::kCircles:
        if (pick < 0.2) return position(path);
        if (pick < 0.9) return circle(path);
        return slow_reversals(path);
      case Motion::Style::kMoves:
        if (pick < 0.15) return slow_reversals(path);
        return feed(path);
    }
  }

 private:
  [[nodiscard]] Limits with_velocity(double velocity) const {
    Limits limits = motion_.limits;
    limits.velocity = velocity;
    return limits;
  }
  void rest(Trajectory& path) { path.dwell(random_.log_between(0.02, motion_.longest_rest)); }
  [[nodiscard]] double target() {
    return motion_.start + random_.between(-0.5, 0.5) * motion_.stroke;
  }

  void position(Trajectory& path) {
    path.move_to(target(), motion_.limits);
    rest(path);
  }
  void feed(Trajectory& path) {
    const double velocity = random_.log_between(0.02, 1.0) * motion_.limits.velocity;
    const double reach = velocity * kMaxFeedMove_s;
    const double here = path.end_position();
    path.move_to(std::clamp(target(), here - reach, here + reach), with_velocity(velocity));
    if (random_.chance(0.7)) rest(path);
  }
  void pocket(Trajectory& path) {
    const double width = random_.between(0.1, 0.3) * motion_.stroke;
    const Limits limits = with_velocity(random_.between(0.2, 0.6) * motion_.limits.velocity);
    const double from = path.end_position();
    const double to = from + (from > motion_.start ? -width : width);
    for (int pass = 0; pass < 4; ++pass) path.move_to(pass % 2 == 0 ? to : from, limits);
    rest(path);
  }
  void circle(Trajectory& path) {
    const double radius = random_.log_between(0.002, 0.25 * motion_.stroke);
    const double turns = radius < 0.01 ? 2.0 : 1.0;
    // The centripetal acceleration is within the limit, and the circle within some seconds.
    const double velocity = std::min(random_.between(0.2, 0.8) * motion_.limits.velocity,
                                     std::sqrt(0.5 * motion_.limits.acceleration * radius));
    const double angle = random_.below(4) * std::numbers::pi / 2.0;
    path.arc(radius, angle, random_.sign() * turns * 2.0 * std::numbers::pi,
             with_velocity(velocity));
    if (random_.chance(0.5)) rest(path);
  }
  void slow_reversals(Trajectory& path) {
    const double amplitude = random_.log_between(1e-4, 1e-3);
    const Limits limits = with_velocity(random_.between(4.0, 15.0) * amplitude);
    const double from = path.end_position();
    for (int i = 0; i < 4; ++i) {
      path.move_to(from + (i % 2 == 0 ? amplitude * (1.0 - 0.2 * i) : 0.0), limits);
    }
    if (random_.chance(0.5)) rest(path);
    last_reversals_ = path.duration();
  }

  const Motion& motion_;
  Random& random_;
  double last_reversals_ = 0.0;
};

}  // namespace

Trajectory motion_of(const Motion& motion, Random& random) {
  Mix mix(motion, random);
  Trajectory path(motion.start);
  path.dwell(random.between(0.1, 0.4));
  for (int too_long = 0; too_long < 6;) {  // a shorter one may still fit
    Trajectory longer = path;
    mix.add(longer);
    if (longer.duration() > motion.duration) {
      ++too_long;
    } else {
      path = longer;
    }
  }
  path.dwell(motion.duration - path.duration());
  return path;
}

std::vector<Interval> rests(const Trajectory& command) {
  constexpr double kLook = 1e-3, kShortest = 0.02;  // [s]
  std::vector<Interval> out;
  double begin = -1.0;
  for (double t = 0.0; t <= command.duration() + kLook; t += kLook) {
    const virtual_machine::Setpoint at = command.at(t);
    const bool still = t < command.duration() && std::abs(at.velocity) < 1e-9 &&
                       std::abs(at.acceleration) < 1e-6;  // but for rounding at a joint
    if (still && begin < 0.0) begin = t;
    if (still || begin < 0.0) continue;
    if (t - begin >= kShortest) out.push_back({begin, t});
    begin = -1.0;
  }
  return out;
}

std::vector<Interval> moves(const Trajectory& command) {
  std::vector<Interval> out;
  double from = 0.0;
  for (const Interval& rest : rests(command)) {
    if (rest.begin > from) out.push_back({from, rest.begin});
    from = rest.end;
  }
  return out;
}

}  // namespace servotwin::hidden_effects
