// Friction whose level changes along the axis: wear, lubrication, alignment.
//
//   d = direction (slope x + curvature x^2 + sine sin(2 pi x / wave) + cosine cos(..))
//
// beside the friction at x = 0, whose direction it has (Motion::direction). It is odd in v: a force
// that does not change sign with the direction is another effect. Source: docs/theory.md 3.10.
#pragma once

#include <array>
#include <cmath>
#include <numbers>

#include "twin/effect.h"

namespace servotwin {

struct PositionDependentFriction {
  static constexpr Identity kIdentity{.id = "position_dependent_friction",
                                      .meaning = "friction whose level changes along the axis",
                                      .acts = Acts::kForce,
                                      .cause = "position_dependent_friction",
                                      .check = "wear, alignment and lubrication along the travel"};
  static constexpr std::array<Parameter, 1> kShapes{
      {{"wave", "m", 1e-2, 10.0, 0.1, "wavelength of the periodic part", true, false,
        Scan::kPeriod}}};
  static constexpr std::array<Parameter, 4> kCoefficients{
      {{"slope", "1/s^2", -1e4, 1e4, 0.0, "change of the level along the axis, per moved mass"},
       {"curvature", "1/(m s^2)", -1e6, 1e6, 0.0,
        "quadratic change of the level along the axis, per moved mass"},
       {"sine", "m/s^2", -kMaxForce, kMaxForce, 0.0, "amplitude of the sine, per moved mass"},
       {"cosine", "m/s^2", -kMaxForce, kMaxForce, 0.0, "amplitude of the cosine"}}};
  template <class T>
  using Memory = NoMemory;

  template <class T, class M>
  static void unit_forces(const T* shape, NoMemory& /*memory*/, const MotionOf<M>& m,
                          T* force) noexcept {
    using std::cos;
    using std::sin;
    const M direction = m.direction();
    const T angle = 2.0 * std::numbers::pi * m.position / shape[0];
    force[0] = T(direction * m.position);
    force[1] = force[0] * m.position;
    force[2] = direction * sin(angle);
    force[3] = direction * cos(angle);
  }
};

}  // namespace servotwin
