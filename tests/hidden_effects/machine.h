// Random machines and what they are commanded to do, clean.
//
// SI units. Deterministic. Any thread.
#pragma once

#include <string>

#include "tests/hidden_effects/effects.h"

namespace servotwin::hidden_effects {

/// What machines are drawn from; `low`, `high` of a value that is spread in its logarithm.
struct Ranges {
  struct Range {
    double low = 1.0, high = 1.0;
  };
  Range mass, position_loop_hz, velocity_loop_ratio;
  Range friction_mps2, drag_per_s, presliding_m;
  Range encoder_step_m, noise_to_step;
  Range velocity, acceleration, jerk, stroke;
  double torque_noise = 0.5;  ///< at most this share of the reading's noise
  double first_change = 0.15, last_change = 0.45;
};

struct Machine {
  Scene scene;
  Rig other;  ///< the second axis, clean
  virtual_machine::Trajectory other_command;
  bool records_other = false;
  std::vector<double> torque_noise;  ///< one per control period [N]
};

[[nodiscard]] Machine draw_machine(const Ranges& ranges, const Needs& needs, Random& random);

/// The effects that are the nature of its friction.
[[nodiscard]] std::vector<std::string> own_effects(const Rig& rig);

[[nodiscard]] std::string describe(const Rig& rig);

}  // namespace servotwin::hidden_effects
