// The cutting force: a mean, and a tone at the tooth-passing frequency.
//
//   d = in_cut (mean + sine sin(2 pi f t) + cosine cos(2 pi f t))
//
// `in_cut` is given by the recording, or detected from the tone (diagnosis/evidence/cuts.h).
// Source: docs/theory.md 3.11.
#pragma once

#include <array>
#include <cmath>
#include <numbers>

#include "twin/effect.h"

namespace servotwin {

struct CuttingForce {
  static constexpr Identity kIdentity{
      .id = "cutting_force",
      .meaning =
          "mean force and a sinusoidal force at the tooth-passing frequency while the tool cuts",
      .acts = Acts::kForce,
      .cause = "cutting_force",
      .check = "feed per tooth, wear and runout of the tool",
      .of_its_recording = true};
  static constexpr std::array<Parameter, 1> kShapes{
      {{"tooth_frequency_hz", "Hz", 0.2, 2000.0, 50.0, "tooth-passing frequency", true, false,
        Scan::kFrequency}}};
  static constexpr std::array<Parameter, 3> kCoefficients{
      {{"mean", "m/s^2", -kMaxForce, kMaxForce, 0.0, "mean force, per moved mass"},
       {"sine", "m/s^2", -kMaxForce, kMaxForce, 0.0, "amplitude of the sine"},
       {"cosine", "m/s^2", -kMaxForce, kMaxForce, 0.0, "amplitude of the cosine"}}};
  template <class T>
  using Memory = NoMemory;

  template <class T, class M>
  static void unit_forces(const T* shape, NoMemory& /*memory*/, const MotionOf<M>& m,
                          T* force) noexcept {
    using std::cos;
    using std::sin;
    const T angle = 2.0 * std::numbers::pi * shape[0] * m.time_s;
    force[0] = T(m.in_cut);
    force[1] = m.in_cut * sin(angle);
    force[2] = m.in_cut * cos(angle);
  }
};

}  // namespace servotwin
