// Settings of Ceres for the small least squares problems with bounds of this program. Include only
// in sources that include Ceres.
#pragma once

#include <ceres/solver.h>
#include <glog/logging.h>

namespace servotwin {

/// Levenberg-Marquardt that ends after this many rounds, or where a step changes the cost by less
/// than this share of it. With bounds Ceres also searches along every step. By cubics, its default,
/// that asks for a Jacobian at every point that it tries, four times the work; by quadratics for
/// the cost alone.
[[nodiscard]] inline ceres::Solver::Options bounded_options(ceres::LinearSolverType solver,
                                                            int rounds, double tolerance) {
  // What Ceres logs of a step that led nowhere, which a search takes in its stride, would appear
  // between the lines of the program. Once: the level is a global of all threads.
  [[maybe_unused]] static const int level = FLAGS_minloglevel = google::GLOG_FATAL;
  ceres::Solver::Options out;
  out.linear_solver_type = solver;
  out.max_num_iterations = rounds;
  out.function_tolerance = tolerance;
  out.line_search_interpolation_type = ceres::QUADRATIC;
  out.logging_type = ceres::SILENT;
  return out;
}

}  // namespace servotwin
