// A feed axis with hidden effects: motor and table connected by a spring with backlash, friction,
// cascade control.
//
//   m1 x1'' = u - B x1' / 2 + cogging(x1) - c - s F(x1, x1')   motor side, s: motor_share of F
//   m2 x2'' = c - B x2' / 2 - (1 - s) F(x2, x2') - F0 + d(t)   table
//   c       = k s + k_d (x1' - x2') while in contact,   s: x1 - x2 beyond +-gap/2
//
// A spring_frequency_hz of 0 makes them one body, x1 = x2. Friction is F = L phi, phi the unit
// state of the family (all families: |phi| = 1 in steady sliding, except for the fall with
// velocity) and L the level, which depends on position, time, direction and the preceding rest.
//
//   kCoulomb   phi = sat(v / saturation_velocity) S(v)         S(v) = 1 + rise exp(-|v| / v_s)
//   kMaxwell   phi = sum phi_i,  phi_i' = k_i v within +-share_i S(v)
//   kLuGre     phi = z + damping z',  z' = (v - |v| z / S(v)) / D
//
// The control runs at 8 kHz; the force is held between its periods:
//
//   w = Kp (r - y) + Kvff r' - v,   u = clamp(Kv w + I + Maff r''),   I' = Kv / Tn w
//
// While u is limited, I stops, unless w leads back below the limit (kClamping), or it stops in any
// case (kHolding), or it is led back by (u - what was wanted) / tracking_time (kTracking).
//
// r is the command behind two equal poles where command_filter_hz is not 0; the force follows u
// with current_lag.
//
// y is the reading of the encoder that closes the position loop, v always the motor's. The body is
// integrated by velocity Verlet at 64 kHz. The axis starts at rest on its command with the
// load held. The rig is independent of twin/: it shares no code with what is tested.
//
// SI units. Deterministic. Errors: std::invalid_argument for parameters out of range. Any thread.
#pragma once

#include <cstdint>
#include <functional>
#include <limits>
#include <string>
#include <vector>

#include "tests/virtual_machine/trajectory.h"

namespace servotwin::hidden_effects {

using Command = virtual_machine::Trajectory;

inline constexpr double kControlRate = 8000.0;
inline constexpr double kNever = std::numeric_limits<double>::infinity();

struct Friction {
  enum class Family { kCoulomb, kMaxwell, kLuGre };
  Family family = Family::kCoulomb;
  double level = 0.0;                 ///< [N]
  double motor_share = 0.0;           ///< of the level, on the motor; a rigid axis has one body
  double viscous = 0.0;               ///< B [N s/m]
  double saturation_velocity = 5e-4;  ///< kCoulomb [m/s]
  double presliding_distance = 2e-5;  ///< kMaxwell: all slides from here on; kLuGre: D [m]
  double curve = 3.0;                 ///< kMaxwell: steepness of the virgin curve, > 1
  double bristle_damping = 0.0;       ///< kLuGre: time of z' [s]
  double stribeck_rise = 0.0;         ///< at v = 0, share of the level
  double stribeck_velocity = 5e-3;    ///< [m/s]

  double direction_ratio = 1.0;  ///< of all friction, viscous too: positive over negative direction

  double wear = 0.0;  ///< the level at wear_place is 1 + wear times as high
  double wear_place = 0.0, wear_width = 0.05;  ///< a Gaussian of that standard deviation [m]

  double added_time = kNever;  ///< from here on [s]
  double added_level = 0.0, added_viscous = 0.0;

  double viscous_excess = 0.0;  ///< at t = 0, share of B; decays with viscous_time
  double viscous_time = 1.0;    ///< [s]

  double dwell_growth = 0.0;     ///< [N] per e-fold of the time at rest
  double dwell_time = 0.05;      ///< [s] of the first e-fold
  double dwell_distance = 2e-5;  ///< travel over which motion removes it again [m]
};

struct Body {
  double mass = 100.0;             ///< m1 + m2 [kg]
  double motor_share = 0.4;        ///< m1 / mass
  double spring_frequency_hz = 0;  ///< of the table with the motor held; 0: rigid
  double damping_ratio = 0.05;     ///< of the same
  /// The frequency is multiplied by 1 + this times the table position [1/m]; the damper stays.
  double spring_by_position = 0.0;
  double gap = 0.0;                                    ///< backlash, from end to end [m]
  double constant_force = 0.0;                         ///< F0 [N]
  double cogging = 0.0;                                ///< amplitude [N]
  double cogging_period = 0.005, cogging_phase = 0.0;  ///< [m], [rad]
  double mass_ratio = 1.0;                             ///< both masses, from mass_time on
  double mass_time = kNever;                           ///< [s]
};

enum class Encoder { kMotor, kLoad };

/// What the integrator does at the limit of the force.
enum class IntegratorAtLimit { kClamping, kHolding, kTracking };

struct Drive {
  double position_gain = 100.0;   ///< Kp [1/s]
  double velocity_gain = 40'000;  ///< Kv [N s/m]
  double integral_time = 0.0;     ///< Tn [s]; 0: no integrator
  double velocity_feedforward = 0.0;
  double acceleration_feedforward = 0.0;  ///< Maff [kg]
  double force_limit = kNever;            ///< [N]
  IntegratorAtLimit anti_windup = IntegratorAtLimit::kClamping;
  double tracking_time = 0.02;     ///< of kTracking [s]
  double command_filter_hz = 0.0;  ///< 0: none
  double current_lag = 0.0;        ///< of the current loop, first order [s]
  Encoder position_from = Encoder::kMotor;
  double gain_ratio = 1.0;    ///< of Kp, from gain_time on
  double gain_time = kNever;  ///< [s]
};

/// What the encoders measure, and what is recorded.
struct Reading {
  double cyclic_error = 0.0;  ///< of both encoders, at their scale, in the loop [m]
  double cyclic_period = 0.002, cyclic_phase = 0.0;

  Encoder recorded = Encoder::kMotor;
  /// Errors between motor and table: only a load encoder outside the loop measures them.
  double lead_error = 0.0, lead_period = 0.01, lead_phase = 0.0, lead_slope = 0.0;
  double growth = 0.0;       ///< final relative value; grows as 1 - exp(-t / growth_time)
  double growth_time = 1.0;  ///< [s]
  double fixed_end = 0.0;    ///< position of the fixed bearing [m]

  double sample_time = 1e-3;  ///< [s]
  double delay = 0.0;         ///< of the record against the command [s]
  double step = 0.0;          ///< [m]; 0: exact
  double noise = 0.0;         ///< RMS before the step [m]
  std::uint64_t noise_seed = 1;
  std::vector<bool> stuck;  ///< rows in which the record repeats the reading of the row before

  /// The drive's own reading of the motor's force, as a torque or a current.
  double torque_per_newton = 0.0;  ///< of either sign [unit/N]; 0: not recorded
  double torque_lag = 0.0;         ///< of a first-order filter [s]
  double torque_noise = 0.0;       ///< RMS [N]
  std::string torque_unit = "N";
};

struct Rig {
  Friction friction;
  Body body;
  Drive drive;
  Reading reading;
  /// d(t) on the table, one value per control period [N]; 0 after its end.
  std::vector<double> external_force;
};

/// The result of a simulation: one value per row, except for `acceleration`.
struct Trace {
  std::vector<double> command;
  std::vector<double> actual;        ///< as recorded
  std::vector<double> exact;         ///< the same without noise and step
  std::vector<double> motor, load;   ///< true positions at the same time
  std::vector<double> force;         ///< of the motor
  std::vector<double> torque;        ///< as recorded [torque_unit]; empty where it is not
  std::vector<double> acceleration;  ///< of the table, one per control period
  /// The axis has left its command by more than 0.05 m; the rows end there.
  bool runaway = false;
};

[[nodiscard]] Trace simulate(const Rig& rig, const Command& command);
/// The same for any command as a function of time.
[[nodiscard]] Trace simulate(const Rig& rig,
                             const std::function<virtual_machine::Setpoint(double)>& command,
                             double duration);

/// RMS of the difference of `exact`; infinite where one of them ran away.
[[nodiscard]] double rms_apart(const Trace& a, const Trace& b);

/// RMS of the error that noise and encoder step add to the record.
[[nodiscard]] double noise_rms(const Trace& trace);

}  // namespace servotwin::hidden_effects
