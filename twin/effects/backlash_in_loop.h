// Play inside the loop: the motor crosses the gap at every reversal while the table stands.
//
//   d = rate (x_r' - p'),   p: play, which follows the command within +- width / 2
//
// This is an impulse of rate times width at every reversal, spread over the crossing. Source:
// docs/theory.md 3.11.
#pragma once

#include <array>

#include "twin/effect.h"

namespace servotwin {

struct BacklashInLoop {
  static constexpr Identity kIdentity{
      .id = "backlash_in_loop",
      .meaning = "play inside the position loop",
      .acts = Acts::kForce,
      .cause = "backlash",
      .check = "play of coupling, nut or gear, and bearings; backlash compensation of the control",
      .on_motor = true};
  static constexpr std::array<Parameter, 1> kShapes{
      {{"width", "m", 1e-7, 1e-2, 1e-5, "width of the gap"}}};
  static constexpr std::array<Parameter, 1> kCoefficients{
      {{"rate", "1/s", -1e5, 1e5, 0.0,
        "force per speed at which the gap is crossed, per moved mass"}}};
  template <class T>
  struct Memory {
    Memory() = default;
    explicit Memory(const T* /*shape*/) noexcept {}
    T play = T(0.0);
    template <class F>
    void each(const F& f) {
      f(play);
    }
  };

  template <class T, class M>
  static void unit_forces(const T* shape, Memory<T>& memory, const MotionOf<M>& m,
                          T* force) noexcept {
    const T half = 0.5 * shape[0];
    const T before = memory.play;
    memory.play += m.command_velocity * m.step_s;
    if (memory.play > half) memory.play = half;
    if (memory.play < -half) memory.play = -half;
    force[0] = (memory.play - before) / m.step_s;
  }
};

}  // namespace servotwin
