// A model of one axis: the loop and the effects that act on it. Plain data.
//
// SI units; for rotary axes read rad for m. Any thread. Errors: why_invalid names them.
#pragma once

#include <array>
#include <string>
#include <vector>

#include "twin/catalogue.h"
#include "twin/loop.h"

namespace servotwin {

/// One effect with its parameters, in the order of the catalogue.
template <class S>
struct EffectOf {
  std::size_t kind = 0;  ///< index in the catalogue
  std::array<S, kMaxShapes> shape{};
  std::array<S, kMaxCoefficients> coefficient{};
};
using Effect = EffectOf<double>;

/// Number of elements of a friction law whose levels are its first coefficients; 0: one level.
constexpr std::size_t free_elements_of(std::size_t kind) noexcept {
  if (kind == kind_of<Gms>()) return Gms::kElements;
  return kind == kind_of<MaxwellSlip>() ? MaxwellSlip::kElements : 0;
}

/// The friction force of this law in sliding, per moved mass [m/s^2 | rad/s^2]; if it depends on
/// the direction, that of the positive direction.
template <class S>
[[nodiscard]] S level_of(const EffectOf<S>& law) noexcept {
  const std::size_t elements = free_elements_of(law.kind);
  S sum = elements == 0 ? law.coefficient[0] : S(0.0);
  for (std::size_t i = 0; i < elements; ++i) sum += law.coefficient[i];
  return sum;
}

/// Motion::friction from the forces per unit coefficient of a friction law.
template <class S>
[[nodiscard]] S friction_of(const EffectOf<S>& law, const S* force) noexcept {
  // One coefficient per direction, of which only one has a force at a time; or one per element.
  if (law.kind == kind_of<Stribeck>() || law.kind == kind_of<ModifiedStribeck>())
    return force[0] + force[1];
  const std::size_t elements = free_elements_of(law.kind);
  if (elements == 0) return force[0];
  const S level = level_of(law);
  S sum = 0.0;
  for (std::size_t i = 0; i < elements; ++i) sum += law.coefficient[i] * force[i];
  return level > 0.0 ? sum / level : S(kNoLaw);
}

/// An effect of the catalogue with its shape parameters at their start values and no force.
template <class E>
[[nodiscard]] Effect make_effect() {
  Effect effect;
  effect.kind = kind_of<E>();
  for (std::size_t i = 0; i < E::kShapes.size(); ++i) effect.shape[i] = E::kShapes[i].start;
  return effect;
}

template <class S>
struct ModelOf {
  double sample_time_s = 0.0;
  LoopOf<S> loop;
  std::vector<EffectOf<S>> effects;  ///< at most kMaxEffects

  /// The sum of all command delays [s].
  [[nodiscard]] S command_delay_s() const {
    S delay = 0.0;
    for (const EffectOf<S>& effect : effects) {
      if (identity_of(effect.kind).acts == Acts::kCommandDelay) delay += effect.shape[0];
    }
    return delay;
  }
  [[nodiscard]] const EffectOf<S>* find(std::size_t kind) const {
    for (const EffectOf<S>& effect : effects) {
      if (effect.kind == kind) return &effect;
    }
    return nullptr;
  }
};
using Model = ModelOf<double>;

/// The effect that limits the motor; nothing in a model without one.
[[nodiscard]] inline const Effect* motor_limit_of(const Model& model) {
  for (const Effect& effect : model.effects) {
    if (limits_motor(effect.kind)) return &effect;
  }
  return nullptr;
}

/// The force of another axis; nothing in a model without one.
template <class S>
[[nodiscard]] const EffectOf<S>* coupling_of(const ModelOf<S>& model) {
  for (const EffectOf<S>& effect : model.effects) {
    if (couples(effect.kind)) return &effect;
  }
  return nullptr;
}
/// Whether that force follows from the motion of the other axis, not from its command.
template <class S>
[[nodiscard]] bool coupled_by_motion(const ModelOf<S>& model) {
  return model.find(kind_of<CrossCouplingByMotion>()) != nullptr;
}

/// f(a, b) for every parameter of two loops, or two models, of one structure.
template <class A, class B, class F>
void each_parameter(LoopOf<A>& a, const LoopOf<B>& b, const F& f) {
  for (std::size_t i = 0; i < kMaxOrder; ++i) {
    f(a.denominator[i], b.denominator[i]);
    f(a.numerator[i], b.numerator[i]);
  }
  for (std::size_t i = 0; i < a.modes.size(); ++i) {
    ModeOf<A>& l = a.modes[i];
    const ModeOf<B>& r = b.modes[i];
    f(l.omega, r.omega);
    f(l.zeta, r.zeta);
    f(l.alpha, r.alpha);
    f(l.beta, r.beta);
    f(l.gamma, r.gamma);
    f(l.delta, r.delta);
    f(l.slope, r.slope);
    f(l.curve, r.curve);
    f(l.zeta_slope, r.zeta_slope);
  }
}
template <class A, class B, class F>
void each_parameter(ModelOf<A>& a, const ModelOf<B>& b, const F& f) {
  each_parameter(a.loop, b.loop, f);
  for (std::size_t i = 0; i < a.effects.size(); ++i) {
    for (std::size_t p = 0; p < a.effects[i].shape.size(); ++p)
      f(a.effects[i].shape[p], b.effects[i].shape[p]);
    for (std::size_t c = 0; c < a.effects[i].coefficient.size(); ++c)
      f(a.effects[i].coefficient[c], b.effects[i].coefficient[c]);
  }
}
/// A model of the structure of another, with all its parameters 0.
template <class A, class B>
[[nodiscard]] ModelOf<A> empty_like(const ModelOf<B>& other) {
  ModelOf<A> out;
  out.sample_time_s = other.sample_time_s;
  out.loop.order = other.loop.order;
  out.loop.travel = other.loop.travel;
  out.loop.modes.resize(other.loop.modes.size());
  out.effects.resize(other.effects.size());
  for (std::size_t i = 0; i < out.effects.size(); ++i) out.effects[i].kind = other.effects[i].kind;
  return out;
}

/// The longest command delay of a twin [cycles]: the 50 ms of the catalogue at 10 kHz.
inline constexpr int kMaxDelayCycles = 500;

/// Why a model is invalid, naming field, value and rule; empty if it is valid: finite, stable,
/// within the physical bounds of the catalogue, delay within kMaxDelayCycles.
[[nodiscard]] std::string why_invalid(const Model& model);
/// With bounds of lengths and velocities that are stretched by this factor (twin/effect.h): 1 on a
/// linear axis. Without it kLargestLengthScale: the model does not tell whether it is rotary.
[[nodiscard]] std::string why_invalid(const Model& model, double length_scale);

}  // namespace servotwin
