// What can change on an axis whose model is known: mass, gains, feed-forward, friction, delay.
//
// Each is written as what it does to the loop and the forces of the model (docs/theory.md 10.2), in
// the loop's own physics, order 3 (order 2 without the integral part):
//
//   s^2 x = k (1 + 1/(Ti s)) (Kp e + f x_r' - x') + g x_r'' - d
//   a1 = k,  a2 = k (1/Ti + Kp),  a3 = k Kp/Ti,  c0 = 1 - g,  c1 = k (1 - f),  c2 = c1/Ti
//
// An effect of the catalogue that the model does not have is a change as well.
//
// Units: SI, rad for m on rotary axes. Any thread.
#pragma once

#include <functional>
#include <span>
#include <string>
#include <vector>

#include "twin/model.h"

namespace servotwin {

/// A physical quantity of a model that a change moves.
struct Quantity {
  std::string name, unit;
  double start = 0.0;     ///< of the search
  double step = 0.0;      ///< that a simulation shows and whose curvature it does not
  bool relative = false;  ///< 1 + the parameter is a ratio to what it was
};

struct Change {
  std::string cause;  ///< of the contract
  std::vector<Quantity> quantities;
  /// Changes the model by these values, one per quantity.
  std::function<void(Model&, std::span<const double>)> apply;
  std::size_t kind = kEffectKinds;  ///< of the effect of the catalogue that it is, if it is one
};

/// All changes of what this model has already.
[[nodiscard]] std::vector<Change> changes_of(const Model& model);

/// The addition of an effect, from these shapes; it takes the place of the one that it replaces.
[[nodiscard]] Change addition_to(const Model& model, std::size_t kind,
                                 const std::vector<double>& shapes);

/// Kp [1/s] and 1/Ti [1/s] (0: none) of the position and velocity loops that this loop means.
struct Gains {
  double position = 0.0, integral = 0.0;
};
[[nodiscard]] Gains gains_of(const Loop& loop);

}  // namespace servotwin
