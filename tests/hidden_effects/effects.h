// The effects that can be hidden in the rig: what each requires of the machine, and how it is
// added.
//
// Every effect has one size, with which its contribution grows; its other parameters (periods,
// positions, times, signs) are drawn. Identifiers and parameter keys are those of
// servotwin.diagnosis/1.
//
// SI units. Errors: std::invalid_argument for an unknown identifier. Any thread.
#pragma once

#include <functional>
#include <map>
#include <string>
#include <string_view>
#include <vector>

#include "tests/hidden_effects/motion.h"
#include "tests/hidden_effects/rig.h"

namespace servotwin::hidden_effects {

/// The causes of the contract except feedforward_mismatch, which is observable only in a comparison
/// with an earlier model.
[[nodiscard]] const std::vector<std::string>& effect_ids();

/// Effects that are not observable with some encoders or loops: the record is that of the machine
/// without the effect.
[[nodiscard]] const std::vector<std::string>& blind_ids();

/// Whether one machine can have both effects and they are physically distinguishable.
[[nodiscard]] bool may_pair(std::string_view a, std::string_view b);

/// What an effect requires of the machine to be present and observable; everything else is free.
struct Needs {
  bool coulomb = false;         ///< friction without presliding
  bool level_friction = false;  ///< friction that does not fall with velocity
  bool outside = false;     ///< the record is a load encoder's, the loop is closed on the motor's
  bool inside = false;      ///< the record is of the encoder that closes the loop
  bool motor_loop = false;  ///< the loop is closed on the motor's encoder
  bool no_integrator = false, integrator = false;
  bool other_axis = false;  ///< a second axis moves and is recorded
  bool long_rests = false;

  [[nodiscard]] Needs with(const Needs& other) const;
};

/// The requirements of an effect; `blind`: those of a machine on which it is not observable.
[[nodiscard]] Needs needs_of(std::string_view id, bool blind = false);

/// A machine without effects, its motion, and the quantities that effects refer to.
struct Scene {
  Rig rig;
  virtual_machine::Trajectory command;
  double stroke = 0.1;
  double peak_force = 0.0;                 ///< of the clean machine [N]
  std::vector<double> other_acceleration;  ///< of the second axis, one per control period
  double first_change = 0.15,
         last_change = 0.45;  ///< range, in shares of the record, of times at which effects set in
};

using Parameters = std::map<std::string, double>;

/// A drawn effect: its range of sizes, and how a size is added to a rig.
struct Hidden {
  std::string id;
  double smallest = 0.0, largest = 0.0;  ///< range of plausible sizes
  std::function<void(Rig&, double size)> put;
  std::function<Parameters(double size)> parameters;
};

/// Draws an effect for this scene.
[[nodiscard]] Hidden hide(std::string_view id, const Scene& scene, Random& random);

}  // namespace servotwin::hidden_effects
