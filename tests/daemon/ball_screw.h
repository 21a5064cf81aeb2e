// A ball-screw axis with a P-P drive, whose physics shares no code with the twin.
#pragma once

#include "tests/virtual_machine/axis.h"
#include "tests/virtual_machine/program.h"

namespace servotwin::daemon {

/// Moves to random targets, read every 1 ms with a resolution of 0.1 um.
inline virtual_machine::AxisRecord ball_screw_record(double seconds) {
  virtual_machine::Axis axis;
  axis.body.mass = 100.0;
  axis.body.viscous = 240.0;
  axis.body.friction = virtual_machine::SaturatedCoulomb{20.0, 1e-3};
  axis.drive.position_gain = 60.0;
  axis.drive.velocity_gain = 20'000.0;
  axis.recorder.position_step = 1e-7;
  virtual_machine::MoveMix mix;
  mix.duration = seconds;
  mix.longest_dwell = 0.05;
  return virtual_machine::record(axis, virtual_machine::moves(mix, 20));
}

}  // namespace servotwin::daemon
