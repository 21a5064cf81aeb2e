// Possible changes of an axis whose model is known: mass, gains, feed-forward, friction, delay.
//
// Each change is expressed by its effect on the loop and the forces of the model (docs/theory.md
// 10.2), derived from the physics of the loop, order 3 (order 2 without the integral part):
//
//   s^2 x = k (1 + 1/(Ti s)) (Kp e + f x_r' - x') + g x_r'' - d
//   a1 = k,  a2 = k (1/Ti + Kp),  a3 = k Kp/Ti,  c0 = 1 - g,  c1 = k (1 - f),  c2 = c1/Ti
//
// Adding an effect of the catalogue that the model does not have is a change as well.
//
// Units: SI, rad for m on rotary axes. Any thread.
#pragma once

#include <functional>
#include <span>
#include <string>
#include <vector>

#include "twin/model.h"

namespace servotwin {

/// A physical quantity of a model that a change modifies.
struct ChangedQuantity {
  std::string name, unit;
  double start = 0.0;     ///< starting value of the search
  double step = 0.0;      ///< over which the parameters of the model change linearly
  bool relative = false;  ///< 1 + the value is the ratio to the former quantity
};

/// One possible change, named by a cause.
struct Change {
  std::string cause;  ///< identifier of the contract
  std::vector<ChangedQuantity> quantities;
  /// Applies the change to the model with these values, one per quantity.
  std::function<void(Model&, std::span<const double>)> apply;
  std::size_t kind = kEffectKinds;  ///< of the effect that it adds; kEffectKinds: it adds none
};

/// All possible changes of quantities that this model already has.
[[nodiscard]] std::vector<Change> changes_of(const Model& model);

/// The addition of an effect, starting from these shape parameters. It replaces the effect of the
/// model that the catalogue says it replaces, if any.
[[nodiscard]] Change addition_to(const Model& model, std::size_t kind,
                                 const std::vector<double>& shapes);

/// The gains of the position and the velocity controller that the loop corresponds to: Kp [1/s] and
/// 1/Ti [1/s] (0: no integral part).
struct Gains {
  double position = 0.0, integral = 0.0;
};
[[nodiscard]] Gains gains_of(const Loop& loop);

}  // namespace servotwin
