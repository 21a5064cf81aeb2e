// A lead error of the screw, seen by an encoder behind it and not by the loop.
//
//   reading - x = slope x + sine sin(2 pi x / period) + cosine cos(..) + offset
//
// Source: docs/theory.md 3.11.
#pragma once

#include <array>
#include <cmath>
#include <numbers>

#include "twin/effect.h"

namespace servotwin {

struct LeadError {
  static constexpr Identity kIdentity{
      .id = "lead_error",
      .meaning = "position-dependent error between the loop's encoder and the recorded encoder",
      .acts = Acts::kReading,
      .cause = "lead_error",
      .check = "pitch compensation table; pitch of screw or gear"};
  static constexpr std::array<Parameter, 1> kShapes{
      {{"period", "m", 2e-5, 10.0, 5e-3, "period of the error along the axis", true, false,
        Scan::kPeriod}}};
  static constexpr std::array<Parameter, 4> kCoefficients{
      {{"slope", "1", -0.1, 0.1, 0.0, "error per travel"},
       {"sine", "m", -1e-2, 1e-2, 0.0, "amplitude of the sine"},
       {"cosine", "m", -1e-2, 1e-2, 0.0, "amplitude of the cosine"},
       {"offset", "m", -1.0, 1.0, 0.0, "constant offset of the reading", true, false, Scan::kNone,
        true}}};
  template <class T>
  using Memory = NoMemory;

  template <class T, class M>
  static void unit_forces(const T* shape, NoMemory& /*memory*/, const MotionOf<M>& m,
                          T* force) noexcept {
    using std::cos;
    using std::sin;
    const T angle = 2.0 * std::numbers::pi * m.position / shape[0];
    force[0] = T(m.position);
    force[1] = sin(angle);
    force[2] = cos(angle);
    force[3] = T(1.0);
  }
};

}  // namespace servotwin
