// Random machines without effects, and their commanded motion.
//
// SI units. Deterministic. Any thread.
#pragma once

#include <string>

#include "tests/hidden_effects/effects.h"

namespace servotwin::hidden_effects {

/// Ranges from which machines are drawn, uniformly in the logarithm of the value.
struct Ranges {
  struct Range {
    double low = 1.0, high = 1.0;
  };
  Range mass, position_loop_hz, velocity_loop_ratio;
  Range friction_mps2, drag_per_s, presliding_m;
  Range encoder_step_m, noise_to_step;
  Range velocity, acceleration, jerk, stroke;
  double torque_noise = 0.5;  ///< at most, as a share of the noise of the reading
  double first_change = 0.15, last_change = 0.45;
};

struct Machine {
  Scene scene;
  Rig other;  ///< the second axis, without effects
  virtual_machine::Trajectory other_command;
  bool records_other = false;
  std::vector<double> torque_noise;  ///< one per control period [N]
};

[[nodiscard]] Machine draw_machine(const Ranges& ranges, const Needs& needs, Random& random);

/// The effects that belong to the friction family of the machine.
[[nodiscard]] std::vector<std::string> own_effects(const Rig& rig);

/// A description in one line.
[[nodiscard]] std::string describe(const Rig& rig);

}  // namespace servotwin::hidden_effects
