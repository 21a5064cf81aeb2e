// Play between the loop's encoder and the recorded one.
//
//   reading - x = -p,   p: play of the load in the gap (twin/effects/load_in_gap.h)
//
// If its friction stops the load at once, it stays where it is until it is taken along: the play of
// the textbooks. Source: docs/theory.md 3.11.
#pragma once

#include <array>

#include "twin/effects/load_in_gap.h"

namespace servotwin {

struct Backlash {
  static constexpr Identity kIdentity{
      .id = "backlash",
      .meaning = "play between the encoder of the loop and the recorded one",
      .acts = Acts::kReading,
      .cause = "backlash",
      .check = "play of coupling, nut or gear, and bearings between the two encoders"};
  static constexpr std::array<Parameter, 3> kShapes = kGapShapes;
  static constexpr std::array<Parameter, 2> kCoefficients{
      {{"share", "1", 0.7, 1.4, 1.0, "share of the play seen in the reading; 1 for true backlash"},
       {"offset", "m", -1.0, 1.0, 0.0, "constant offset of the reading", true, false, Scan::kNone,
        true}}};
  template <class T>
  using Memory = LoadInGap<T>;

  template <class T, class M>
  static void unit_forces(const T* shape, Memory<T>& memory, const MotionOf<M>& m,
                          T* force) noexcept {
    memory.follow(shape, m);
    force[0] = -memory.play;
    force[1] = T(1.0);
  }
};

}  // namespace servotwin
