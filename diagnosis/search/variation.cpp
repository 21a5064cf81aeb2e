#include "diagnosis/search/variation.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

#include "diagnosis/search/search.h"
#include "diagnosis/statistics/pieces.h"
#include "identification/least_squares/jackknife.h"
#include "identification/least_squares/parallel.h"
#include "twin/linear_algebra.h"
#include "twin/twin.h"

namespace servotwin {

namespace {

constexpr int kRounds = 12;            // most iterations of a fit
constexpr double kMinDecrease = 1e-4;  // relative decrease of the cost that continues the fit

/// Samples at the start of a segment that are not counted.
Eigen::Index settled(const Segment& s, double settle_s) {
  return std::min<Eigen::Index>(
      s.size(),
      std::max(s.lead, static_cast<Eigen::Index>(std::lround(settle_s / s.sample_time_s))));
}

}  // namespace

void Varied::add(const Change& change) {
  const Eigen::Index n = values.size(), more = static_cast<Eigen::Index>(change.quantities.size());
  values.conservativeResize(n + more);
  for (Eigen::Index i = 0; i < more; ++i)
    values(n + i) = change.quantities[static_cast<std::size_t>(i)].start;
  changes.push_back(change);
}

Model Varied::of(const Model& base, const Eigen::VectorXd& at) const {
  Model out = base;
  Eigen::Index i = 0;
  for (const Change& change : changes) {
    const std::size_t count = change.quantities.size();
    change.apply(out, {at.data() + i, count});
    i += static_cast<Eigen::Index>(count);
  }
  return out;
}

Model Varied::direction(const Model& base, Eigen::Index value) const {
  Eigen::Index at = value;
  auto change = changes.begin();
  while (at >= static_cast<Eigen::Index>(change->quantities.size()))
    at -= static_cast<Eigen::Index>((change++)->quantities.size());
  const double step = change->quantities[static_cast<std::size_t>(at)].step;
  Eigen::VectorXd up = values, down = values;
  up(value) += step;
  down(value) -= step;
  Model out = of(base, up);
  each_parameter(out, of(base, down), [&](double& above, double below) {
    above = (above - below) / (up(value) - down(value));
  });
  return out;
}

bool Variation::fit(Varied& v) const {
  std::optional<Eigen::VectorXd> r = left(v.of(base_), kSettle_s);
  if (!r) return false;
  v.cost = r->squaredNorm();
  double damping = 1e-6;
  for (int round = 0; round < kRounds && v.values.size() > 0; ++round) {
    const std::optional<Eigen::MatrixXd> j = derivatives(v, kSettle_s);
    if (!j) return false;
    const Eigen::MatrixXd gram = j->transpose() * *j;
    const Eigen::VectorXd gradient = j->transpose() * *r;
    double gained = 0.0;
    for (int attempt = 0; attempt < 6; ++attempt, damping *= 30.0) {
      Eigen::MatrixXd damped = gram;
      damped.diagonal() += damping * gram.diagonal().cwiseMax(1e-300);
      const Eigen::VectorXd trial = v.values - solve_symmetric(damped, gradient);
      const std::optional<Eigen::VectorXd> there = left(v.of(base_, trial), kSettle_s);
      if (!there || there->squaredNorm() >= v.cost) continue;
      gained = 1.0 - there->squaredNorm() / v.cost;
      v.values = trial, v.cost = there->squaredNorm(), r = there;
      damping = std::max(1e-9, damping * 0.1);
      break;
    }
    if (gained < kMinDecrease) break;
  }
  v.pieces = left_by(v.of(base_), training_);
  return true;
}

Eigen::VectorXd Variation::deviations(const Varied& v) const {
  const Eigen::Index n = v.values.size();
  const std::optional<Eigen::VectorXd> r = left(v.of(base_), kSettle_s);
  const std::optional<Eigen::MatrixXd> j = r ? derivatives(v, kSettle_s) : std::nullopt;
  if (!j) return Eigen::VectorXd::Constant(n, kAbsent);
  const auto piece =
      std::max<Eigen::Index>(1, std::lround(kPiece_s / training_.front().sample_time_s));
  Eigen::MatrixXd scores = Eigen::MatrixXd::Zero(n, n);
  for (Eigen::Index k = 0; k < r->size(); k += piece) {
    const Eigen::Index count = std::min(piece, r->size() - k);
    const Eigen::VectorXd s = j->middleRows(k, count).transpose() * r->segment(k, count);
    scores += s * s.transpose();
  }
  const Eigen::MatrixXd inverse = inverse_symmetric(j->transpose() * *j);
  return (inverse * scores * inverse).diagonal().cwiseMax(0.0).cwiseSqrt();
}

std::optional<Eigen::VectorXd> Variation::left(const Model& model, double settle_s) const {
  if (!why_invalid(model).empty()) return std::nullopt;
  Eigen::Index rows = 0, row = 0;
  for (const Segment& s : training_) rows += s.size();
  Eigen::VectorXd out = Eigen::VectorXd::Zero(rows);
  for (const Segment& s : training_) {
    const Eigen::Index settle = settled(s, settle_s), n = s.size() - settle;
    out.segment(row + settle, n) = (s.command - s.actual - simulate(model, s)).tail(n).matrix();
    row += s.size();
  }
  if (!out.allFinite()) return std::nullopt;
  return out;
}

std::optional<Eigen::MatrixXd> Variation::derivatives(const Varied& v, double settle_s,
                                                      Eigen::Index first) const {
  const Model here = v.of(base_);
  if (!why_invalid(here).empty()) return std::nullopt;
  std::vector<Model> directions;
  for (Eigen::Index i = first; i < v.values.size(); ++i)
    directions.push_back(v.direction(base_, i));
  std::vector<Eigen::Index> row{0};
  for (const Segment& s : training_) row.push_back(row.back() + s.size());
  Eigen::MatrixXd out =
      Eigen::MatrixXd::Zero(row.back(), static_cast<Eigen::Index>(directions.size()));
  in_parallel(training_.size(), [&](std::size_t i) {
    const Segment& s = training_[i];
    const Eigen::Index n = s.size() - settled(s, settle_s);
    if (n <= 0) return;
    out.middleRows(row[i + 1] - n, n) = -simulate(here, directions, s).by.bottomRows(n);
  });
  if (!out.allFinite()) return std::nullopt;
  return out;
}

std::vector<Varied> left_out(const Model& base, const Varied& v,
                             const std::vector<std::vector<Segment>>& blocks) {
  std::vector<Varied> out(blocks.size(), v);
  const Eigen::Index n = v.values.size();
  std::vector<NormalEquations> equations;
  std::vector<double> squares;
  for (const std::vector<Segment>& block : blocks) {
    if (block.empty()) {
      equations.push_back({Eigen::MatrixXd::Zero(n, n), Eigen::VectorXd::Zero(n)});
      squares.push_back(0.0);
      continue;
    }
    const Variation here(base, block);
    const std::optional<Eigen::VectorXd> left = here.left(v.of(base), kSettle_s);
    const std::optional<Eigen::MatrixXd> by = left ? here.derivatives(v, kSettle_s) : std::nullopt;
    if (!by) return out;
    equations.push_back(normal_equations(*by, *left));
    squares.push_back(left->squaredNorm());
  }
  const std::vector<Eigen::VectorXd> steps = steps_without_each(equations);
  // Whether these values lower the error of all blocks but one.
  const auto lowers = [&](std::size_t without, const Eigen::VectorXd& values) {
    double before = 0.0, sum = 0.0;
    for (std::size_t b = 0; b < blocks.size(); ++b) before += b == without ? 0.0 : squares[b];
    for (std::size_t b = 0; b < blocks.size(); ++b) {
      if (b == without || blocks[b].empty()) continue;
      const auto left = Variation(base, blocks[b]).left(v.of(base, values), kSettle_s);
      if (!left) return false;
      sum += left->squaredNorm();
      if (!(sum < before)) return false;
    }
    return sum < before;
  };
  for (std::size_t b = 0; b < blocks.size(); ++b) {
    for (const double share : kStepShares) {
      const Eigen::VectorXd there = v.values + share * steps[b];
      if (!there.allFinite() || !lowers(b, there)) continue;
      out[b].values = there;
      break;
    }
  }
  return out;
}

}  // namespace servotwin
