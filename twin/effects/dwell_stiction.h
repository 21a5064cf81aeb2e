// Breakaway that grows with the time of rest (ASME J. Lubrication Technology 94(3), 234).
//
//   d = growth log(1 + rest / 1 s) sgn(v) exp(-travel / length)   after every rest
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
  static constexpr std::array<Parameter, 1> kShapes{
      {{"length", "m", 1e-6, 5e-4, 5e-5, "of travel in which it is lost"}}};
  static constexpr std::array<Parameter, 1> kCoefficients{
      {{"growth", "m/s^2", 0.0, 100.0, 0.0, "per logarithm of the time of rest, per moved mass"}}};
  template <class T>
  struct Memory {
    Memory() = default;
    explicit Memory(const T* /*shape*/) noexcept {}
    double rest_s = 0.0;  // of the command
    double extra = 0.0;   // logarithm of the last rest
    double travel = 0.0;  // since then
    bool moved = true;
  };

  template <class T>
  static void unit_forces(const T* shape, Memory<T>& memory, const Motion& m, T* force) noexcept {
    using std::exp;
    if (m.command_velocity == 0.0 || std::abs(m.command_velocity) < 1e-7) {
      if (memory.moved) memory.rest_s = 0.0;
      memory.moved = false;
      memory.rest_s += m.step_s;
    } else if (!memory.moved) {
      memory.moved = true;
      memory.extra = std::log1p(memory.rest_s);
      memory.travel = 0.0;
    }
    if (memory.moved) memory.travel += std::abs(m.displacement);
    const double sign = m.command_velocity > 0.0 ? 1.0 : (m.command_velocity < 0.0 ? -1.0 : 0.0);
    force[0] = memory.moved ? sign * memory.extra * exp(-memory.travel / shape[0]) : T(0.0);
  }
};

}  // namespace servotwin
