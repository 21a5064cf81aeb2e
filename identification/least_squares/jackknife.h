// Leave-one-block-out fits without refitting: from the least squares optimum of all blocks of rows,
// one Gauss-Newton step leads to the optimum of all blocks but one. Exact for linear problems, but
// for a weight of 1e-4 that the block keeps; near
// the optimum of a nonlinear one the error is of second order in the step (the infinitesimal
// jackknife: Giordano, Stephenson, Liu, Jordan and Broderick, AISTATS 2019, "A Swiss army
// infinitesimal jackknife").
//
// Any thread. Allocates. Errors: none; a block whose numbers are not finite gives steps that are
// not finite.
#pragma once

#include <Eigen/Core>
#include <array>
#include <vector>

namespace servotwin {

/// J^T J and J^T r of some rows, J the derivatives of the residual r by the parameters.
struct NormalEquations {
  Eigen::MatrixXd gram;
  Eigen::VectorXd gradient;
};
[[nodiscard]] NormalEquations normal_equations(const Eigen::MatrixXd& jacobian,
                                               const Eigen::VectorXd& residual);

/// Shares of such a step to try, in this order: where the problem is not linear over the whole of
/// it, a shorter one lowers the cost of the other blocks.
inline constexpr std::array<double, 3> kStepShares{1.0, 0.4, 0.15};

/// For every block the step of the parameters that a refit to the other blocks takes. A direction
/// that the other blocks do not determine is left as it is.
[[nodiscard]] std::vector<Eigen::VectorXd> steps_without_each(
    const std::vector<NormalEquations>& blocks);

}  // namespace servotwin
