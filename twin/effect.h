// The interface of an effect. Each effect is one header in twin/effects/ and one line in
// twin/catalogue.h.
//
// An effect is written once, as the forces per unit coefficient along a motion (`unit_forces`). The
// simulation sums coefficient * unit force cycle by cycle; identification runs the same function
// along the measured motion and gets the columns of its least squares problem. There is no second
// formula that could disagree with the first (docs/decisions/0001-one-formula-per-effect.md).
//
// Shape parameters (theta) enter nonlinearly and are searched; coefficients enter linearly and are
// projected out. `unit_forces` is a template on the scalar of theta, T, so that Ceres can
// differentiate it along a motion that is given, and on that of the motion, M, so that the twin can
// be differentiated, whose motion depends on theta (twin/dual.h).
//
//   struct Example {
//     static constexpr Identity kIdentity{...};
//     static constexpr std::array<Parameter, S> kShapes{...};
//     static constexpr std::array<Parameter, C> kCoefficients{...};
//     template <class T> struct Memory {       // state from cycle to cycle; may also hold values
//       explicit Memory(const T* shape);       // computed from the shapes;
//       template <class F> void each(const F& f);  // f(value) for every value that a cycle changes
//     };                                       // NoMemory if there is none
//     template <class T, class M>
//     static void unit_forces(const T* shape, Memory<T>& memory, const MotionOf<M>& m, T* force)
//     noexcept;
//   };
//
// For all effects: the formula at the top of each effect's header gives d, the sum of coefficient *
// unit force, per moved mass [m/s^2 | rad/s^2] and positive if it acts against positive motion.
// Effects on the encoder reading give a displacement [m | rad] in its place. Units and ranges of
// the parameters are in kShapes and kCoefficients. `unit_forces` may be called from any thread,
// allocates nothing and throws nothing. Sources with title: docs/theory.md.
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>
#include <string_view>

#include "twin/dual.h"

namespace servotwin {

inline constexpr double kNoLaw = std::numeric_limits<double>::quiet_NaN();

/// The motion of one axis at one sample.
template <class S>
struct MotionOf {
  double step_s = 0.0;                         ///< sampling time [s]
  S position = 0.0;                            ///< x [m | rad]
  S velocity = 0.0;                            ///< [m/s | rad/s]
  S displacement = 0.0;                        ///< x minus x of the previous sample [m | rad]
  S acceleration = 0.0;                        ///< x'' [m/s^2 | rad/s^2]
  S command_velocity = 0.0;                    ///< [m/s | rad/s]
  S command_acceleration = 0.0;                ///< [m/s^2 | rad/s^2]
  S tracking_error = 0.0;                      ///< command - position, without delay [m | rad]
  double time_s = 0.0;                         ///< in the recording [s]
  double neighbour_acceleration = 0.0;         ///< commanded, of another axis; 0 if unknown
  double neighbour_motion_acceleration = 0.0;  ///< of its own motion; 0 if unknown
  double in_cut = 0.0;                         ///< 1 while the tool cuts; 0 if unknown
  /// Force demanded by the control per moved mass [m/s^2 | rad/s^2]; 0 if unknown.
  S demand = 0.0;
  /// Force of the model's friction law over its coefficient: between -1 and 1, or up to the
  /// breakaway ratio; kNoLaw if there is no law.
  S friction = kNoLaw;
  /// The part of the disturbance that is no force on the axis but the control's own
  /// (Identity::of_control).
  S of_control = 0.0;
  /// With an integrator: the rate of `demand` by position (a3 e - c2 x_r') and its part by velocity
  /// (a1 e'), which the integrator of the velocity loop integrates as well; else 0.
  S demand_rate = 0.0, demand_damping = 0.0;

  /// The direction of friction, which effects that change friction scale: that of the friction law,
  /// or without one the sign of the velocity, saturated at 1 mm/s.
  [[nodiscard]] S direction() const noexcept {
    return std::isnan(value_of(friction)) ? std::clamp<S>(1e3 * velocity, -1.0, 1.0) : friction;
  }
};
using Motion = MotionOf<double>;

/// Where an effect acts: as a disturbance force, as a delay of the command against the feedback, on
/// the reading alone, outside the loop ("force" is then a displacement of the reading), or on the
/// axis itself, whose parts then move apart (twin/two_mass_axis.h).
enum class Acts { kForce, kCommandDelay, kReading, kAxis };

/// Whether the effect has forces or displacements along a motion that is given.
[[nodiscard]] constexpr bool acts_along_motion(Acts acts) noexcept {
  return acts == Acts::kForce || acts == Acts::kReading;
}

/// The grid on which a shape parameter is searched before it is refined.
enum class Scan {
  kNone,       ///< a few decades around its start value
  kPeriod,     ///< periods of position, up to the travel
  kFrequency,  ///< frequencies, up to a fifth of the sampling rate
  kTime,       ///< the time of the recording
  kMoments,    ///< moments of the largest residual, for this and the next parameters together
  kDemand,     ///< shares of the largest demand
};

struct Identity {
  std::string_view id;       ///< stable identifier
  std::string_view meaning;  ///< one line, for output
  Acts acts = Acts::kForce;
  /// The cause of the contract that it is evidence for; empty: part of every machine, not a cause.
  std::string_view cause = {};
  /// The id of the effect that it replaces; empty: none.
  std::string_view replaces = {};
  /// The id of the effect of which it is another form: tried once that is found, and not screened
  /// by itself; empty: none.
  std::string_view form_of = {};
  std::string_view check = {};  ///< what to check on the machine
  /// On an axis of two masses: acts on the motor. All other forces act on the load, those of
  /// friction by the axis' share on each.
  bool on_motor = false;
  /// Stands for what the control does beside its linear loop, and not for a force on the axis: the
  /// motor gives less, or more, by it.
  bool of_control = false;
  /// Depends on the time of its recording, or on a signal that a twin stepped live does not get:
  /// it describes that recording and predicts no other motion.
  bool of_its_recording = false;
};

struct Parameter {
  std::string_view name;  ///< key in the model file
  std::string_view unit;  ///< unit for a linear axis; rotary axes read rad for m
  double lower = 0.0;     ///< physical bounds
  double upper = 0.0;
  double start = 0.0;  ///< start value of a search
  std::string_view meaning;
  bool with_free_loop =
      true;  ///< false: a free loop already contains it; fitted only if the loop is held
  bool resists = false;  ///< not negative if it is the whole friction, with none of it in a loop
  Scan scan = Scan::kNone;
  bool behind_integrator = false;  ///< identifiable only with an integrator, else a constant force
};

/// A unit of the catalogue as it reads on an axis: a rotary one has rad where a linear one has m.
[[nodiscard]] inline std::string unit_on_axis(std::string_view unit, bool rotary) {
  std::string out(unit);
  if (const std::size_t at = out.find('m'); rotary && at != std::string::npos)
    out.replace(at, 1, "rad");
  return out;
}

/// The bounds of lengths and velocities are those of machines in m, which move by up to
/// kMachineSpeed. A motor that turns by hundreds of rad/s has the same friction, play and ripple
/// over as much larger angles: `by` times these bounds and start values.
[[nodiscard]] constexpr Parameter stretched(Parameter p, double by) noexcept {
  if (p.unit != "m" && p.unit != "m/s") return p;
  p.upper *= by;
  p.start *= by;
  if (p.lower < 0.0) p.lower *= by;
  return p;
}
inline constexpr double kMachineSpeed = 2.0;  ///< [m/s]: machine tools; linear motors reach more
/// Of a spindle of 100,000 rpm.
inline constexpr double kLargestLengthScale = 5e3;

/// Bound of a force per moved mass [m/s^2 | rad/s^2]. On a linear axis friction above 10 m/s^2 is
/// rare, but a small motor that turns by itself has several hundred rad/s^2.
inline constexpr double kMaxForce = 1e4;

/// Whether this coefficient can be identified beside a free loop of this order.
[[nodiscard]] constexpr bool told_from_loop(const Parameter& p, int order) noexcept {
  return p.with_free_loop && (order == 3 || !p.behind_integrator);
}

/// Coefficient of friction laws with one symmetric force. The poles of a free loop contain it.
inline constexpr Parameter kViscous{
    "viscous", "1/s", 0.0,
    1000.0,    0.0,   "viscous friction per moved mass, in addition to that in the poles",
    false};

/// Memory of effects that depend on the present motion only.
struct NoMemory {
  NoMemory() = default;
  explicit NoMemory(const void* /*shape*/) noexcept {}
};

}  // namespace servotwin
