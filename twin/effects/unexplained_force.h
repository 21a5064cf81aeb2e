// A force of unknown cause: a table over position, velocity or commanded acceleration, linear
// between nine knots from `low` to `high` and constant beyond. It predicts, but does not explain.
//
//   d = sum force_i hat_i(u),   u = 8 (regressor - low) / (high - low)
//
// hat_i is the hat function of knot i. Source: docs/theory.md 10.3.
#pragma once

#include <array>
#include <cstddef>

#include "twin/effect.h"

namespace servotwin {

enum class Over { kPosition, kVelocity, kAcceleration };

template <Over over>
struct UnexplainedForce {
  static constexpr std::size_t kKnots = 9;
  static constexpr Identity kIdentity{
      .id = over == Over::kPosition   ? "unexplained_over_position"
            : over == Over::kVelocity ? "unexplained_over_velocity"
                                      : "unexplained_over_acceleration",
      .meaning = over == Over::kPosition   ? "unexplained force over position"
                 : over == Over::kVelocity ? "unexplained force over velocity"
                                           : "unexplained force over acceleration",
      .acts = Acts::kForce};
  static constexpr const char* kUnit = over == Over::kPosition   ? "m"
                                       : over == Over::kVelocity ? "m/s"
                                                                 : "m/s^2";
  static constexpr std::array<Parameter, 2> kShapes{{{"low", kUnit, -1e3, 1e3, -1.0, "first knot"},
                                                     {"high", kUnit, -1e3, 1e3, 1.0, "last knot"}}};
  static constexpr Parameter knot(const char* name) {
    return {name, "m/s^2", -kMaxForce, kMaxForce, 0.0, "force at this knot, per moved mass"};
  }
  static constexpr std::array<Parameter, kKnots> kCoefficients{
      {knot("force_1"), knot("force_2"), knot("force_3"), knot("force_4"), knot("force_5"),
       knot("force_6"), knot("force_7"), knot("force_8"), knot("force_9")}};
  template <class T>
  using Memory = NoMemory;

  template <class T, class M>
  static void unit_forces(const T* shape, NoMemory& /*memory*/, const MotionOf<M>& m,
                          T* force) noexcept {
    const M at = over == Over::kPosition   ? m.position
                 : over == Over::kVelocity ? m.velocity
                                           : m.command_acceleration;
    constexpr double kLast = kKnots - 1;
    T u = kLast * (at - shape[0]) / (shape[1] - shape[0]);
    if (u < 0.0) u = T(0.0);
    if (u > kLast) u = T(kLast);
    for (std::size_t i = 0; i < kKnots; ++i) {
      const T away = u - static_cast<double>(i);
      const T near = away < 0.0 ? 1.0 + away : 1.0 - away;
      force[i] = near > 0.0 ? near : T(0.0);
    }
  }
};

using UnexplainedOverPosition = UnexplainedForce<Over::kPosition>;
using UnexplainedOverVelocity = UnexplainedForce<Over::kVelocity>;
using UnexplainedOverAcceleration = UnexplainedForce<Over::kAcceleration>;

}  // namespace servotwin
