// The coordinates in which a model of a structure is fitted in free simulation: numerator,
// coefficients, chart of the poles, shapes of the effects, modes. Coefficients that cannot be told
// from the loop, and the share of a limit, are held.
//
// Coordinates without unit, parameters in SI units. Any thread.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <utility>
#include <vector>

#include "identification/least_squares/chart.h"
#include "identification/loop/projection.h"
#include "twin/model.h"

namespace servotwin {

/// Between a model of the structure and its coordinates. The structure outlives it.
class Coordinates {
 public:
  Coordinates(const Structure& structure, const Model& start, double length_scale);

  [[nodiscard]] Eigen::VectorXd of(const Model& model) const;
  [[nodiscard]] Model model(const double* x) const;
  /// Bounds of the coordinates: the physical ones.
  [[nodiscard]] std::pair<double, double> bounds(Eigen::Index i) const;
  /// The coordinates that are not those of these effects.
  [[nodiscard]] std::vector<std::size_t> without(const std::vector<std::size_t>& held) const;
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
  const Structure& structure_;
  Model template_;
  double length_scale_;
  std::vector<ShapeAxis> axes_;
  std::vector<Slot> slots_;
  int numerators_ = 0;
};

}  // namespace servotwin
