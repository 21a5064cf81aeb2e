// A position-loop gain that changes at a moment.
//
//   d = onset(t - time) (proportional e + integral int e dt)
//
// A lower gain gives less force for the same tracking error e, which equals a force against it. If
// the velocity loop integrates, the change is in both parts. docs/theory.md 3.11 gives the ratio of
// the gains.
#pragma once

#include <array>
#include <cmath>

#include "twin/effect.h"
#include "twin/effects/onset.h"

namespace servotwin {

struct GainChange {
  static constexpr Identity kIdentity{
      .id = "gain_change",
      .meaning = "position-loop gain that changes at one time of the recording",
      .acts = Acts::kForce,
      .cause = "gain_change",
      .check = "parameter sets and gain switching of the control",
      .on_motor = true,
      .of_control = true,
      .of_its_recording = true};
  static constexpr std::array<Parameter, 1> kShapes{
      {{"time_s", "s", 1e-3, 1e7, 1.0, "time in the recording at which it changes", true, false,
        Scan::kTime}}};
  static constexpr std::array<Parameter, 2> kCoefficients{
      {{"proportional", "1/s^2", -1e6, 1e6, 0.0, "force per tracking error, per moved mass"},
       {"integral", "1/s^3", -1e8, 1e8, 0.0, "force per integral of the tracking error"}}};
  template <class T>
  struct Memory {
    Memory() = default;
    explicit Memory(const T* /*shape*/) noexcept {}
    T integral = T(0.0);
    template <class F>
    void each(const F& f) {
      f(integral);
    }
  };

  template <class T, class M>
  static void unit_forces(const T* shape, Memory<T>& memory, const MotionOf<M>& m,
                          T* force) noexcept {
    const T on = onset(m.time_s, shape[0]);
    force[0] = on * m.tracking_error;
    memory.integral += on * (m.tracking_error * m.step_s);
    force[1] = memory.integral;
  }
};

}  // namespace servotwin
