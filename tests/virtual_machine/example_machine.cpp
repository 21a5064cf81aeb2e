#include "tests/virtual_machine/example_machine.h"

#include <numbers>

#include "tests/virtual_machine/recording.h"

namespace servotwin::virtual_machine {
namespace {

using std::numbers::pi;

constexpr double kLead = 0.02;  // of both ball screws [m]

constexpr Limits kRapid{.velocity = 0.25, .acceleration = 3.0, .jerk = 60.0};

Limits feed(double velocity) { return {.velocity = velocity, .acceleration = 1.5, .jerk = 40.0}; }

/// One part. `pace` scales the feeds, `side` = -1 mirrors it in X.
void run_part(PlanePath& path, double pace, double side) {
  path.line_by(side * 0.060, 0.040, kRapid);
  path.dwell(0.15);
  path.arc(0.010, 0.0, side * 2.0 * pi, feed(0.08 * pace));
  path.dwell(0.1);
  path.arc(0.025, pi / 2.0, -side * 2.0 * pi, feed(0.12 * pace));
  path.dwell(0.1);

  for (int pass = 0; pass < 4; ++pass) {  // pocket
    path.line_by((pass % 2 == 0 ? side : -side) * 0.030, 0.0, feed(0.10 * pace));
    path.line_by(0.0, 0.003, feed(0.05 * pace));
  }
  path.dwell(0.1);

  const double half = 0.020 / std::numbers::sqrt2;  // diamond of 20 mm sides
  path.line_by(side * half, half, feed(0.096 * pace));
  path.line_by(-side * half, half, feed(0.096 * pace));
  path.line_by(-side * half, -half, feed(0.096 * pace));
  path.line_by(side * half, -half, feed(0.096 * pace));
  path.dwell(0.1);

  for (int stroke = 0; stroke < 6; ++stroke) {  // slow reversals, each smaller than the one before
    const double length = (stroke % 2 == 0 ? 1.0 : -1.0) * (0.0004 - 0.00006 * stroke);
    path.line_by(length, 0.7 * length, feed(0.004 * pace));
  }
  path.dwell(0.15);
  path.arc(0.004, pi, side * 2.0 * pi, feed(0.025 * pace));

  for (int hole = 0; hole < 5; ++hole) {  // drilling
    path.line_by(-side * 0.015, hole % 2 == 0 ? 0.012 : -0.012, kRapid);
    path.dwell(0.12);
  }
  path.line_by(-side * 0.0015, -0.0010, feed(0.006 * pace));
  path.line_to(0.0, 0.0, kRapid);
  path.dwell(0.2);
}

}  // namespace

Axis example_x_axis() {
  Axis axis;
  axis.name = "X";
  axis.body.mass = 210.0;
  axis.body.viscous = 700.0;
  axis.body.constant_force = 8.0;
  axis.body.friction =
      gms_with_curve(/*level=*/110.0, /*breakaway_distance=*/20e-6, /*steepness=*/4.0,
                     /*elements=*/6);
  axis.drive.position_gain = 75.0;
  axis.drive.velocity_gain = 48000.0;
  axis.drive.integral_gain = 6.0e6;
  axis.drive.force_limit = 3000.0;
  axis.drive.encoder_step = 5e-9;
  axis.recorder.position_step = 1e-7;
  axis.recorder.torque_noise = 0.004;
  axis.recorder.seed = 20;
  axis.transmission = kLead / (2.0 * pi);
  return axis;
}

Axis example_y_axis() {
  Axis axis;
  axis.name = "Y";
  axis.body.mass = 340.0;
  axis.body.viscous = 1100.0;
  axis.body.constant_force = 25.0;
  axis.body.friction = LuGre{
      .level = {.coulomb = 150.0, .breakaway = 175.0, .stribeck_velocity = 0.006, .exponent = 1.0},
      .sigma0 = 1.2e7,
      .sigma1 = 2.0e4,
      .sigma2 = 0.0};
  axis.drive.position_gain = 55.0;
  axis.drive.velocity_gain = 61000.0;
  axis.drive.integral_gain = 4.5e6;
  axis.drive.velocity_feedforward = 0.5;
  axis.drive.force_limit = 4000.0;
  axis.drive.encoder_step = 5e-9;
  axis.recorder.position_step = 1e-7;
  axis.recorder.torque_noise = 0.004;
  axis.recorder.seed = 21;
  axis.transmission = kLead / (2.0 * pi);
  return axis;
}

PlanePath example_program() {
  PlanePath path(0.0, 0.0);
  path.dwell(0.3);
  run_part(path, 1.0, 1.0);
  run_part(path, 0.75, -1.0);
  path.dwell(0.3);
  return path;
}

void write_example(std::ostream& out) {
  const PlanePath path = example_program();
  const CsvFormat format{.time_decimals = 3,
                         .command_decimals = 6,
                         .actual_decimals = 4,
                         .torque_decimals = 3,
                         .torque_unit = "Nm",
                         .comments = {"Two axes of a virtual machine in production; simulated, see "
                                      "README.md beside this file."}};
  write_csv({record(example_x_axis(), path.x()), record(example_y_axis(), path.y())}, format, out);
}

}  // namespace servotwin::virtual_machine
