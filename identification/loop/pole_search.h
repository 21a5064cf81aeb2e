// Pole search with least squares projection (thesis 3.4; docs/theory.md 4).
//
//   min over poles and shapes of  1/2 | e - R(poles, shapes) theta |^2,  theta by projection,
//   friction >= 0
//
// 1. Coarse: a logarithmic grid over the box of the poles (pairs with zeta <= 1, and sorted real
// triples),
//    on the data thinned to a step of at most 8 ms and at least 1000 samples.
// 2. Refine the best few with Levenberg-Marquardt in Ceres, in coordinates whose whole range is
// exactly the
//    set of stable loops (a1 = e^q1, a2 = e^q2, a3 = a1 a2 / (1 + e^-q3)): a search in the poles
//    themselves stops where two real poles meet.
// 3. If the optimum lies outside the box, refine again within it.
#pragma once

#include <optional>
#include <vector>

#include "identification/loop/projection.h"

namespace servotwin {

/// The box of the poles. Defaults: thesis table 3.8; no pole is sought above the Nyquist frequency.
struct PoleBounds {
  double real_min_hz = 1.0, real_max_hz = 833.0;
  double omega_min_hz = 1.0, omega_max_hz = 210.0;
  double zeta_min = 0.2, zeta_max = 2.0;
};

/// Which field breaks which rule; empty if none.
[[nodiscard]] std::string why_invalid(const PoleBounds& bounds);

/// The name of the loop's poles that lies in the box, if there is one.
[[nodiscard]] std::optional<PoleSet> inside(const Loop& loop, const PoleBounds& bounds,
                                            double tolerance = 1e-6);

struct PoleSearchOptions {
  PoleBounds bounds;
  int starts = 6;              ///< best grid candidates that are refined
  bool search_shapes = true;   ///< false: shapes stay at `shapes`
  std::vector<double> shapes;  ///< start values; empty: the catalogue's
  std::vector<Mode> modes;     ///< where the modes of the structure are refined from
  std::vector<Point> from;     ///< where to refine from in place of the grid, shapes and all
  double tolerance = 1e-10;    ///< of the relative decrease of the cost at which a refinement stops
};

struct PoleFit {
  Point point;
  Projection::Solution solution;
  PoleSet poles;          ///< in the box
  bool on_bound = false;  ///< the box is active
  int evaluations = 0;    ///< of the projected objective, coarse and fine
};

/// The same data with a step of at most `step_s`, and at least 1000 samples of them.
[[nodiscard]] Projection thinned(const Projection& data, double step_s);

/// The best fit, or nothing where no candidate has a finite cost. Does not throw for bad data.
[[nodiscard]] std::optional<PoleFit> pole_search(const Projection& data,
                                                 const PoleSearchOptions& options = {});

/// Covariance of all parameters: linear ones, a1..an, shapes.
[[nodiscard]] Eigen::MatrixXd covariance(const Projection& data, const PoleFit& fit);

/// 2-norm condition of regressors in mm and s: the unit of the thesis's table 3.1
/// (docs/theory.md 4.5).
[[nodiscard]] double condition_number(const Projection& data, const Point& point);

}  // namespace servotwin
