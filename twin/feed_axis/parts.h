// The parts of a feed axis with ball screw, as in data sheets and drawings (Ferkl et al. 2021;
// docs/theory.md 16). SI units: m, rad, kg, s, N, Nm. Ranges are checked when a file is read
// (cli/recording/feed_axis_file.h), not by the code that uses the parts. Plain data; any thread.
#pragma once

#include <optional>
#include <vector>

namespace servotwin {

/// Material damping of an element: B = mass m + stiffness k.
struct MaterialDamping {
  double mass = 0.0;       ///< [1/s]
  double stiffness = 0.0;  ///< [s]
};

struct ScrewParts {
  double diameter = 0.0;                                   ///< of the thread [m]
  double lead = 0.0;                                       ///< [m] per revolution
  double length = 0.0;                                     ///< of the thread [m]
  double end_diameter = 0.0;                               ///< of the shaft end at the coupling [m]
  double end_length = 0.0;                                 ///< of the shaft end [m]
  double density = 7850.0;                                 ///< [kg/m^3]
  double youngs_modulus = 2.1e11, shear_modulus = 8.1e10;  ///< [N/m^2]
  MaterialDamping axial, torsional;
  int elements = 16;  ///< finite elements of the thread
};

struct SpringDamper {
  double stiffness = 0.0;  ///< [N/m | Nm/rad]
  double damping = 0.0;    ///< [N s/m | Nm s/rad]
};

struct CouplingParts {
  SpringDamper spring;   ///< [Nm/rad], [Nm s/rad]
  double inertia = 0.0;  ///< [kg m^2], half of it on either side
};

struct NutParts {
  SpringDamper spring;          ///< axial
  double from = 0.0, to = 0.0;  ///< its travel, from the bearing [m]
  double at_zero = 0.0;         ///< its position when the axis is at 0 [m]
};

/// A mass on the table, connected by a spring.
struct AddedMass {
  double mass = 0.0;  ///< [kg]
  SpringDamper spring;
};

/// A PI current loop with feed-forward of the motor's back-EMF.
struct CurrentLoopParts {
  double resistance = 0.0;  ///< [Ohm]
  double inductance = 0.0;  ///< [H]
  double gain = 0.0;        ///< [V/A]
  double reset_time = 0.0;  ///< [s]
};

/// (s^2 + 2 pi numerator s + w^2) / (s^2 + 2 pi bandwidth s + w^2), w = 2 pi frequency.
struct BandStop {
  double frequency_hz = 0.0;
  double bandwidth_hz = 0.0;            ///< -3 dB, for numerator_bandwidth_hz 0
  double numerator_bandwidth_hz = 0.0;  ///< 0: nothing passes at `frequency_hz`
};

struct ControlParts {
  double rate_hz = 16000.0;         ///< cycle rate of all loops
  double position_gain = 0.0;       ///< [1/s]
  double velocity_gain = 0.0;       ///< [Nm s/rad]
  double reset_time = 0.0;          ///< of the velocity loop [s]
  double current_loop_hz = 1000.0;  ///< first-order lag, if `current_loop` is absent
  std::optional<CurrentLoopParts> current_loop;
  std::optional<double> low_pass_hz;  ///< first order, on the torque command
  std::vector<BandStop> band_stops;   ///< on the torque command
};

/// LuGre friction as in Ferkl et al. 2021, eq. 1 to 3.
struct LuGreParts {
  double breakaway = 0.0;          ///< F_s [N], > 0
  double coulomb = 0.0;            ///< F_c [N], > 0
  double stribeck_velocity = 0.0;  ///< v_s [m/s]
  double stiffness = 0.0;          ///< sigma0 [N/m]
  double damping = 0.0;            ///< sigma1 [N s/m]
  double viscous = 0.0;            ///< sigma2 [N s/m]
  double stribeck_exponent = 1.0;
};

struct FeedAxisParts {
  ScrewParts screw;
  SpringDamper bearing;  ///< axial, at the end of the motor
  CouplingParts coupling;
  NutParts nut;
  double motor_inertia = 0.0;  ///< [kg m^2]
  double table_mass = 0.0;     ///< including everything rigidly attached [kg]
  std::optional<AddedMass> added_mass;
  ControlParts control;
  std::optional<LuGreParts> friction, cover;  ///< both act on the table
};

}  // namespace servotwin
