// Pole search with least squares projection (thesis 3.5, docs/theory.md Sources; docs/theory.md 4).
//
//   min over poles and shapes of  1/2 | e - R(poles, shapes) c |^2,  c by projection,
//   friction >= 0
//
// c are the linear coefficients (numerator and effects); the shapes are those of the effects.
//
// 1. Coarse: a logarithmic grid over the box of the poles (pairs with zeta <= 1, and sorted real
//    triples), on data thinned to a step of at most 8 ms, but to no fewer than 1000 samples.
// 2. Refine the best candidates by Levenberg-Marquardt (Ceres), on the thinned data and then on
//    all, in coordinates whose whole range is exactly the set of stable loops: a1 = e^q1,
//    a2 = e^q2, and for order 3 also a3 = a1 a2 / (1 + e^-q3). A search in the poles themselves
//    stops where two real poles meet.
// 3. If the optimum lies outside the box, refine again within it.
//
// Frequencies in Hz, coefficients a_i in 1/s^i. Any thread; the same data give the same result.
#pragma once

#include <optional>
#include <vector>

#include "identification/loop/projection.h"

namespace servotwin {

/// The box of the poles. Defaults: thesis table 3.8. No pole is sought above the Nyquist frequency.
struct PoleBounds {
  double real_min_hz = 1.0, real_max_hz = 833.0;
  double omega_min_hz = 1.0, omega_max_hz = 210.0;
  double zeta_min = 0.2, zeta_max = 2.0;
};

/// The field that violates a rule, and the rule; empty if none does.
[[nodiscard]] std::string why_invalid(const PoleBounds& bounds);

/// The pole set (of up to three that describe the same loop) that lies in the box, if one does.
[[nodiscard]] std::optional<PoleSet> inside(const Loop& loop, const PoleBounds& bounds,
                                            double tolerance = 1e-6);

struct PoleSearchOptions {
  PoleBounds bounds;
  int starts = 6;              ///< how many of the best grid candidates are refined
  bool search_shapes = true;   ///< false: shapes stay at `shapes`
  std::vector<double> shapes;  ///< start values; empty: those of the catalogue
  std::vector<Mode> modes;     ///< start values of the structure's modes
  std::vector<Point> from;     ///< starts that replace the grid, with their shapes
  double tolerance = 1e-10;    ///< relative decrease of the cost below which a refinement stops
};

struct PoleFit {
  Point point;
  Projection::Solution solution;
  PoleSet poles;          ///< in the box
  bool on_bound = false;  ///< a bound of the box is active
  int evaluations = 0;    ///< evaluations of the projected objective, coarse and fine
};

/// The same data thinned to a step of at most `step_s`, but to no fewer than 1000 samples.
[[nodiscard]] Projection thinned(const Projection& data, double step_s);
[[nodiscard]] Projection thinned(const std::vector<Signals>& segments, const Structure& structure,
                                 double step_s, bool free_response = true);

/// The best fit; nothing if no candidate has a finite cost. Bad data do not throw.
[[nodiscard]] std::optional<PoleFit> pole_search(const Projection& data,
                                                 const PoleSearchOptions& options = {});

/// Covariance of all parameters, in the order: linear ones, a1..an, shapes.
[[nodiscard]] Eigen::MatrixXd covariance(const Projection& data, const PoleFit& fit);

/// 2-norm condition number of the regressors in mm and s, the units of thesis table 3.1
/// (docs/theory.md 4.5).
[[nodiscard]] double condition_number(const Projection& data, const Point& point);

}  // namespace servotwin
