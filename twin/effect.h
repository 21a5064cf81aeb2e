// What an effect is. Each effect is one header in twin/effects/ and one line in twin/catalogue.h.
//
// An effect is written once, as the forces per unit coefficient along a motion (`unit_forces`). The
// simulation sums coefficient * unit force cycle by cycle; identification runs the same function
// along the measured motion and gets the columns of its least squares problem. There is no second
// formula that could disagree with the first (docs/decisions/0001-one-formula-per-effect.md).
//
// Shape parameters (theta) enter nonlinearly and are searched; coefficients enter linearly and are
// projected out. `unit_forces` is a template on the scalar of theta so that Ceres can differentiate
// it.
//
//   struct Example {
//     static constexpr Identity kIdentity{...};
//     static constexpr std::array<Parameter, S> kShapes{...};
//     static constexpr std::array<Parameter, C> kCoefficients{...};
//     template <class T> struct Memory {       // what the effect remembers from cycle to cycle;
//       explicit Memory(const T* shape);       // may hold what follows from the shapes alone
//     };                                       // NoMemory where there is nothing
//     template <class T>
//     static void unit_forces(const T* shape, Memory<T>& memory, const Motion& m, T* force)
//     noexcept;
//   };
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>
#include <string_view>

namespace servotwin {

inline constexpr double kNoLaw = std::numeric_limits<double>::quiet_NaN();

/// The motion of one axis at one sample.
struct Motion {
  double step_s = 0.0;                  ///< sampling time [s]
  double position = 0.0;                ///< x [m | rad]
  double velocity = 0.0;                ///< [m/s | rad/s]
  double displacement = 0.0;            ///< x minus x of the sample before [m | rad]
  double acceleration = 0.0;            ///< x'' [m/s^2 | rad/s^2]
  double command_velocity = 0.0;        ///< [m/s | rad/s]
  double command_acceleration = 0.0;    ///< [m/s^2 | rad/s^2]
  double tracking_error = 0.0;          ///< command - position, without a delay [m | rad]
  double time_s = 0.0;                  ///< in the recording [s]
  double neighbour_acceleration = 0.0;  ///< commanded, of another axis; 0 where none is known
  double in_cut = 0.0;                  ///< 1 while the tool cuts; 0 where that is not known
  /// What the control asks of the motor, over the moved mass [m/s^2 | rad/s^2]; 0 where not known.
  double demand = 0.0;
  /// Of the machine's own law of friction at this motion, over its coefficient: between -1 and 1,
  /// or up to the breakaway ratio; kNoLaw where none is known.
  double friction = kNoLaw;
  /// What an integrator of the control adds to it per second by the position, and what the control
  /// asks for by the velocity, which the integrator sees as well; 0 without one.
  double demand_rate = 0.0, demand_damping = 0.0;

  /// How far friction has turned with the motion: what changes friction changes this, and no law
  /// of its own. Without a law the sign of the velocity, saturated at 1 mm/s.
  [[nodiscard]] double direction() const noexcept {
    return std::isnan(friction) ? std::clamp(1e3 * velocity, -1.0, 1.0) : friction;
  }
};

/// Where an effect enters: as a disturbance force, by delaying the command against the feedback, or
/// in the reading alone, which the loop does not see (then "force" is a displacement of the
/// reading).
enum class Acts { kForce, kCommandDelay, kReading };

/// What a shape parameter is sought over, on a grid, before it is refined.
enum class Scan {
  kNone,       ///< nothing: a few decades about its start
  kPeriod,     ///< periods of position, up to the travel
  kFrequency,  ///< frequencies, up to a fifth of the sampling rate
  kTime,       ///< the time of the recording
  kMoments,    ///< the moments at which most is left, this and the next parameters together
  kDemand,     ///< shares of the largest demand
};

struct Identity {
  std::string_view id;       ///< stable
  std::string_view meaning;  ///< one line, for people
  Acts acts = Acts::kForce;
  std::string_view source;    ///< equation or paper
  std::string_view confused;  ///< what it looks like, and what tells them apart
  /// The cause of the contract that it is evidence of; empty: a part of every machine, no cause.
  std::string_view cause = {};
  /// The id of the effect whose place it takes; empty: none.
  std::string_view replaces = {};
  std::string_view check = {};  ///< what to look at on the machine
};

struct Parameter {
  std::string_view name;  ///< key in the model file
  std::string_view unit;  ///< unit for a linear axis; rotary axes read rad for m
  double lower = 0.0;     ///< physical bounds
  double upper = 0.0;
  double start = 0.0;  ///< where a search begins
  std::string_view meaning;
  bool with_free_loop =
      true;  ///< false: the free loop already contains it; fitted only against a held loop
  bool resists = false;  ///< of the whole friction, no part of it in a loop, this is not negative
  Scan scan = Scan::kNone;
  bool behind_integrator = false;  ///< without an integrator a constant force contains it
};

/// Whether a fit with a free loop of this order can tell this coefficient from the loop.
[[nodiscard]] constexpr bool told_from_loop(const Parameter& p, int order) noexcept {
  return p.with_free_loop && (order == 3 || !p.behind_integrator);
}

/// Of friction models of one symmetric force. The poles of a free loop contain it.
inline constexpr Parameter kViscous{
    "viscous", "1/s", 0.0,
    1000.0,    0.0,   "viscous friction per moved mass, beyond what the poles hold",
    false};

/// Of effects that depend on the present motion alone.
struct NoMemory {
  NoMemory() = default;
  explicit NoMemory(const void* /*shape*/) noexcept {}
};

}  // namespace servotwin
