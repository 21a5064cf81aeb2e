// A screw that expands as it warms up, seen by an encoder behind it.
//
//   reading - x = (growth x + drift) (1 - exp(-t / time_constant)) + offset
//
// Source: docs/theory.md 3.11.
#pragma once

#include <array>
#include <cmath>

#include "twin/effect.h"

namespace servotwin {

struct ThermalGrowth {
  static constexpr Identity kIdentity{
      .id = "thermal_growth",
      .meaning =
          "thermal expansion: a reading error that grows with position and time, outside the loop",
      .acts = Acts::kReading,
      .cause = "thermal_growth",
      .check = "warming up of screw or gear; its cooling and pretension",
      .of_its_recording = true};
  static constexpr std::array<Parameter, 1> kShapes{
      {{"time_constant_s", "s", 2.0, 1e4, 20.0, "time constant of warming up"}}};
  static constexpr std::array<Parameter, 3> kCoefficients{
      {{"growth", "1", -0.1, 0.1, 0.0, "expansion per position, when warm"},
       {"drift", "m", -1.0, 1.0, 0.0, "displacement of the fixed bearing, when warm"},
       {"offset", "m", -1.0, 1.0, 0.0, "constant offset of the reading", true, false, Scan::kNone,
        true}}};
  template <class T>
  using Memory = NoMemory;

  template <class T, class M>
  static void unit_forces(const T* shape, NoMemory& /*memory*/, const MotionOf<M>& m,
                          T* force) noexcept {
    using std::exp;
    const T warm = 1.0 - exp(-m.time_s / shape[0]);
    force[0] = warm * m.position;
    force[1] = warm;
    force[2] = T(1.0);
  }
};

}  // namespace servotwin
