// Friction models compared on the motor's torque, judged on what they were not fitted to.
//
//   compare_on_ramps    stribeck, modified_stribeck and friction_map on the velocity-torque pairs
//   of
//                       constant-velocity ramps (paper 001). Velocities take turns in being held
//                       out, both directions together; pairs with stick-slip are kept from
//                       stribeck, which cannot show it, and from every judgement.
//   compare_on_motion   friction and inertia on the whole motion (force_fit.h): fitted to the first
//                       part, judged on the rest. A friction of one symmetric force is tried with a
//                       constant force and with unlike directions.
//
// Units as of force_fit.h. Any thread.
#pragma once

#include <vector>

#include "identification/torque/force_fit.h"
#include "identification/torque/ramps.h"

namespace servotwin {

struct FrictionTrial {
  ForceStructure structure;
  ForceFit fit;         ///< on ramps: to all pairs; on motion: to the first part
  ForceError held_out;  ///< on what the judged fit had not seen
  bool chosen =
      false;  ///< the least held-out error; on ramps the simplest within its standard error
};

/// Throws std::runtime_error where there are too few velocities in either direction.
[[nodiscard]] std::vector<FrictionTrial> compare_on_ramps(const std::vector<Ramp>& ramps);

/// Throws std::runtime_error where there is no torque.
[[nodiscard]] std::vector<FrictionTrial> compare_on_motion(
    const std::vector<Segment>& segments, const std::vector<std::size_t>& frictions,
    double training_share, double bandwidth_hz);

/// The friction of a model at a steady velocity, after long travel [unit of the force].
[[nodiscard]] double steady_force(const ForceModel& model, double velocity);

}  // namespace servotwin
