// Friction of the virtual machine: force F against a motion of velocity v. SI: N, m, s.
//
//   Level              s(v) = Fc + (Fs - Fc) exp(-(|v| / vs)^delta)      (Stribeck)
//
//   SaturatedCoulomb   F = Fc sat(v / v_limit)
//   StickCoulomb       F = s(v) sgn v in motion; at rest F balances the applied force up to Fs
//   DirectedStribeck   F = s+(v) + B+ v for v > 0, -s-(v) + B- v for v < 0; at rest F balances the
//                      applied force from -Fs- to Fs+
//   LuGre              z' = v - |v| z sigma0 / s(v),   F = sigma0 z + sigma1 z' + sigma2 v
//   CoveredLuGre       F = F_drive + F_cover, both LuGre; for v < 0 (closing) s and sigma2 of the
//                      cover are `closing_ratio` times as large, and so is its steady force. The
//                      stiffness is not: a bristle that gave back more than it took in would
//                      drive the axis.
//   Gms                F = sum F_i;  stick: F_i' = k_i v,  until |F_i| = alpha_i s(v);
//                      slip: F_i' = sgn(v) C (alpha_i - |F_i| / s(v)),  until v changes its sign
//
// Between events (an element starts to slip or sticks again, a body stops, turns round or breaks
// away, a force saturates) each model is a smooth differential equation: `force` gives its right
// side, `mode_holds` is false after an event, `switch_mode` carries the event out. The integrator
// in body.h finds the time of the event.
//
// Errors: `check` throws std::invalid_argument with field, value and rule; the others do not throw.
// Any thread. Sources: Canudas de Wit et al. 1995 (LuGre); Lampaert, Al-Bender, Swevers 2003 (GMS);
// Giberti et al. 2019, section 3.1 (directed Stribeck); Ferkl et al. 2021 (drive and cover).
#pragma once

#include <array>
#include <variant>
#include <vector>

namespace servotwin::virtual_machine {

inline constexpr int kMaxElements = 16;

struct Level {
  double coulomb = 0.0;            ///< Fc [N], >= 0
  double breakaway = 0.0;          ///< Fs [N], >= 0; below Fc it rises with velocity
  double stribeck_velocity = 1.0;  ///< vs [m/s], > 0
  double exponent = 1.0;           ///< delta, > 0

  [[nodiscard]] double at(double velocity) const noexcept;
};

struct NoFriction {};

struct SaturatedCoulomb {
  double coulomb = 0.0;         ///< [N]
  double velocity_limit = 1.0;  ///< [m/s], > 0
};

struct StickCoulomb {
  Level level;
};

struct DirectedStribeck {
  Level plus;                  ///< of v > 0
  Level minus;                 ///< of v < 0, its forces positive too
  double viscous_plus = 0.0;   ///< B+ [N s/m], >= 0
  double viscous_minus = 0.0;  ///< B- [N s/m], >= 0
};

struct LuGre {
  Level level;          ///< > 0
  double sigma0 = 0.0;  ///< bristle stiffness [N/m], > 0
  double sigma1 = 0.0;  ///< bristle damping [N s/m]
  double sigma2 = 0.0;  ///< viscous [N s/m]
};

struct CoveredLuGre {
  LuGre drive;
  LuGre cover;
  double closing_ratio = 1.0;  ///< cover's steady force at -v over that at v, > 0
};

struct Gms {
  Level level;                    ///< > 0
  std::vector<double> stiffness;  ///< k_i [N/m], > 0; at most kMaxElements
  std::vector<double> share;      ///< alpha_i, > 0, sum 1
  double attraction = 1e4;        ///< C [N/s], > 0
};

using Friction = std::variant<NoFriction, SaturatedCoulomb, StickCoulomb, DirectedStribeck, LuGre,
                              CoveredLuGre, Gms>;

/// Inner state; at first relaxed, after a long standstill.
struct FrictionState {
  std::array<double, kMaxElements> z{};  ///< LuGre: deflections [m]; Gms: element forces [N]
  std::array<int, kMaxElements> mode{};  ///< Gms, sticking friction: 0 sticks, else the direction
};

void check(const Friction& friction);

/// Whether a body under this friction can be at rest under a force, so that its mode says whether
/// it moves.
[[nodiscard]] bool sticks(const Friction& friction) noexcept;

/// Number of values of the inner state that are in use.
[[nodiscard]] int state_size(const Friction& friction) noexcept;

/// The force, and the rate of change of the inner state. `applied`: all other forces on the body.
// NOLINTNEXTLINE(bugprone-exception-escape): see its definition
double force(const Friction& friction, double velocity, double applied, const FrictionState& state,
             std::array<double, kMaxElements>& rate) noexcept;

/// False as soon as an event has passed, so that the rates of `state.mode` are no longer those of
/// the model.
[[nodiscard]] bool mode_holds(const Friction& friction, double velocity, double applied,
                              const FrictionState& state) noexcept;

/// Changes the mode to the one that holds from here on; a body that stops gets velocity 0.
void switch_mode(const Friction& friction, double applied, double& velocity,
                 FrictionState& state) noexcept;

/// A GMS model of constant level whose virgin curve follows f = 1 - (1 - x)^steepness by chords,
/// x = displacement / breakaway distance; steepness > 1.
[[nodiscard]] Gms gms_with_curve(double level, double breakaway_distance, double steepness,
                                 int elements);

}  // namespace servotwin::virtual_machine
