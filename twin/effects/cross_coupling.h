// The acceleration of another axis, felt by this one.
//
//   d = ratio x_other''
#pragma once

#include <array>

#include "twin/effect.h"

namespace servotwin {

struct CrossCoupling {
  static constexpr Identity kIdentity{
      .id = "cross_coupling",
      .meaning = "a force by the acceleration of another axis",
      .acts = Acts::kForce,
      .source = "docs/theory.md 3.11",
      .confused = "none, as long as the axes do not move in proportion",
      .cause = "cross_coupling",
      .check = "mounting and stiffness towards the other axis; its feed-forward"};
  static constexpr std::array<Parameter, 0> kShapes{};
  static constexpr std::array<Parameter, 1> kCoefficients{
      {{"ratio", "1", -10.0, 10.0, 0.0, "acceleration felt here per acceleration there"}}};
  template <class T>
  using Memory = NoMemory;

  template <class T>
  static void unit_forces(const T* /*shape*/, NoMemory& /*memory*/, const Motion& m,
                          T* force) noexcept {
    force[0] = T(m.neighbour_acceleration);
  }
};

}  // namespace servotwin
