// A filter in the control, beside the two or three poles of the loop: of the command, of the
// velocity, of the torque; a current loop; a lag of computing. Two more poles, without vibration.
//
// The formula is that of compliance.h, with a damping ratio at which nothing rings, and stepped
// with the mean of both inputs over the cycle: that of the acceleration is what the velocity has
// changed by, so that an acceleration which is known by the last commands only does not add up. A
// filter that is as large as the loop must not shift with the sampling time. Every control has
// something like it, so that it is no cause. Source: docs/theory.md 3.11.
#pragma once

#include <array>
#include <cstddef>
#include <numbers>

#include "twin/effect.h"
#include "twin/effects/compliance.h"
#include "twin/effects/swing.h"

namespace servotwin {

struct ControlFilter {
  static constexpr Identity kIdentity{.id = "control_filter",
                                      .meaning = "a filter or lag in the control",
                                      .acts = Acts::kForce,
                                      .on_motor = true,
                                      .of_control = true};
  static constexpr std::array<Parameter, 2> kShapes{
      {{"frequency_hz", "Hz", 0.5, 2000.0, 50.0, "undamped frequency of its two poles", true, false,
        Scan::kFrequency},
       {"damping_ratio", "1", 0.2, 3.0, 0.8, "zeta; above 1 two real poles"}}};
  static constexpr std::array<Parameter, 4> kCoefficients = Compliance::kCoefficients;
  /// Whether a fit with these shapes is a filter. One that ends at a bound is something else: a
  /// vibration, or what no two poles can be.
  [[nodiscard]] static constexpr bool is_one(const double* shape) noexcept {
    constexpr double kMargin = 0.02;
    for (std::size_t i = 0; i < kShapes.size(); ++i) {
      if (shape[i] < (1.0 + kMargin) * kShapes[i].lower ||
          shape[i] > (1.0 - kMargin) * kShapes[i].upper)
        return false;
    }
    return true;
  }

  template <class T>
  struct Memory {
    Memory() = default;
    explicit Memory(const T* /*shape*/) noexcept {}
    Swing<T> by_command;                      // [m], [m/s]
    Swing<T> by_friction;                     // r [1], [1/s]
    T velocity = T(0.0), direction = T(0.0);  // of the cycle before
    bool under_way = false;
    /// As after a long motion with these.
    void settle(const T* shape, const T& speed, const T& acceleration, const T& towards) noexcept {
      const T w = 2.0 * std::numbers::pi * shape[0];
      by_command = {-acceleration / (w * w), T(0.0)};
      by_friction = {-towards, T(0.0)};
      velocity = speed;
      direction = towards;
      under_way = true;
    }
    template <class F>
    void each(const F& f) {
      by_command.each(f);
      by_friction.each(f);
      f(velocity);
      f(direction);
    }
  };

  template <class T, class M>
  static void unit_forces(const T* shape, Memory<T>& memory, const MotionOf<M>& m,
                          T* force) noexcept {
    const SwingStep<T> poles(shape[0], shape[1], m.step_s);
    const T velocity(m.command_velocity), direction(m.direction());
    T acceleration(m.command_acceleration);
    if (memory.under_way) acceleration = (velocity - memory.velocity) / m.step_s;
    poles.advance(memory.by_command, -acceleration / (poles.w * poles.w));
    poles.advance(memory.by_friction, -0.5 * (memory.direction + direction));
    memory.velocity = velocity;
    memory.direction = direction;
    memory.under_way = true;
    force[0] = poles.w * memory.by_command.q;
    force[1] = memory.by_command.rate;
    force[2] = memory.by_friction.q + direction;
    force[3] = memory.by_friction.rate / poles.w;
  }
};

}  // namespace servotwin
