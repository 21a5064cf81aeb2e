// An axis of two masses written as a cascade control in front of two bodies, integrated in steps of
// 2 us, and its model; shares no code with twin/two_mass_axis.h.
#pragma once

#include <algorithm>
#include <cmath>
#include <functional>
#include <utility>
#include <vector>

#include "twin/model.h"
#include "twin/two_pi.h"

namespace servotwin::test {

/// A cascade of P position and PI velocity control, per moved mass.
struct Cascade {
  double position_gain = 100.0, velocity_gain = 400.0, reset = 60.0;  // 1/s
  double velocity_feedforward = 0.5, acceleration_feedforward = 0.3;
};

struct TwoBodies {
  Encoders encoders = Encoders::kMotor;
  double frequency_hz = 45.0, zeta = 0.05, load_share = 0.6;
  double width = 0.0;                                     // m
  double motor_friction = 0.0, load_friction = 0.5;       // m/s^2
  double friction_velocity = 5e-4;                        // m/s
  double constant_force = 0.0;                            // on the load, m/s^2
  std::function<double(double)> motor_force, load_force;  // further ones by time, m/s^2
};

inline Model model_of(const Cascade& drive, const TwoBodies& axis, double h) {
  Model m;
  m.sample_time_s = h;
  const auto [kp, kv, reset, kff, aff] = drive;
  m.loop.order = reset > 0.0 ? 3 : 2;
  m.loop.denominator = {kv, kv * (kp + reset), kv * kp * reset};
  m.loop.numerator = {1.0 - aff, kv * (1.0 - kff), kv * reset * (1.0 - kff)};
  Effect friction = make_effect<CoulombFriction>();
  friction.shape[0] = axis.friction_velocity;
  friction.coefficient[0] = axis.motor_friction + axis.load_friction;
  Effect constant = make_effect<ConstantForce>();
  constant.coefficient[0] = axis.constant_force;
  m.effects = {friction};
  if (axis.constant_force != 0.0) m.effects.push_back(constant);
  Effect two;
  const bool play = axis.width > 0.0;
  two.kind = axis.encoders == Encoders::kMotor
                 ? (play ? kind_of<PlayMotorEncoder>() : kind_of<TwoMassMotorEncoder>())
             : axis.encoders == Encoders::kLoad
                 ? (play ? kind_of<PlayLoadEncoder>() : kind_of<TwoMassLoadEncoder>())
                 : (play ? kind_of<PlayOutside>() : kind_of<TwoMassOutside>());
  const double total = axis.motor_friction + axis.load_friction;
  two.shape = {axis.frequency_hz, axis.zeta, axis.load_share,
               total > 0.0 ? axis.load_friction / total : 1.0};
  std::size_t at = 4;
  if (axis.encoders == Encoders::kLoad) two.shape[at++] = reset > 0.0 ? reset : 30.0;
  if (play) two.shape[at] = axis.width;
  m.effects.push_back(two);
  return m;
}

/// Position, velocity and acceleration of the command.
struct Setpoint {
  double x = 0.0, v = 0.0, a = 0.0;
};
/// The tracking errors along a command that is given by time, one per cycle.
template <class Command>
std::vector<double> integrated(const Cascade& drive, const TwoBodies& axis, double h,
                               std::size_t rows, const Command& setpoint) {
  constexpr double kStep = 2e-6;
  const double w = kTwoPi * axis.frequency_hz, spring = w * w, damper = 2.0 * axis.zeta * w;
  const double share = axis.load_share;
  const double side = axis.constant_force == 0.0 ? 0.0 : std::copysign(0.5, axis.constant_force);
  const double deflection = axis.constant_force / (share * spring) + side * axis.width;
  const bool by_load = axis.encoders == Encoders::kLoad;
  const double held =
      drive.reset > 0.0 ? 0.0 : axis.constant_force / (drive.velocity_gain * drive.position_gain);
  double x1 = (by_load ? deflection : 0.0) - held, x2 = x1 - deflection, v1 = 0.0, v2 = 0.0;
  double integral = drive.reset > 0.0 ? axis.constant_force : 0.0;  // per moved mass
  std::vector<double> out;
  const auto per_cycle = static_cast<std::size_t>(std::lround(h / kStep));
  for (std::size_t k = 0; k < rows; ++k) {
    const double now = h * static_cast<double>(k);
    out.push_back(setpoint(now).x - (axis.encoders == Encoders::kMotor ? x1 : x2));
    for (std::size_t i = 0; i < per_cycle; ++i) {
      const double middle = now + kStep * (static_cast<double>(i) + 0.5);
      const Setpoint r = setpoint(middle);
      const double on_motor = axis.motor_force ? axis.motor_force(middle) : 0.0;
      const double on_load =
          axis.constant_force + (axis.load_force ? axis.load_force(middle) : 0.0);
      const auto friction = [&](double level, double v) {
        return level * std::clamp(v / axis.friction_velocity, -1.0, 1.0);
      };
      double miss = 0.0;
      const auto accelerations = [&](double y1, double y2, double u1, double u2) {
        miss = drive.position_gain * (r.x - (by_load ? y2 : y1)) +
               drive.velocity_feedforward * r.v - u1;
        const double demand =
            drive.velocity_gain * miss + integral + drive.acceleration_feedforward * r.a;
        const double apart = y1 - y2;
        const double beyond = apart - std::clamp(apart, -0.5 * axis.width, 0.5 * axis.width);
        double contact = 0.0;
        if (axis.width == 0.0 || beyond != 0.0)
          contact = share * (spring * beyond + damper * (u1 - u2));
        if (axis.width > 0.0 && contact * beyond < 0.0) contact = 0.0;
        return std::pair{
            (demand - contact - friction(axis.motor_friction, u1) - on_motor) / (1.0 - share),
            (contact - friction(axis.load_friction, u2) - on_load) / share};
      };
      const auto [a1, a2] = accelerations(x1, x2, v1, v2);
      const double y1 = x1 + 0.5 * kStep * v1, y2 = x2 + 0.5 * kStep * v2;
      const auto [b1, b2] = accelerations(y1, y2, v1 + 0.5 * kStep * a1, v2 + 0.5 * kStep * a2);
      x1 += kStep * (v1 + 0.5 * kStep * a1);
      x2 += kStep * (v2 + 0.5 * kStep * a2);
      v1 += kStep * b1;
      v2 += kStep * b2;
      if (drive.reset > 0.0) integral += kStep * drive.velocity_gain * drive.reset * miss;
    }
  }
  return out;
}

}  // namespace servotwin::test
