#include "tests/bench/record.h"

#include <cmath>
#include <limits>
#include <numbers>

#include "tests/virtual_machine/axis.h"
#include "tests/virtual_machine/program.h"

namespace servotwin::bench {
namespace {

constexpr double kSampleTime = 1e-3;      // [s]
constexpr double kPositionGain = 75.0;    // [1/s]
constexpr double kMass = 200.0;           // [kg]
constexpr double kFrictionLevel = 0.286;  // [m/s^2], force per moved mass

std::array<double, kMaxOrder> closed_loop() {
  return denominator_of({2.0 * std::numbers::pi * 9.87, 2.0 * std::numbers::pi * 31.31, 0.44}, 3);
}

virtual_machine::Axis production_axis() {
  // Without feed-forward the denominator and Kp determine the three gains per moved mass.
  const auto [a1, a2, a3] = closed_loop();
  const double integral = a3 / kPositionGain;
  const double velocity = (a2 - integral) / kPositionGain;

  virtual_machine::Axis axis;
  axis.body.mass = kMass;
  axis.body.viscous = (a1 - velocity) * kMass;
  axis.body.friction =
      virtual_machine::gms_with_curve(kFrictionLevel * kMass, /*breakaway_distance=*/20e-6,
                                      /*steepness=*/4.0, /*elements=*/6);
  axis.drive.position_gain = kPositionGain;
  axis.drive.velocity_gain = velocity * kMass;
  axis.drive.integral_gain = integral * kMass;
  axis.drive.encoder_step = 5e-9;
  axis.recorder.sample_time = kSampleTime;
  axis.recorder.position_step = 1e-6;
  return axis;
}

Segment recorded(const virtual_machine::Trajectory& motion, double seconds) {
  const auto truth = record(production_axis(), motion);
  const auto samples = static_cast<Eigen::Index>(std::lround(seconds / truth.sample_time));
  Segment segment;
  segment.sample_time_s = truth.sample_time;
  segment.command = truth.command.head(samples);
  segment.actual = truth.actual.head(samples);
  return segment;
}

/// Until then, moves to alternate sides of 0 whose lengths grow to the amplitude in 12 moves, again
/// and again, and a rest.
void alternate(virtual_machine::Trajectory& motion, double until_s, double amplitude,
               const virtual_machine::Limits& limits) {
  for (int move = 0;; ++move) {
    virtual_machine::Trajectory next = motion;
    next.move_to((move % 2 == 0 ? 1.0 : -1.0) * amplitude * (move % 12 + 1) / 12.0, limits);
    if (next.duration() > until_s - 0.2) break;
    motion = next;
  }
  motion.dwell(until_s - motion.duration());
}

}  // namespace

Segment production_record() {
  virtual_machine::MoveMix mix;
  mix.duration = 12.0;
  return recorded(virtual_machine::moves(mix, /*seed=*/12), mix.duration);
}

Segment fast_and_slow_record(double seconds) {
  virtual_machine::Trajectory motion;
  motion.dwell(0.2);
  alternate(motion, 0.5 * seconds, 0.04, {.velocity = 0.25, .acceleration = 3.0, .jerk = 60.0});
  alternate(motion, seconds, 0.001, {.velocity = 0.01, .acceleration = 0.2, .jerk = 20.0});
  return recorded(motion, seconds);
}

Model production_model() {
  Model model;
  model.sample_time_s = kSampleTime;
  model.loop.denominator = closed_loop();
  const auto& a = model.loop.denominator;
  model.loop.numerator = {1.0, a[0], a[2] / kPositionGain};
  Effect friction = make_effect<CoulombFriction>();
  friction.coefficient[0] = kFrictionLevel;
  model.effects = {friction};
  return model;
}

void write_csv(const Segment& record, std::ostream& out) {
  out.precision(std::numeric_limits<double>::max_digits10);
  out << "command[m],actual[m]\n";
  for (Eigen::Index k = 0; k < record.size(); ++k) {
    out << record.command(k) << ',' << record.actual(k) << '\n';
  }
}

}  // namespace servotwin::bench
