// Play between the motor, whose encoder is read, and the table: while the gap is crossed the motor
// moves without the table, and at its end it meets a table that stands.
//
//   play: p within +- width / 2 of the displacement;   free: share of the cycle's travel in the gap
//   d = - friction free sgn(x') - mass free x_r'' + impact (v / h where the gap closes)
//
// Friction and mass are those of the table, per moved mass of both; the blow takes the table along.
#pragma once

#include <array>
#include <cmath>

#include "twin/effect.h"

namespace servotwin {

struct BacklashAtMotor {
  static constexpr Identity kIdentity{
      .id = "backlash_at_motor",
      .meaning = "play between the motor, whose encoder is read, and the table",
      .acts = Acts::kForce,
      .source = "docs/theory.md 3.11",
      .confused = "presliding, whose force rises from the reversal on, where here it stays away",
      .cause = "backlash",
      .check = "play of coupling, nut and bearings; what compensates it in the control"};
  static constexpr std::array<Parameter, 1> kShapes{
      {{"width", "m", 1e-7, 1e-2, 1e-5, "of the gap"}}};
  static constexpr std::array<Parameter, 3> kCoefficients{
      {{"friction", "m/s^2", -100.0, 100.0, 0.0, "of the table, per moved mass"},
       {"mass", "1", -1.0, 1.0, 0.0, "share of the table"},
       {"impact", "1", -1.0, 1.0, 0.0, "share of the table that the blow takes along"}}};
  template <class T>
  struct Memory {
    Memory() = default;
    explicit Memory(const T* /*shape*/) noexcept {}
    T play = T(0.0);
    T blow = T(0.0);  // of the last cycle, left for this one
  };

  template <class T>
  static void unit_forces(const T* shape, Memory<T>& memory, const Motion& m, T* force) noexcept {
    const T half = 0.5 * shape[0];
    const T before = memory.play;
    memory.play += m.displacement;
    const bool closed = memory.play > half || memory.play < -half;
    if (memory.play > half) memory.play = half;
    if (memory.play < -half) memory.play = -half;
    const bool moves = m.displacement > kStill_m || m.displacement < -kStill_m;
    const T free = moves ? (memory.play - before) / m.displacement : T(0.0);
    force[0] = free * (m.displacement > 0.0 ? -1.0 : 1.0);
    force[1] = -free * m.command_acceleration;
    // Where within the cycle it closes says how the blow is divided between this cycle and the
    // next.
    const T blow = closed && free > 0.0 ? T(m.displacement / (m.step_s * m.step_s)) : T(0.0);
    force[2] = (1.0 - free) * blow + memory.blow;
    memory.blow = free * blow;
  }

 private:
  static constexpr double kStill_m = 1e-9;  // less than this is no motion of a cycle
};

}  // namespace servotwin
