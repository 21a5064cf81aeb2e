// A push at a moment: a chip, a jammed cover segment, something that touches the table.
//
//   d = force (1 + cos(pi (t - time) / width)) / 2   within one width of the moment
#pragma once

#include <array>
#include <cmath>
#include <numbers>

#include "twin/effect.h"

namespace servotwin {

struct ImpulseDisturbance {
  static constexpr Identity kIdentity{
      .id = "impulse_disturbance",
      .meaning = "a short push at a moment of the recording",
      .acts = Acts::kForce,
      .source = "docs/theory.md 3.11",
      .confused = "dropped_samples; backlash, which is at every reversal",
      .cause = "impulse_disturbance",
      .check = "chips, jammed cover segments, what touched the table at that moment"};
  static constexpr std::array<Parameter, 2> kShapes{
      {{"time_s", "s", 1e-3, 1e7, 1.0, "of its peak, in the recording", true, false, Scan::kTime},
       {"width_s", "s", 2e-3, 0.2, 1e-2, "of half its height"}}};
  static constexpr std::array<Parameter, 1> kCoefficients{
      {{"force", "m/s^2", -1000.0, 1000.0, 0.0, "at its peak, per moved mass"}}};
  template <class T>
  using Memory = NoMemory;

  template <class T>
  static void unit_forces(const T* shape, NoMemory& /*memory*/, const Motion& m,
                          T* force) noexcept {
    using std::cos;
    const T u = (m.time_s - shape[0]) / shape[1];
    force[0] = u > -1.0 && u < 1.0 ? 0.5 * (1.0 + cos(std::numbers::pi * u)) : T(0.0);
  }
};

}  // namespace servotwin
