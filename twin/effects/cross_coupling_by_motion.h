// A force by the acceleration of another axis whose own motion is known: measured, or predicted
// from its commands by its own model (twin/neighbour.h).
//
//   d = ratio x''   of the other axis
//
// Where only the command of the other axis is known, cross_coupling models its loop as well.
// Source: docs/theory.md 3.11.
#pragma once

#include <array>

#include "twin/effect.h"

namespace servotwin {

struct CrossCouplingByMotion {
  static constexpr Identity kIdentity{
      .id = "cross_coupling_by_motion",
      .meaning = "force caused by the acceleration of another axis, by its own motion",
      .acts = Acts::kForce,
      .cause = "cross_coupling",
      .check = "mounting and stiffness between the two axes"};
  static constexpr std::array<Parameter, 0> kShapes{};
  static constexpr std::array<Parameter, 1> kCoefficients{
      {{"ratio", "1", -10.0, 10.0, 0.0,
        "acceleration of this axis per acceleration of the other"}}};
  template <class T>
  using Memory = NoMemory;

  template <class T, class M>
  static void unit_forces(const T* /*shape*/, NoMemory& /*memory*/, const MotionOf<M>& m,
                          T* force) noexcept {
    force[0] = T(m.neighbour_motion_acceleration);
  }
};

}  // namespace servotwin
