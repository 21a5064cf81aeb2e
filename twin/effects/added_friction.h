// Friction that sets in at a moment: a cover that grips, a guide that runs dry.
//
//   d = onset(t - time) (coulomb direction + viscous v)
//
// direction is that of the model's friction law (Motion::direction). Source: docs/theory.md 3.11.
#pragma once

#include <array>
#include <cmath>

#include "twin/effect.h"
#include "twin/effects/onset.h"

namespace servotwin {

struct AddedFriction {
  static constexpr Identity kIdentity{
      .id = "added_friction",
      .meaning = "friction that is added at one time of the recording",
      .acts = Acts::kForce,
      .cause = "added_friction",
      .check = "what changed at that time: cover, wiper, clamp, lubrication",
      .of_its_recording = true};
  static constexpr std::array<Parameter, 1> kShapes{
      {{"time_s", "s", 1e-3, 1e7, 1.0, "time in the recording at which it is added", true, false,
        Scan::kTime}}};
  static constexpr std::array<Parameter, 2> kCoefficients{
      {{"coulomb", "m/s^2", -kMaxForce, kMaxForce, 0.0, "added Coulomb friction, per moved mass"},
       {"viscous", "1/s", -1000.0, 1000.0, 0.0, "added viscous friction, per moved mass"}}};
  template <class T>
  using Memory = NoMemory;

  template <class T, class M>
  static void unit_forces(const T* shape, NoMemory& /*memory*/, const MotionOf<M>& m,
                          T* force) noexcept {
    const T on = onset(m.time_s, shape[0]);
    force[0] = on * m.direction();
    force[1] = on * m.velocity;
  }
};

}  // namespace servotwin
