#include "identification/least_squares/jackknife.h"

#include "twin/linear_algebra.h"

namespace servotwin {

NormalEquations normal_equations(const Eigen::MatrixXd& jacobian, const Eigen::VectorXd& residual) {
  return {jacobian.transpose() * jacobian, jacobian.transpose() * residual};
}

std::vector<Eigen::VectorXd> steps_without_each(const std::vector<NormalEquations>& blocks) {
  // Weight with which the left-out block counts all the same: it decides only where the others say
  // nothing. kRidge is against matrices that rounding makes indefinite.
  constexpr double kPriorWeight = 1e-4, kRidge = 1e-13;
  std::vector<Eigen::VectorXd> out;
  if (blocks.empty()) return out;
  NormalEquations all = blocks.front();
  for (std::size_t b = 1; b < blocks.size(); ++b) {
    all.gram += blocks[b].gram;
    all.gradient += blocks[b].gradient;
  }
  // In units in which every parameter moves the residual equally.
  const Eigen::VectorXd unit = all.gram.diagonal().cwiseMax(1e-300).cwiseSqrt().cwiseInverse();
  for (const NormalEquations& block : blocks) {
    Eigen::MatrixXd gram =
        unit.asDiagonal() * ((1.0 + kPriorWeight) * all.gram - block.gram) * unit.asDiagonal();
    gram.diagonal().array() += kRidge;
    const Eigen::VectorXd gradient = unit.asDiagonal() * (all.gradient - block.gradient);
    out.emplace_back(-(unit.asDiagonal() * solve_symmetric(gram, gradient)));
  }
  return out;
}

}  // namespace servotwin
