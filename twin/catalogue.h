// The catalogue of effects. To add an effect: its header in twin/effects/, a line here, and its C
// translation in cli/export/sources/ (docs/decisions/0009-c-sources-of-the-unit.md).
//
// The index of an effect in the catalogue is its kind. Any thread; nothing here allocates or
// throws.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <span>
#include <string_view>
#include <tuple>
#include <utility>
#include <variant>

#include "twin/effect.h"
#include "twin/effects/added_friction.h"
#include "twin/effects/asymmetric_friction.h"
#include "twin/effects/backlash.h"
#include "twin/effects/backlash_behind_encoder.h"
#include "twin/effects/backlash_in_loop.h"
#include "twin/effects/cogging.h"
#include "twin/effects/compliance.h"
#include "twin/effects/constant_force.h"
#include "twin/effects/control_filter.h"
#include "twin/effects/coulomb_friction.h"
#include "twin/effects/cross_coupling.h"
#include "twin/effects/cross_coupling_by_motion.h"
#include "twin/effects/cutting_force.h"
#include "twin/effects/dahl.h"
#include "twin/effects/dwell_stiction.h"
#include "twin/effects/encoder_error.h"
#include "twin/effects/falling_friction.h"
#include "twin/effects/feedforward_mismatch.h"
#include "twin/effects/friction_map.h"
#include "twin/effects/gain_change.h"
#include "twin/effects/gms.h"
#include "twin/effects/impulse_disturbance.h"
#include "twin/effects/inertia_change.h"
#include "twin/effects/lead_error.h"
#include "twin/effects/lugre.h"
#include "twin/effects/maxwell_slip.h"
#include "twin/effects/modified_stribeck.h"
#include "twin/effects/periodic_disturbance.h"
#include "twin/effects/position_dependent_friction.h"
#include "twin/effects/presliding.h"
#include "twin/effects/presliding_stribeck.h"
#include "twin/effects/smoothed_presliding.h"
#include "twin/effects/stribeck.h"
#include "twin/effects/swinging_load.h"
#include "twin/effects/thermal_growth.h"
#include "twin/effects/time_delay.h"
#include "twin/effects/torque_saturation.h"
#include "twin/effects/two_mass.h"
#include "twin/effects/unexplained_force.h"
#include "twin/effects/viscous_drift.h"

namespace servotwin {

using Catalogue =
    std::tuple<CoulombFriction,      //
               ConstantForce,        //
               FeedforwardMismatch,  //
               TimeDelay,            //
               Presliding,           //
               SmoothedPresliding,   //
               Gms,                  //
               MaxwellSlip,          //
               LuGre,                //
               Dahl,                 //
               Stribeck,             //
               ModifiedStribeck,     //
               FrictionMap,          //
               AsymmetricFriction,   //
               PreslidingStribeck,   //
               FallingFriction,      //
               Cogging,              //
               PositionDependentFriction, AddedFriction, Backlash, BacklashInLoop,
               BacklashBehindEncoder, Compliance, CrossCoupling, CuttingForce, DwellStiction,
               EncoderError, GainChange, ImpulseDisturbance, InertiaChange, LeadError,
               PeriodicDisturbance, ThermalGrowth, TorqueSaturation, ViscousDrift,
               UnexplainedOverPosition, UnexplainedOverVelocity, UnexplainedOverAcceleration,
               TwoMassMotorEncoder, TwoMassLoadEncoder, TwoMassOutside,   //
               PlayMotorEncoder, PlayLoadEncoder, PlayOutside,            //
               SwingingLoad, ControlFilter,                               //
               TorqueSaturationHolding, TorqueSaturationBackCalculation,  //
               CrossCouplingByMotion>;

inline constexpr std::size_t kEffectKinds = std::tuple_size_v<Catalogue>;
inline constexpr int kMaxEffects = 16;      ///< effects of one model
inline constexpr int kMaxShapes = 8;        ///< shape parameters of one effect
inline constexpr int kMaxCoefficients = 9;  ///< coefficients of one effect

namespace detail {
template <class T, class Tuple>
struct MemoryOf;
template <class T, class... E>
struct MemoryOf<T, std::tuple<E...>> {
  // Alternatives are selected by index, not by type: effects without memory share one empty struct.
  using type = std::variant<typename E::template Memory<T>...>;
};
}  // namespace detail

/// The memory of any one effect from cycle to cycle; trivially copyable.
template <class T>
using EffectMemory = typename detail::MemoryOf<T, Catalogue>::type;

/// Calls f.template operator()<Effect, Index>() for the effect of this kind (its index in the
/// catalogue).
template <class F>
constexpr decltype(auto) visit_effect(std::size_t kind, F&& f) {
  return [&]<std::size_t... I>(std::index_sequence<I...>)->decltype(auto) {
    using Result = decltype(f.template operator()<std::tuple_element_t<0, Catalogue>, 0>());
    if constexpr (std::is_void_v<Result>) {
      (void)((kind == I ? (f.template operator()<std::tuple_element_t<I, Catalogue>, I>(), true)
                        : false) ||
             ...);
    } else {
      Result result{};
      (void)((kind == I
                  ? (result = f.template operator()<std::tuple_element_t<I, Catalogue>, I>(), true)
                  : false) ||
             ...);
      return result;
    }
  }
  (std::make_index_sequence<kEffectKinds>{});
}

inline const Identity& identity_of(std::size_t kind) {
  return *visit_effect(kind,
                       []<class E, std::size_t>() -> const Identity* { return &E::kIdentity; });
}
inline std::span<const Parameter> shapes_of(std::size_t kind) {
  return visit_effect(
      kind, []<class E, std::size_t>() -> std::span<const Parameter> { return E::kShapes; });
}
inline std::span<const Parameter> coefficients_of(std::size_t kind) {
  return visit_effect(
      kind, []<class E, std::size_t>() -> std::span<const Parameter> { return E::kCoefficients; });
}
/// The index of E in the catalogue.
template <class E>
constexpr std::size_t kind_of() {
  return []<std::size_t... I>(std::index_sequence<I...>) {
    std::size_t kind = kEffectKinds;
    (void)((std::is_same_v<E, std::tuple_element_t<I, Catalogue>> ? (kind = I, true) : false) ||
           ...);
    return kind;
  }
  (std::make_index_sequence<kEffectKinds>{});
}
/// The index of the effect with this id, or kEffectKinds if there is none.
inline std::size_t kind_of(std::string_view id) {
  std::size_t kind = 0;
  while (kind < kEffectKinds && identity_of(kind).id != id) ++kind;
  return kind;
}

/// Friction laws: each is the whole friction of a machine, so a model has at most one.
inline constexpr std::array kFrictionLaws{kind_of<CoulombFriction>(),
                                          kind_of<Dahl>(),
                                          kind_of<Presliding>(),
                                          kind_of<SmoothedPresliding>(),
                                          kind_of<Gms>(),
                                          kind_of<MaxwellSlip>(),
                                          kind_of<PreslidingStribeck>(),
                                          kind_of<ModifiedStribeck>(),
                                          kind_of<LuGre>(),
                                          kind_of<Stribeck>()};
constexpr bool is_friction_law(std::size_t kind) {
  return std::find(kFrictionLaws.begin(), kFrictionLaws.end(), kind) != kFrictionLaws.end();
}

inline constexpr std::array kBesideTheLaw{kind_of<ConstantForce>(),
                                          kind_of<FrictionMap>(),
                                          kind_of<AsymmetricFriction>(),
                                          kind_of<FallingFriction>(),
                                          kind_of<PositionDependentFriction>(),
                                          kind_of<AddedFriction>(),
                                          kind_of<ViscousDrift>(),
                                          kind_of<DwellStiction>()};
/// Of one model at most.
inline constexpr std::size_t kMaxFrictions = 1 + kBesideTheLaw.size();

/// A law of friction, or a force that changes or joins it: together they are what the axis feels as
/// friction.
constexpr bool is_friction(std::size_t kind) {
  return is_friction_law(kind) ||
         std::find(kBesideTheLaw.begin(), kBesideTheLaw.end(), kind) != kBesideTheLaw.end();
}

/// Whether the effect is two poles beside those of the loop, fed by the command and by friction.
constexpr bool adds_poles(std::size_t kind) {
  return kind == kind_of<Compliance>() || kind == kind_of<ControlFilter>();
}

/// The limit of the motor, by what the integrator of the control does there.
inline constexpr std::array kMotorLimits{kind_of<TorqueSaturation>(),
                                         kind_of<TorqueSaturationHolding>(),
                                         kind_of<TorqueSaturationBackCalculation>()};
constexpr bool limits_motor(std::size_t kind) {
  return std::find(kMotorLimits.begin(), kMotorLimits.end(), kind) != kMotorLimits.end();
}

/// The force of another axis, by its command or by its motion. Of one model at most one.
inline constexpr std::array kCouplings{kind_of<CrossCoupling>(), kind_of<CrossCouplingByMotion>()};
constexpr bool couples(std::size_t kind) {
  return std::find(kCouplings.begin(), kCouplings.end(), kind) != kCouplings.end();
}

/// Whether the effect makes the axis one of two masses (twin/two_mass_axis.h).
inline bool acts_on_axis(std::size_t kind) { return identity_of(kind).acts == Acts::kAxis; }

// The three below are defined in twin/catalogue_steps.h and compiled once for each scalar: for
// double and for the derivatives of a twin in twin/catalogue.cpp, for those by the shapes along a
// motion that is given in identification/least_squares/unit_columns.cpp.

/// What the effect remembers before its first sample.
template <class T>
void start_memory(std::size_t kind, const T* shape, EffectMemory<T>& memory) noexcept;

/// Copies the memory of this effect only, not the size of the largest memory; `to` was started for
/// the same effect.
template <class T>
void copy_memory(std::size_t kind, const EffectMemory<T>& from, EffectMemory<T>& to) noexcept;

/// Forces per unit coefficient of one effect at one sample; `force` has room for its coefficients.
template <class T, class M>
void unit_forces(std::size_t kind, const T* shape, EffectMemory<T>& memory, const MotionOf<M>& m,
                 T* force) noexcept;

}  // namespace servotwin
