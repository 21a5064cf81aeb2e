// Breakaway that grows with the time of rest (ASME J. Lubrication Technology 94(3), 234).
//
//   d = growth E direction,   dE = d log(1 + theta / rest_time) while theta grows
//                             dE/ds = -E / length  along the travel s
//
// theta is the age of the contacts, d theta/dt = 1 - |v| theta / kContact_m (the aging law of
// rate-and-state friction, J. Geophys. Res. 84 (1979) 2161): the time of rest where the axis
// stands, next to nothing in motion, and begun again by every settling after it.
#pragma once

#include <algorithm>
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
  /// Travel in which the contacts are new ones [m]: a few asperities.
  static constexpr double kContact_m = 1e-6;
  template <class T>
  struct Memory {
    Memory() = default;
    explicit Memory(const T* /*shape*/) noexcept {}
    double age_s = 0.0;  // theta
    T extra = T(0.0);    // E
  };

  template <class T>
  static void unit_forces(const T* shape, Memory<T>& memory, const Motion& m, T* force) noexcept {
    using std::exp;
    using std::log;
    // Of the two the smaller: the last digit of an encoder that comes and goes is no motion.
    const double moved = std::min(std::abs(m.displacement), std::abs(m.velocity) * m.step_s);
    const double before = memory.age_s;
    memory.age_s = (before + m.step_s) * exp(-moved / kContact_m);
    if (memory.age_s > before) memory.extra += log((shape[1] + memory.age_s) / (shape[1] + before));
    memory.extra *= exp(-moved / shape[0]);
    force[0] = memory.extra * m.direction();
  }
};

}  // namespace servotwin
