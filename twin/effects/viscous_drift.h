// Viscous friction that decreases as the machine warms up (Bittencourt et al. 2010,
// LiTH-ISY-R-2948; docs/theory.md 3.11).
//
//   d = cold exp(-t / time_constant) v
//
// beside the viscous friction of the warm machine, which is part of the poles.
#pragma once

#include <array>
#include <cmath>

#include "twin/effect.h"

namespace servotwin {

struct ViscousDrift {
  static constexpr Identity kIdentity{
      .id = "viscous_drift",
      .meaning = "viscous friction that decreases with running time",
      .acts = Acts::kForce,
      .cause = "viscous_drift",
      .check = "lubricant and its temperature; warming up before precision work",
      .of_its_recording = true};
  static constexpr std::array<Parameter, 1> kShapes{
      {{"time_constant_s", "s", 2.0, 1e4, 20.0, "time in which it falls to 1/e"}}};
  static constexpr std::array<Parameter, 1> kCoefficients{
      {{"cold", "1/s", -1000.0, 1000.0, 0.0,
        "viscous friction at the start of the recording minus that when warm, per moved mass"}}};
  template <class T>
  using Memory = NoMemory;

  template <class T, class M>
  static void unit_forces(const T* shape, NoMemory& /*memory*/, const MotionOf<M>& m,
                          T* force) noexcept {
    using std::exp;
    force[0] = exp(-m.time_s / shape[0]) * m.velocity;
  }
};

}  // namespace servotwin
