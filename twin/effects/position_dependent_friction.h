// Friction whose level changes along the axis: wear, lubrication, alignment.
//
//   d = sat(v / velocity_limit) (slope x + curvature x^2)
//
// beside the friction of x = 0. Odd in v: a force that does not turn with the direction is none.
#pragma once

#include <array>
#include <cmath>

#include "twin/effect.h"

namespace servotwin {

struct PositionDependentFriction {
  static constexpr Identity kIdentity{
      .id = "position_dependent_friction",
      .meaning = "friction whose level changes along the axis",
      .acts = Acts::kForce,
      .source = "docs/theory.md 3.10",
      .confused = "cogging, which does not turn with the direction"};
  static constexpr std::array<Parameter, 1> kShapes{
      {{"velocity_limit", "m/s", 2e-5, 2e-2, 1e-3,
        "velocity at which the friction force is fully developed"}}};
  static constexpr std::array<Parameter, 2> kCoefficients{
      {{"slope", "1/s^2", -1e4, 1e4, 0.0, "change of the level along the axis, per moved mass"},
       {"curvature", "1/(m s^2)", -1e6, 1e6, 0.0, "and of the slope"}}};
  template <class T>
  using Memory = NoMemory;

  template <class T>
  static void unit_forces(const T* shape, NoMemory& /*memory*/, const Motion& m,
                          T* force) noexcept {
    const T q = m.velocity / shape[0];
    const T direction = q > 1.0 ? T(1.0) : (q < -1.0 ? T(-1.0) : q);
    force[0] = direction * m.position;
    force[1] = force[0] * m.position;
  }
};

}  // namespace servotwin
