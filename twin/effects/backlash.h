// Play between the loop's encoder and the one that is recorded.
//
//   play: p follows x within +- width / 2;   reading - x = p - x
#pragma once

#include <array>

#include "twin/effect.h"

namespace servotwin {

struct Backlash {
  static constexpr Identity kIdentity{
      .id = "backlash",
      .meaning = "play between the encoder of the loop and the recorded one",
      .acts = Acts::kReading,
      .source = "docs/theory.md 3.11",
      .confused =
          "presliding and compliance, which give with force; Coulomb friction without an "
          "integrator",
      .cause = "backlash",
      .check = "play of coupling, nut and bearings between the two encoders"};
  static constexpr std::array<Parameter, 1> kShapes{
      {{"width", "m", 1e-7, 1e-2, 1e-5, "of the gap"}}};
  static constexpr std::array<Parameter, 2> kCoefficients{
      {{"share", "1", 0.7, 1.4, 1.0, "of the gap that is seen: 1, or it is no gap"},
       {"offset", "m", -1.0, 1.0, 0.0, "where the axis was set to 0", true, false, Scan::kNone,
        true}}};
  template <class T>
  struct Memory {
    Memory() = default;
    explicit Memory(const T* /*shape*/) noexcept {}
    T play = T(0.0);  // x - p
  };

  template <class T>
  static void unit_forces(const T* shape, Memory<T>& memory, const Motion& m, T* force) noexcept {
    const T half = 0.5 * shape[0];
    memory.play += m.displacement;
    if (memory.play > half) memory.play = half;
    if (memory.play < -half) memory.play = -half;
    force[0] = -memory.play;
    force[1] = T(1.0);
  }
};

}  // namespace servotwin
