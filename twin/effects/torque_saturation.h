// A motor that cannot give what the acceleration needs.
//
//   demand = x_r'' + drag sgn(x_r');   d = share (demand - limit)  above the limit, and likewise
//   below its negative
#pragma once

#include <array>

#include "twin/effect.h"

namespace servotwin {

struct TorqueSaturation {
  static constexpr Identity kIdentity{
      .id = "torque_saturation",
      .meaning = "acceleration beyond what the motor can give",
      .acts = Acts::kForce,
      .source = "docs/theory.md 3.11",
      .confused = "gain_change and feedforward_mismatch, which small accelerations show as well",
      .cause = "torque_saturation",
      .check = "acceleration limits of the program against what the motor gives"};
  static constexpr std::array<Parameter, 2> kShapes{
      {{"limit_mps2", "m/s^2", 0.01, 1000.0, 1.0, "acceleration that the motor can give", true,
        false, Scan::kAcceleration},
       {"drag_mps2", "m/s^2", 1e-3, 100.0, 0.1, "of it that friction takes"}}};
  static constexpr std::array<Parameter, 1> kCoefficients{
      {{"share", "1", -10.0, 10.0, 0.0, "of the acceleration beyond the limit that is missing"}}};
  template <class T>
  using Memory = NoMemory;

  template <class T>
  static void unit_forces(const T* shape, NoMemory& /*memory*/, const Motion& m,
                          T* force) noexcept {
    const double sign = m.command_velocity > 0.0 ? 1.0 : (m.command_velocity < 0.0 ? -1.0 : 0.0);
    const T demand = m.command_acceleration + sign * shape[1];
    force[0] =
        demand > shape[0] ? demand - shape[0] : (demand < -shape[0] ? demand + shape[0] : T(0.0));
  }
};

}  // namespace servotwin
