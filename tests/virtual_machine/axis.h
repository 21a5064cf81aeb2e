// A virtual CNC axis: sampled cascade control, a body with friction, an encoder, and a recorder.
//
// The drive acts at t_k = k T_c with T_c = 1 / rate; the motor force is held in between:
//
//   x_k     = the encoder's reading of x(t_k)
//   v_k     = (x_k - x_(k-1)) / T_c
//   w_k     = Kp (r(t_k) - x_k) + Kvff r'(t_k) - v_k                 velocity error
//   u_k     = clamp(Kv w_k + I_k + Maff r''(t_k), -limit, limit)     motor force
//   I_(k+1) = I_k + Ki T_c w_k,     held while u_k is limited and w_k would push it further
//
// Ki = 0 is the drive without integrator. The body is integrated in finer steps between t_k and
// t_(k+1) (body.h). As T_c -> 0 the linear part becomes the continuous loop of `continuous_loop`,
// with an error of the order of T_c: the held force and the velocity from two readings delay by
// half a period each.
//
// At t = 0 the axis stands on its command, the drive has long been holding the constant load, and
// friction is relaxed. Row n of the record holds the command r(n T_s), and actual and torque as
// they were at n T_s - delay.
//
// SI units. Errors: std::invalid_argument with field, value and rule. Deterministic: noise comes
// from the seed. Any thread.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <functional>
#include <limits>
#include <string>

#include "tests/virtual_machine/body.h"
#include "tests/virtual_machine/trajectory.h"

namespace servotwin::virtual_machine {

/// The command as a function of time.
using Command = std::function<Setpoint(double)>;

struct Drive {
  double rate_hz = 8000.0;                ///< >= 8000
  int integration_steps = 16;             ///< of the body per period; rate * steps >= 80 kHz
  double position_gain = 0.0;             ///< Kp [1/s]
  double velocity_gain = 0.0;             ///< Kv [N s/m]
  double integral_gain = 0.0;             ///< Ki [N/m]; 0: no integrator
  double velocity_feedforward = 0.0;      ///< Kvff [-]
  double acceleration_feedforward = 0.0;  ///< Maff [kg]
  double force_limit = std::numeric_limits<double>::infinity();  ///< [N]
  double encoder_step = 0.0;  ///< of the position the drive reads [m]; 0: exact
};

struct Recorder {
  double sample_time = 1e-3;    ///< T_s [s]
  double position_step = 0.0;   ///< of the recorded actual position [m]; 0: exact
  double delay = 0.0;           ///< >= 0: actual and torque lag the command [s]
  double position_noise = 0.0;  ///< RMS, before the position step [m]
  double torque_noise = 0.0;    ///< RMS, in the unit of the torque
  std::uint64_t seed = 1;
};

struct Axis {
  std::string name = "X";
  BodyParameters body;
  Drive drive;
  Recorder recorder;
  double transmission = 1.0;  ///< recorded torque per motor force [m]: lead / (2 pi); 1: force in N
};

/// What was recorded, and the truth behind it. All arrays have the same length.
struct AxisRecord {
  std::string name;
  double sample_time = 0.0;
  Eigen::ArrayXd command;        ///< [m]
  Eigen::ArrayXd actual;         ///< [m]
  Eigen::ArrayXd torque;         ///< motor force times transmission [N m | N]
  Eigen::ArrayXd true_position;  ///< at the time of `actual`, without noise and rounding [m]
  Eigen::ArrayXd true_velocity;  ///< [m/s]
  Eigen::ArrayXd true_friction;  ///< [N], positive against positive motion
};

/// Records floor(duration / T_s) + 1 rows.
[[nodiscard]] AxisRecord record(const Axis& axis, const Command& command, double duration);
[[nodiscard]] AxisRecord record(const Axis& axis, const Trajectory& trajectory);

/// The loop without friction in the limit of a fast drive:
///   P(s) e = N(s) s r + (s | 1) (F + F0) / m
/// with integrator: P = s^3 + a1 s^2 + a2 s + a3, N = c0 s^2 + c1 s + c2, the force enters with s;
/// without:         P = s^2 + a1 s + a2,          N = c0 s + c1,          the force enters with 1.
struct ContinuousLoop {
  int order = 3;
  double a1 = 0.0, a2 = 0.0, a3 = 0.0;
  double c0 = 0.0, c1 = 0.0, c2 = 0.0;
};

[[nodiscard]] ContinuousLoop continuous_loop(const Axis& axis);

}  // namespace servotwin::virtual_machine
