// Settings of Ceres for the small least squares problems with bounds of this program. Include only
// in sources that include Ceres.
#pragma once

#include <ceres/solver.h>

namespace servotwin {

/// Levenberg-Marquardt that ends after this many rounds, or where a step changes the cost by less
/// than this share of it. Ceres would search along every step of a problem with bounds, with a
/// Jacobian for every point that it tries, which is four times the work for the same optimum; here
/// a step that does not lower the cost is made shorter, as it is without bounds.
[[nodiscard]] inline ceres::Solver::Options bounded_options(ceres::LinearSolverType solver,
                                                            int rounds, double tolerance) {
  ceres::Solver::Options out;
  out.linear_solver_type = solver;
  out.max_num_iterations = rounds;
  out.function_tolerance = tolerance;
  out.max_num_line_search_step_size_iterations = 0;
  out.logging_type = ceres::SILENT;
  return out;
}

}  // namespace servotwin
