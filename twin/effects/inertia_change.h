// A moved mass that changes at a moment: another tool, another workpiece.
//
//   ratio x'' = u - f  is  x'' = u - f - d   with   d = (ratio - 1) onset(t - time) x''
//
// x'' is the acceleration of the axis itself, which lags that of the command with a soft velocity
// loop and depends on friction. Source: docs/theory.md 3.11.
#pragma once

#include <array>
#include <cmath>

#include "twin/effect.h"
#include "twin/effects/onset.h"

namespace servotwin {

struct InertiaChange {
  static constexpr Identity kIdentity{
      .id = "inertia_change",
      .meaning = "moved mass that changes at one time of the recording",
      .acts = Acts::kForce,
      .cause = "inertia_change",
      .check = "what was loaded or unloaded at that time; load-dependent parameters",
      .of_its_recording = true};
  static constexpr std::array<Parameter, 1> kShapes{
      {{"time_s", "s", 1e-3, 1e7, 1.0, "time in the recording at which it changes", true, false,
        Scan::kTime}}};
  static constexpr std::array<Parameter, 1> kCoefficients{
      {{"ratio_less_1", "1", -0.9, 10.0, 0.0, "moved mass after over before, minus 1"}}};
  template <class T>
  using Memory = NoMemory;

  template <class T, class M>
  static void unit_forces(const T* shape, NoMemory& /*memory*/, const MotionOf<M>& m,
                          T* force) noexcept {
    force[0] = onset(m.time_s, shape[0]) * m.acceleration;
  }
};

}  // namespace servotwin
