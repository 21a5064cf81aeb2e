// The effects that the rig can hide: what each needs of the machine, and how it is put in.
//
// Every effect has one size, in which its contribution grows; what else it has (periods, places,
// times, signs) is drawn. Identifiers and parameter keys are those of servotwin.diagnosis/1.
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

/// Of the contract, but for feedforward_mismatch, which only an earlier model can show.
[[nodiscard]] const std::vector<std::string>& effect_ids();

/// Those that some encoder places or loops cannot show: the record is that of the clean machine.
[[nodiscard]] const std::vector<std::string>& blind_ids();

/// Two effects that one machine can have, and that physics tells apart.
[[nodiscard]] bool may_pair(std::string_view a, std::string_view b);

/// What of the machine must be so that the effect is there and seen; otherwise free.
struct Needs {
  bool coulomb = false;         ///< friction without presliding
  bool level_friction = false;  ///< friction that does not fall with velocity
  bool outside = false;     ///< the record is a load encoder's, the loop is closed on the motor's
  bool inside = false;      ///< the record is of the encoder that closes the loop
  bool motor_loop = false;  ///< the loop is closed on the motor's
  bool no_integrator = false, integrator = false;
  bool other_axis = false;  ///< a second axis moves and is recorded
  bool long_rests = false;

  [[nodiscard]] Needs with(const Needs& other) const;
};

/// `blind`: of a machine on which it cannot be seen.
[[nodiscard]] Needs needs_of(std::string_view id, bool blind = false);

/// A machine and its motion, clean, and what effects refer to.
struct Scene {
  Rig rig;
  virtual_machine::Trajectory command;
  double stroke = 0.1;
  double peak_force = 0.0;                         ///< of the clean machine [N]
  std::vector<double> other_acceleration;          ///< of the second axis, one per control period
  double first_change = 0.15, last_change = 0.45;  ///< shares of the record in which things change
};

using Parameters = std::map<std::string, double>;

struct Hidden {
  std::string id;
  double smallest = 0.0, largest = 0.0;  ///< sizes that are plausible
  std::function<void(Rig&, double size)> put;
  std::function<Parameters(double size)> parameters;
};

[[nodiscard]] Hidden hide(std::string_view id, const Scene& scene, Random& random);

}  // namespace servotwin::hidden_effects
