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
struct Effect {
  std::size_t kind = 0;  ///< index in the catalogue
  std::array<double, kMaxShapes> shape{};
  std::array<double, kMaxCoefficients> coefficient{};
};

/// Number of elements of a friction law whose levels are its first coefficients; 0: one level.
constexpr std::size_t free_elements_of(std::size_t kind) noexcept {
  if (kind == kind_of<Gms>()) return Gms::kElements;
  return kind == kind_of<MaxwellSlip>() ? MaxwellSlip::kElements : 0;
}

/// The friction force of this law in sliding, per moved mass [m/s^2 | rad/s^2]; if it depends on
/// the direction, that of the positive direction.
inline double level_of(const Effect& law) noexcept {
  const std::size_t elements = free_elements_of(law.kind);
  double sum = elements == 0 ? law.coefficient[0] : 0.0;
  for (std::size_t i = 0; i < elements; ++i) sum += law.coefficient[i];
  return sum;
}

/// Motion::friction from the forces per unit coefficient of a friction law.
inline double friction_of(const Effect& law, const double* force) noexcept {
  // One coefficient per direction, of which only one has a force at a time; or one per element.
  if (law.kind == kind_of<Stribeck>() || law.kind == kind_of<ModifiedStribeck>())
    return force[0] + force[1];
  const std::size_t elements = free_elements_of(law.kind);
  if (elements == 0) return force[0];
  const double level = level_of(law);
  double sum = 0.0;
  for (std::size_t i = 0; i < elements; ++i) sum += law.coefficient[i] * force[i];
  return level > 0.0 ? sum / level : kNoLaw;
}

/// An effect of the catalogue with its shape parameters at their start values and no force.
template <class E>
[[nodiscard]] Effect make_effect() {
  Effect effect;
  effect.kind = kind_of<E>();
  for (std::size_t i = 0; i < E::kShapes.size(); ++i) effect.shape[i] = E::kShapes[i].start;
  return effect;
}

struct Model {
  double sample_time_s = 0.0;
  Loop loop;
  std::vector<Effect> effects;  ///< at most kMaxEffects

  /// The sum of all command delays [s].
  [[nodiscard]] double command_delay_s() const;
  [[nodiscard]] const Effect* find(std::size_t kind) const;
};

/// The longest command delay of a twin [cycles]: the 50 ms of the catalogue at 10 kHz.
inline constexpr int kMaxDelayCycles = 500;

/// Why a model is invalid, naming field, value and rule; empty if it is valid: finite, stable,
/// within the physical bounds of the catalogue, delay within kMaxDelayCycles.
[[nodiscard]] std::string why_invalid(const Model& model);

}  // namespace servotwin
