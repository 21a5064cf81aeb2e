// What the forces that a step solves for do to its derivatives.
//
// A step is computed with those forces as further derivatives, at the values where the balance
// holds. The balance gives how the forces depend on the parameters (implicit function theorem), and
// with that every quantity of the step its derivatives by the parameters alone.
//
// Errors: none; where the balance does not depend on the forces the derivatives are not finite.
// Any thread; allocates nothing. Source: docs/theory.md 5.1.
#pragma once

#include <Eigen/LU>
#include <array>
#include <cstddef>

#include "twin/dual.h"
#include "twin/effect.h"

namespace servotwin {

// Lanes of the forces that a step solves for.
inline constexpr std::size_t kMotorLane = kParametersPerPass, kLoadLane = kMotorLane + 1,
                             kContactLane = kMotorLane + 2;

/// A force that is solved for.
[[nodiscard]] inline TwinDual unknown(double value, std::size_t lane) noexcept {
  TwinDual out(value);
  out.by[lane] = 1.0;
  return out;
}

/// Replaces derivatives by the forces that were solved for by those of the forces.
class Resolution {
 public:
  /// From the derivatives of what is zero there (implicit function theorem): of the motor's force
  /// alone, or of all.
  explicit Resolution(const TwinDual& miss) noexcept {
    set(0, -miss.by / miss.by[kMotorLane]);
    for (std::size_t f = 1; f < kForcesPerStep; ++f) set(f, TwinDual::Derivatives::Zero());
  }
  explicit Resolution(const std::array<TwinDual, kForcesPerStep>& misses) noexcept {
    Eigen::Matrix3d by_force;
    for (std::size_t r = 0; r < kForcesPerStep; ++r) {
      for (std::size_t c = 0; c < kForcesPerStep; ++c)
        by_force(static_cast<int>(r), static_cast<int>(c)) = misses[r].by[kMotorLane + c];
    }
    const Eigen::Matrix3d inverse = by_force.inverse();
    for (std::size_t f = 0; f < kForcesPerStep; ++f) {
      const Eigen::RowVector3d row = -inverse.row(static_cast<int>(f));
      set(f, row(0) * misses[0].by + row(1) * misses[1].by + row(2) * misses[2].by);
    }
  }
  void operator()(TwinDual& x) const noexcept {
    for (std::size_t f = 0; f < kForcesPerStep; ++f) {
      const double by = x.by[kMotorLane + f];
      if (by != 0.0) x.by += by * forces_[f];
    }
  }

 private:
  /// The lanes of the forces themselves take out what is replaced.
  void set(std::size_t force, const TwinDual::Derivatives& by) noexcept {
    forces_[force] = by;
    forces_[force].tail<static_cast<int>(kForcesPerStep)>().setZero();
    forces_[force][kMotorLane + force] = -1.0;
  }
  std::array<TwinDual::Derivatives, kForcesPerStep> forces_;
};

/// The same for all of a body's motion at the end of a step.
inline void resolve_motion(const Resolution& resolve, MotionOf<TwinDual>& m) noexcept {
  for (TwinDual* x : {&m.position, &m.velocity, &m.displacement, &m.acceleration, &m.tracking_error,
                      &m.demand, &m.friction, &m.of_control, &m.demand_rate, &m.demand_damping})
    resolve(*x);
}

}  // namespace servotwin
