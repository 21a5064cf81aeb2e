// Short pushes at a few moments: chips, a jammed cover segment, something that touches the table.
//
//   d = sum_i push_i (1 + cos(pi (t - time_i) / width)) / 2   within one width of the moment
//
// Source: docs/theory.md 3.11.
#pragma once

#include <array>
#include <cmath>
#include <numbers>

#include "twin/effect.h"

namespace servotwin {

struct ImpulseDisturbance {
  static constexpr std::size_t kPushes = 4;
  static constexpr Identity kIdentity{
      .id = "impulse_disturbance",
      .meaning = "short force impulses at up to four times of the recording",
      .acts = Acts::kForce,
      .cause = "impulse_disturbance",
      .check = "chips, jammed cover segments, collision with the table at that time",
      .of_its_recording = true};
  static constexpr std::array<Parameter, kPushes + 1> kShapes{
      {{"time_1_s", "s", 1e-3, 1e7, 1.0, "time of a peak in the recording", true, false,
        Scan::kMoments},
       {"time_2_s", "s", 1e-3, 1e7, 2.0, "time of a peak in the recording"},
       {"time_3_s", "s", 1e-3, 1e7, 3.0, "time of a peak in the recording"},
       {"time_4_s", "s", 1e-3, 1e7, 4.0, "time of a peak in the recording"},
       {"width_s", "s", 2e-3, 0.05, 8e-3, "full width at half the peak"}}};
  static constexpr std::array<Parameter, kPushes> kCoefficients{
      {{"push_1", "m/s^2", -1000.0, 1000.0, 0.0, "force at the peak, per moved mass"},
       {"push_2", "m/s^2", -1000.0, 1000.0, 0.0, "force at the peak, per moved mass"},
       {"push_3", "m/s^2", -1000.0, 1000.0, 0.0, "force at the peak, per moved mass"},
       {"push_4", "m/s^2", -1000.0, 1000.0, 0.0, "force at the peak, per moved mass"}}};
  template <class T>
  using Memory = NoMemory;

  template <class T, class M>
  static void unit_forces(const T* shape, NoMemory& /*memory*/, const MotionOf<M>& m,
                          T* force) noexcept {
    using std::cos;
    for (std::size_t i = 0; i < kPushes; ++i) {
      const T u = (m.time_s - shape[i]) / shape[kPushes];
      force[i] = u > -1.0 && u < 1.0 ? 0.5 * (1.0 + cos(std::numbers::pi * u)) : T(0.0);
    }
  }
};

}  // namespace servotwin
