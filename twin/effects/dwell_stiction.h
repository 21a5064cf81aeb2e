// Breakaway that grows with the time at rest (Kato, Sato, Matsubayashi 1972; docs/theory.md 3.11).
//
//   d = growth E direction,   dE = d log(1 + theta / rest_time) while theta grows
//                             dE/ds = -E / length  along the travel s
//
// theta is the age of the contacts, d theta/dt = 1 - |v| theta / kContact_m (the aging law of
// rate-and-state friction, Dieterich 1979): the time at rest while the axis stands, close to 0 in
// motion, starting anew after every settling. direction: Motion::direction.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>

#include "twin/effect.h"

namespace servotwin {

struct DwellStiction {
  static constexpr Identity kIdentity{
      .id = "dwell_stiction",
      .meaning = "breakaway force that grows with the time at rest",
      .acts = Acts::kForce,
      .cause = "dwell_stiction",
      .check = "lubricant film squeezed out at rest; lubrication after pauses"};
  static constexpr std::array<Parameter, 2> kShapes{
      {{"length", "m", 1e-6, 5e-4, 5e-5, "travel after which the increase has decayed to 1/e"},
       {"rest_time", "s", 1e-3, 10.0, 0.1, "time at rest from which it grows logarithmically"}}};
  static constexpr std::array<Parameter, 1> kCoefficients{
      {{"growth", "m/s^2", 0.0, kMaxForce, 0.0,
        "increase per e-fold of the time at rest, per moved mass"}}};
  /// Travel after which the contacts are new [m]: the size of a few asperities.
  static constexpr double kContact_m = 1e-6;
  template <class T>
  struct Memory {
    Memory() = default;
    explicit Memory(const T* /*shape*/) noexcept {}
    T age_s = T(0.0);  // theta
    T extra = T(0.0);  // E
    template <class F>
    void each(const F& f) {
      f(age_s);
      f(extra);
    }
  };

  template <class T, class M>
  static void unit_forces(const T* shape, Memory<T>& memory, const MotionOf<M>& m,
                          T* force) noexcept {
    using std::abs;
    using std::exp;
    using std::log;
    // The smaller of the two: an encoder whose last digit toggles does not move.
    const M moved = std::min<M>(abs(m.displacement), abs(m.velocity) * m.step_s);
    const T before = memory.age_s;
    memory.age_s = (before + m.step_s) * exp(-moved / kContact_m);
    if (memory.age_s > before) memory.extra += log((shape[1] + memory.age_s) / (shape[1] + before));
    memory.extra *= exp(-moved / shape[0]);
    force[0] = memory.extra * m.direction();
  }
};

}  // namespace servotwin
