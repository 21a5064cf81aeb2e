// Settings of Ceres for the small least squares problems with bounds of this program. Include only
// in sources that include Ceres.
#pragma once

#include <ceres/iteration_callback.h>
#include <ceres/problem.h>
#include <ceres/solver.h>
#include <glog/logging.h>

#include "identification/least_squares/interruption.h"

namespace servotwin {

/// Ends a search of an interrupted thread.
class UntilInterrupted : public ceres::IterationCallback {
 public:
  ceres::CallbackReturnType operator()(const ceres::IterationSummary& /*done*/) override {
    return interruption().stop_requested() ? ceres::SOLVER_ABORT : ceres::SOLVER_CONTINUE;
  }
};

/// Levenberg-Marquardt that ends after this many rounds, or where a step changes the cost by less
/// than this share of it. With bounds Ceres also searches along every step. By cubics, its default,
/// that asks for a Jacobian at every point that it tries, four times the work; by quadratics for
/// the cost alone. For solve_bounded().
[[nodiscard]] inline ceres::Solver::Options bounded_options(ceres::LinearSolverType solver,
                                                            int rounds, double tolerance) {
  // What Ceres logs of a step that led nowhere, which a search takes in its stride, would appear
  // between the lines of the program. Once: the level is a global of all threads.
  [[maybe_unused]] static const int level = FLAGS_minloglevel = google::GLOG_FATAL;
  static UntilInterrupted until_interrupted;
  ceres::Solver::Options out;
  out.callbacks.push_back(&until_interrupted);
  out.linear_solver_type = solver;
  out.max_num_iterations = rounds;
  out.function_tolerance = tolerance;
  out.line_search_interpolation_type = ceres::QUADRATIC;
  out.logging_type = ceres::SILENT;
  return out;
}

/// Solves the problem. Throws Interrupted where the thread is interrupted before or meanwhile.
inline ceres::Solver::Summary solve_bounded(const ceres::Solver::Options& options,
                                            ceres::Problem& problem) {
  throw_if_interrupted();
  ceres::Solver::Summary summary;
  ceres::Solve(options, &problem, &summary);
  throw_if_interrupted();
  return summary;
}

}  // namespace servotwin
