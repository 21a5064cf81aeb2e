// Breakaway that grows with the time of rest (ASME J. Lubrication Technology 94(3), 234).
//
//   d = growth E direction:   at rest E grows as log(1 + rest / rest_time),
//                             in motion it goes with the travel, dE/ds = -E / length
#pragma once

#include <array>
#include <cmath>

#include "twin/effect.h"

namespace servotwin {

struct DwellStiction {
  static constexpr Identity kIdentity{
      .id = "dwell_stiction",
      .meaning = "breakaway force that grows with the time of rest",
      .acts = Acts::kForce,
      .source = "ASME J. Lubr. Technol. 94(3) 234",
      .confused = "stribeck and presliding, which do not know how long the axis stood",
      .cause = "dwell_stiction",
      .check = "lubricant that is pressed out at rest; lubrication after pauses"};
  static constexpr std::array<Parameter, 2> kShapes{
      {{"length", "m", 1e-6, 5e-4, 5e-5, "of travel in which it is lost"},
       {"rest_time", "s", 1e-3, 10.0, 0.1, "of rest before it grows with the logarithm"}}};
  static constexpr std::array<Parameter, 1> kCoefficients{
      {{"growth", "m/s^2", 0.0, 100.0, 0.0, "per logarithm of the time of rest, per moved mass"}}};
  template <class T>
  struct Memory {
    Memory() = default;
    explicit Memory(const T* /*shape*/) noexcept {}
    double rest_s = 0.0;  // of the command
    T extra = T(0.0);     // E
  };

  template <class T>
  static void unit_forces(const T* shape, Memory<T>& memory, const Motion& m, T* force) noexcept {
    using std::exp;
    using std::log;
    constexpr double kStands_mps = 1e-7;
    if (std::abs(m.command_velocity) < kStands_mps) {
      memory.extra += log(1.0 + m.step_s / (shape[1] + memory.rest_s));
      memory.rest_s += m.step_s;
    } else {
      memory.rest_s = 0.0;
      memory.extra *= exp(-std::abs(m.displacement) / shape[0]);
    }
    force[0] = memory.extra * m.direction();
  }
};

}  // namespace servotwin
