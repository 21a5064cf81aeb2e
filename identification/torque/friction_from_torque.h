// Friction models compared on the motor's torque and judged on held-out data.
//
//   compare_on_ramps    stribeck, modified_stribeck and friction_map on the velocity-torque pairs
//                       of constant-velocity ramps (Giberti et al. 2019, 3.1 and 3.4). Velocities
//                       are held out in turn, both directions together. Pairs with stick-slip are
//                       not used to fit stribeck, which cannot represent it, nor to judge.
//   compare_on_motion   friction and inertia on the whole motion (force_fit.h): fitted to the first
//                       part, judged on the rest. A friction law with one symmetric force is tried
//                       with a constant force and with a difference between the directions.
//
// Units as in force_fit.h. Allocates. Any thread.
#pragma once

#include <vector>

#include "identification/torque/force_fit.h"
#include "identification/torque/ramps.h"

namespace servotwin {

struct FrictionTrial {
  ForceStructure structure;
  ForceFit fit;         ///< on ramps: to all pairs; on motion: to the first part
  ForceError held_out;  ///< on data that the judged fit had not seen
  /// Has the least held-out error; on ramps: the simplest within one standard error of the least.
  bool chosen = false;
};

/// Throws std::runtime_error where there are too few velocities in either direction.
[[nodiscard]] std::vector<FrictionTrial> compare_on_ramps(const std::vector<Ramp>& ramps);

/// Throws std::runtime_error where there is no torque.
[[nodiscard]] std::vector<FrictionTrial> compare_on_motion(
    const std::vector<Segment>& segments, const std::vector<std::size_t>& frictions,
    double training_share, double bandwidth_hz);

/// The friction of a model at constant velocity, after long travel [unit of the force].
[[nodiscard]] double steady_force(const ForceModel& model, double velocity);

}  // namespace servotwin
