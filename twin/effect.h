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

#include <string_view>

namespace servotwin {

/// The motion of one axis at one sample.
struct Motion {
  double step_s = 0.0;                ///< sampling time [s]
  double position = 0.0;              ///< x [m | rad]
  double velocity = 0.0;              ///< [m/s | rad/s]
  double displacement = 0.0;          ///< x minus x of the sample before [m | rad]
  double command_velocity = 0.0;      ///< [m/s | rad/s]
  double command_acceleration = 0.0;  ///< [m/s^2 | rad/s^2]
};

/// Where an effect enters: as a disturbance force, or by delaying the command against the feedback.
enum class Acts { kForce, kCommandDelay };

struct Identity {
  std::string_view id;       ///< stable
  std::string_view meaning;  ///< one line, for people
  Acts acts = Acts::kForce;
  std::string_view source;    ///< equation or paper
  std::string_view confused;  ///< what it looks like, and what tells them apart
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
  bool scanned = false;  ///< a period or a frequency: sought over its whole range on a fine grid
};

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
