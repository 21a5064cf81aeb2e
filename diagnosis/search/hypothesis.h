// A model with the effects that are supposed to act on an axis. Units: SI, rad instead of m on
// rotary axes. Any thread.
#pragma once

#include <cstddef>
#include <string_view>
#include <vector>

#include "identification/loop/pole_search.h"
#include "twin/model.h"

namespace servotwin {

/// A model structure with its best fit, and with its error on blocks that its coefficients were not
/// fitted to.
struct Hypothesis {
  Structure structure;
  Point point;
  Model model;
  double cost = 1e300;  ///< on the training data
  /// Mean square of the error of the cross-validation in every interval of 0.25 s [m^2 | rad^2].
  std::vector<double> pieces;

  [[nodiscard]] double rms() const;  ///< of all intervals [m | rad]
  [[nodiscard]] bool has(std::size_t kind) const;
};

/// The starting point for a structure: the loop and the shape parameters of this model, with those
/// of the catalogue where the model has none.
[[nodiscard]] Point point_of(const Model& model, const Structure& structure);

/// A model of the structure to begin a fit in free simulation with. `model`, of the same order,
/// gives the loop, the effects that both have, and to another law of friction its level and travel.
/// Further effects do nothing yet.
[[nodiscard]] Model begun_from(const Model& model, const Structure& structure);

/// Whether the structure is that of an axis of two masses.
[[nodiscard]] bool has_two_masses(const Structure& structure);
/// Whether it has a filter of the control.
[[nodiscard]] bool has_filter(const Structure& structure);

/// Whether the effect is intermittent (impulses, saturation). Isolated events cannot be refitted on
/// the other blocks; their parameters are kept, and few intervals contain all that they explain.
[[nodiscard]] bool is_intermittent(std::size_t kind);

/// A shape parameter by its name; NaN where the model or the effect has none.
[[nodiscard]] double shape_of(const Model& model, std::size_t kind, std::string_view name);

/// Relative difference of two periods that are one; a fit is far more accurate.
inline constexpr double kSamePeriod = 0.02;

}  // namespace servotwin
