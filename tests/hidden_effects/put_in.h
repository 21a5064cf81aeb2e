// How each effect is added to the rig, by its physics. Each function draws the parameters of the
// effect other than its size.
//
// SI units. Any thread.
#pragma once

#include "tests/hidden_effects/effects.h"

namespace servotwin::hidden_effects::put_in {

[[nodiscard]] Hidden stribeck(const Scene& scene, Random& random);
[[nodiscard]] Hidden presliding(const Scene& scene, Random& random);
[[nodiscard]] Hidden asymmetric_friction(const Scene& scene, Random& random);
[[nodiscard]] Hidden position_dependent_friction(const Scene& scene, Random& random);
[[nodiscard]] Hidden added_friction(const Scene& scene, Random& random);
[[nodiscard]] Hidden backlash(const Scene& scene, Random& random);
[[nodiscard]] Hidden compliance(const Scene& scene, Random& random);
[[nodiscard]] Hidden cogging(const Scene& scene, Random& random);
[[nodiscard]] Hidden lead_error(const Scene& scene, Random& random);
[[nodiscard]] Hidden encoder_error(const Scene& scene, Random& random);
[[nodiscard]] Hidden gravity_offset(const Scene& scene, Random& random);
[[nodiscard]] Hidden inertia_change(const Scene& scene, Random& random);
[[nodiscard]] Hidden viscous_drift(const Scene& scene, Random& random);
[[nodiscard]] Hidden time_delay(const Scene& scene, Random& random);
[[nodiscard]] Hidden gain_change(const Scene& scene, Random& random);
[[nodiscard]] Hidden torque_saturation(const Scene& scene, Random& random);
[[nodiscard]] Hidden periodic_disturbance(const Scene& scene, Random& random);
[[nodiscard]] Hidden impulse_disturbance(const Scene& scene, Random& random);
[[nodiscard]] Hidden cutting_force(const Scene& scene, Random& random);
[[nodiscard]] Hidden cross_coupling(const Scene& scene, Random& random);
[[nodiscard]] Hidden dwell_stiction(const Scene& scene, Random& random);
[[nodiscard]] Hidden thermal_growth(const Scene& scene, Random& random);
[[nodiscard]] Hidden dropped_samples(const Scene& scene, Random& random);

}  // namespace servotwin::hidden_effects::put_in
