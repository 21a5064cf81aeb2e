// The coordinates in which a model of a structure is fitted in free simulation: error coefficients,
// coefficients of the effects, chart of the poles, shapes of the effects, modes. Coefficients that
// cannot be told from the loop, and the share of a limit, are held.
//
// What a recording tells best is the error at a constant speed, by a constant acceleration and, of
// a loop without integrator, by a constant force. In these coordinates it stays while the gains
// change: the numerator is given by the error coefficients k0, k1, .. of e = k0 x_r' + k1 x_r'' +
// .., a force in m/s^2 relative to the last gain. Else all of them would have to change with the
// gains, along a curve that no step of a fit follows far
// (docs/decisions/0030-steps-within-bounds-errors-that-stay.md).
//
// Coordinates without unit, parameters in SI units. Any thread.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <utility>
#include <vector>

#include "identification/least_squares/chart.h"
#include "identification/loop/projection.h"
#include "twin/model.h"

namespace servotwin {

/// What a fit leaves as it is.
struct Held {
  std::vector<std::size_t> effects = {};  ///< places of whole effects
  /// The loop with its modes, and of an effect on the axis all but the share of the friction: the
  /// friction alone is fitted, and what else is known of the forces.
  bool drive = false;
};

/// Between a model of the structure and its coordinates. The structure outlives it.
class Coordinates {
 public:
  Coordinates(const Structure& structure, const Model& start, double length_scale, Held held = {});

  [[nodiscard]] Eigen::VectorXd of(const Model& model) const;
  /// What is held is that of the start, to the last digit.
  [[nodiscard]] Model model(const double* x) const;
  /// Bounds of the coordinates: the physical ones.
  [[nodiscard]] std::pair<double, double> bounds(Eigen::Index i) const;
  /// The coordinates that are not held.
  [[nodiscard]] std::vector<std::size_t> free() const;
  /// d model / d coordinate at x, of every coordinate: models whose parameters are the derivatives.
  [[nodiscard]] std::vector<Model> directions(const double* x) const;
  /// d parameters / d coordinates at x, with the parameters in the order of the covariance (every
  /// numerator, coefficients, alpha and beta of every mode, a1..an, shapes, omega, zeta, gamma,
  /// delta of every mode, slope, curve and zeta_slope of every one that moves).
  [[nodiscard]] Eigen::MatrixXd parameters_by_coordinates(const Eigen::VectorXd& x) const;

 private:
  struct Slot {
    std::size_t effect = 0, coefficient = 0;
  };
  [[nodiscard]] bool holds(std::size_t effect) const;
  [[nodiscard]] bool holds(std::size_t effect, std::size_t shape) const;
  [[nodiscard]] Parameter parameter_of(const Slot& slot) const;
  /// Whether its coordinate is relative to the last gain.
  [[nodiscard]] bool is_relative(const Slot& slot) const;
  /// What its coordinate is multiplied by.
  [[nodiscard]] double unit_of(const Slot& slot, const Model& model) const;
  /// The error coefficient that stands for this place of the numerator.
  [[nodiscard]] std::size_t place_of(int numerator) const {
    return static_cast<std::size_t>(structure_.order - 1 - numerator);
  }
  [[nodiscard]] std::array<double, kMaxOrder> coefficients_at(const double* x) const;

  const Structure& structure_;
  Model template_;
  double length_scale_;
  Held held_;
  std::vector<ShapeAxis> axes_;
  std::vector<Slot> slots_;
  int numerators_ = 0;
};

}  // namespace servotwin
