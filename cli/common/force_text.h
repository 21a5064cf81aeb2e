// A force model (identification/torque/force_fit.h) for people and for programs, in the unit of the
// force.
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "identification/recording/segments.h"
#include "identification/torque/force_fit.h"
#include "identification/torque/ramps.h"

namespace servotwin::cli {

/// The unit in which forces are printed, and its size in the recorded unit.
struct ForceUnit {
  std::string name;  ///< "N", "Nm", "A", "V", "%"
  double scale = 1.0;
  bool rotary = false;

  /// The unit of a coefficient that the effects' catalogue gives per moved mass: "m/s^2" -> "N".
  [[nodiscard]] std::string of(std::string_view per_mass) const;
  /// The unit of a shape: metres of a linear axis are radians of a rotary one.
  [[nodiscard]] std::string of_shape(std::string_view unit) const;
  /// "kg", "kg m^2", or "A per m/s^2".
  [[nodiscard]] std::string of_mass() const;
};

/// The unit of a torque channel. With `lead` > 0 [m per revolution], torques of a linear axis in Nm
/// are printed as forces in N.
[[nodiscard]] ForceUnit force_unit(const std::string& torque_unit, bool rotary, double lead);

/// Inverts the sign of the torque if `inverted`. Throws std::runtime_error, with the axis and the
/// remedy, if there is no torque or one that never changes.
void require_torque(SegmentedAxis& axis, bool inverted);
/// Throws std::runtime_error if, on most ramps, the torque at constant velocity acts against the
/// motion.
void require_resisting(const std::vector<Ramp>& ramps, const std::string& source);
/// Throws std::runtime_error if the fitted mass is not positive: torque and acceleration have
/// opposite signs.
void require_mass(const ForceFit& fit, const std::string& source);

/// Mass and every effect, one line each.
[[nodiscard]] std::vector<std::string> force_lines(const ForceFit& fit, bool with_mass,
                                                   const ForceUnit& unit);
[[nodiscard]] nlohmann::json force_json(const ForceFit& fit, bool with_mass, const ForceUnit& unit);

/// The parameters whose standard deviation exceeds their value.
[[nodiscard]] std::vector<std::string> undetermined(const ForceFit& fit);

/// The friction models that a torque can be fitted with.
[[nodiscard]] std::vector<std::string> torque_frictions();

}  // namespace servotwin::cli
