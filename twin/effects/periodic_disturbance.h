// A force of fixed frequency in time, in motion and at rest: a pump, another machine, the mains.
//
//   d = sine sin(2 pi f t) + cosine cos(2 pi f t)
//
// Source: docs/theory.md 3.11.
#pragma once

#include <array>
#include <cmath>
#include <numbers>

#include "twin/effect.h"

namespace servotwin {

struct PeriodicDisturbance {
  static constexpr Identity kIdentity{
      .id = "periodic_disturbance",
      .meaning = "a force of fixed frequency in time",
      .acts = Acts::kForce,
      .cause = "periodic_disturbance",
      .check = "pumps, fans and neighbouring machines at this frequency; the mains",
      .of_its_recording = true};
  static constexpr std::array<Parameter, 1> kShapes{
      {{"frequency_hz", "Hz", 0.2, 2000.0, 10.0, "frequency of the force", true, false,
        Scan::kFrequency}}};
  static constexpr std::array<Parameter, 2> kCoefficients{
      {{"sine", "m/s^2", -kMaxForce, kMaxForce, 0.0, "amplitude of the sine, per moved mass"},
       {"cosine", "m/s^2", -kMaxForce, kMaxForce, 0.0, "amplitude of the cosine"}}};
  template <class T>
  using Memory = NoMemory;

  template <class T, class M>
  static void unit_forces(const T* shape, NoMemory& /*memory*/, const MotionOf<M>& m,
                          T* force) noexcept {
    using std::cos;
    using std::sin;
    const T angle = 2.0 * std::numbers::pi * shape[0] * m.time_s;
    force[0] = sin(angle);
    force[1] = cos(angle);
  }
};

}  // namespace servotwin
