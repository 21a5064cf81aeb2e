#include "identification/least_squares/bounded_fit.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <vector>

#include "identification/least_squares/interruption.h"

namespace servotwin {

namespace {

// Damping, relative to the squared norms of the columns: at first, and between which it stays,
// where rounding makes less of no effect and more of no step.
constexpr double kFirstDamping = 1e-4, kMinDamping = 1e-12, kMaxDamping = 1e12;
// Decrease of the cost over that which the model promises, below which a step is not taken.
constexpr double kMinDecreaseRatio = 1e-4;
// Squared norm of a column over that of the largest one, below which it is damped as if it had it:
// a column of zeros leaves the equations solvable.
constexpr double kMinColumnRatio = 1e-12;
// Slope over the largest one, below which it is rounding.
constexpr double kRoundingRatio = 1e-12;

double cost_of(const Eigen::VectorXd& residual) { return 0.5 * residual.squaredNorm(); }

}  // namespace

Eigen::VectorXd quadratic_minimum(const Eigen::MatrixXd& h, const Eigen::VectorXd& g,
                                  const Eigen::VectorXd& lower, const Eigen::VectorXd& upper) {
  const Eigen::Index n = g.size();
  Eigen::VectorXd s = Eigen::VectorXd::Zero(n);
  std::vector<bool> held(static_cast<std::size_t>(n), false);
  for (Eigen::Index i = 0; i < n; ++i)
    held[static_cast<std::size_t>(i)] =
        (s(i) <= lower(i) && g(i) > 0.0) || (s(i) >= upper(i) && g(i) < 0.0);
  const double largest = (g.array() / h.diagonal().array().sqrt()).abs().maxCoeff();
  // Every turn either ends, or holds one more at its bound, or lets one go that lowers the model.
  const Eigen::Index most_turns = 10 * n + 10;
  for (Eigen::Index turn = 0; turn < most_turns; ++turn) {
    std::vector<Eigen::Index> free;
    for (Eigen::Index i = 0; i < n; ++i)
      if (!held[static_cast<std::size_t>(i)]) free.push_back(i);
    const Eigen::VectorXd slope = h * s + g;
    const Eigen::VectorXd step =
        free.empty() ? Eigen::VectorXd() : Eigen::VectorXd(h(free, free).llt().solve(-slope(free)));
    double share = 1.0;
    Eigen::Index first = -1;
    for (std::size_t k = 0; k < free.size(); ++k) {
      const Eigen::Index i = free[k];
      const double to = step(static_cast<Eigen::Index>(k)),
                   room = (to > 0.0 ? upper(i) : lower(i)) - s(i);
      if (std::abs(to) > 0.0 && room / to < share) share = std::max(0.0, room / to), first = i;
    }
    for (std::size_t k = 0; k < free.size(); ++k)
      s(free[k]) += share * step(static_cast<Eigen::Index>(k));
    if (first >= 0) {
      s(first) = step(std::distance(free.begin(), std::find(free.begin(), free.end(), first))) > 0.0
                     ? upper(first)
                     : lower(first);
      held[static_cast<std::size_t>(first)] = true;
      continue;
    }
    // The minimum with these held: does one of them want to leave its bound?
    const Eigen::VectorXd there = h * s + g;
    Eigen::Index leaves = -1;
    double most = 0.0;
    for (Eigen::Index i = 0; i < n; ++i) {
      if (!held[static_cast<std::size_t>(i)] || !(lower(i) < upper(i))) continue;
      const double inwards = s(i) <= lower(i) ? -there(i) : there(i),
                   gain = inwards / std::sqrt(h(i, i));
      if (inwards > 0.0 && gain > most) most = gain, leaves = i;
    }
    if (leaves < 0 || !(most > kRoundingRatio * largest)) break;
    held[static_cast<std::size_t>(leaves)] = false;
  }
  return s.cwiseMax(lower).cwiseMin(upper);
}

bool fit_within(const BoundedProblem& problem, const BoundedOptions& options, Eigen::VectorXd& x) {
  x = x.cwiseMax(problem.lower).cwiseMin(problem.upper);
  Eigen::VectorXd r;
  Eigen::MatrixXd jacobian;
  if (!problem.evaluate(x, r, &jacobian)) return false;
  double cost = cost_of(r), damping = kFirstDamping, factor = 2.0;
  Eigen::VectorXd scale = Eigen::VectorXd::Zero(x.size());
  for (int round = 0; round < options.rounds && cost > 0.0;) {
    const Eigen::MatrixXd h = jacobian.transpose() * jacobian;
    const Eigen::VectorXd g = jacobian.transpose() * r;
    scale = scale.cwiseMax(h.diagonal());
    const Eigen::VectorXd damped = scale.cwiseMax(kMinColumnRatio * scale.maxCoeff());
    bool better = false, ends = false;
    while (!better && round < options.rounds && damping < kMaxDamping) {
      throw_if_interrupted();
      ++round;
      Eigen::MatrixXd with = h;
      with.diagonal() += damping * damped;
      const Eigen::VectorXd step = quadratic_minimum(with, g, problem.lower - x, problem.upper - x);
      const double promised = -(g.dot(step) + 0.5 * step.dot(h * step));
      if (!step.allFinite()) {  // too little damping for what is nearly the same twice
        damping *= factor, factor *= 2.0;
        continue;
      }
      if (!(promised > 0.0)) {
        ends = true;
        break;
      }
      const Eigen::VectorXd there = (x + step).cwiseMax(problem.lower).cwiseMin(problem.upper);
      Eigen::VectorXd left;
      const double now = problem.evaluate(there, left, nullptr) ? cost_of(left) : HUGE_VAL;
      const double gain = (cost - now) / promised;
      if (gain > kMinDecreaseRatio) {
        better = true;
        ends = cost - now < options.tolerance * cost && promised < options.tolerance * cost;
        x = there, cost = now;
        damping = std::max(kMinDamping,
                           damping * std::max(1.0 / 3.0, 1.0 - std::pow(2.0 * gain - 1.0, 3)));
        factor = 2.0;
      } else {
        damping *= factor, factor *= 2.0;
        ends = promised < 0.1 * options.tolerance * cost;
        if (ends) break;
      }
    }
    if (!better || ends || round >= options.rounds) break;
    if (!problem.evaluate(x, r, &jacobian)) break;
  }
  return true;
}

}  // namespace servotwin
