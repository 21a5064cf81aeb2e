#include "identification/loop/output_error.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <tuple>

#include "identification/least_squares/bounded_fit.h"
#include "identification/least_squares/covariance.h"
#include "identification/least_squares/jackknife.h"
#include "identification/loop/readings.h"
#include "identification/recording/motion_range.h"
#include "twin/two_mass_axis.h"

namespace servotwin {

namespace {

// With play the error jumps where a contact moves past another: after a few rounds it hardly falls
// any more, and each takes a few simulations per parameter.
constexpr int kMaxRoundsOfPlay = 6;

std::optional<Eigen::MatrixXd> covariance_of(const Coordinates& coordinates,
                                             const Eigen::VectorXd& x, const Readings& readings,
                                             const Likelihoods& likelihoods) {
  Missed at = readings.missed(coordinates, x.data(), coordinates.free());
  if (!at.r.allFinite() || !at.by.allFinite()) return std::nullopt;
  const Eigen::VectorXd g = likelihoods.weighted(at.r, at.by);
  const Eigen::MatrixXd by_x = coordinates.parameters_by_coordinates(x);
  return by_x * robust_covariance(at.by, g, readings.row_s()) * by_x.transpose();
}

}  // namespace

std::optional<OutputErrorFit> output_error(const std::vector<Segment>& segments,
                                           const Structure& structure, const Model& start,
                                           const OutputErrorOptions& options) {
  if (!why_invalid(start).empty() || segments.empty()) return std::nullopt;
  const Coordinates coordinates(structure, start, length_scale(segments), options.held);
  const Readings readings(segments, start, options.torque);
  Eigen::VectorXd x = coordinates.of(start);
  Eigen::VectorXd r = readings.missed(start).r;
  if (r.size() <= x.size() || !r.allFinite()) return std::nullopt;
  const std::vector<std::size_t> free = coordinates.free();
  if (free.empty()) return std::nullopt;

  std::optional<Likelihoods> likelihoods;
  for (int pass = 0; pass < options.passes; ++pass) {
    const double before = likelihoods ? likelihoods->sigma() : 0.0;
    likelihoods.emplace(readings, r, options.encoder_step);
    if (pass > 0 && std::abs(likelihoods->sigma() - before) < 0.05 * before) break;
    BoundedProblem problem{Eigen::VectorXd(x.size()), Eigen::VectorXd(x.size()), {}};
    for (Eigen::Index i = 0; i < x.size(); ++i)
      std::tie(problem.lower(i), problem.upper(i)) = coordinates.bounds(i);
    problem.evaluate = [&](const Eigen::VectorXd& at, Eigen::VectorXd& residual,
                           Eigen::MatrixXd* jacobian) {
      Missed missed = jacobian != nullptr ? readings.missed(coordinates, at.data(), free)
                                          : readings.missed(coordinates.model(at.data()));
      if (missed.r.size() != readings.rows() || !missed.r.allFinite()) return false;
      residual = std::move(missed.r);
      for (Eigen::Index k = 0; k < residual.size(); ++k) {
        const ReadingLikelihood& likelihood = likelihoods->of(k);
        if (jacobian != nullptr) missed.by.row(k) *= likelihood.slope(residual(k));
        residual(k) = likelihood.residual(residual(k));
      }
      if (jacobian != nullptr) *jacobian = std::move(missed.by);
      return residual.allFinite() && (jacobian == nullptr || jacobian->allFinite());
    };
    const int rounds = plays(start) ? std::min(options.rounds, kMaxRoundsOfPlay) : options.rounds;
    if (!fit_within(problem, {rounds, options.tolerance}, x)) return std::nullopt;
    r = readings.missed(coordinates.model(x.data())).r;
  }
  OutputErrorFit fit;
  fit.model = coordinates.model(x.data());
  fit.sigma = likelihoods->sigma();
  if (readings.outputs().motor) fit.motor_sigma = likelihoods->sigma(1);
  if (readings.outputs().torque)
    fit.torque_sigma = likelihoods->sigma(static_cast<std::size_t>(readings.torque_column()));
  fit.minus_log_likelihood = likelihoods->minus_log_likelihood(readings, r);
  if (!options.covariance) return fit;
  auto covariance = covariance_of(coordinates, x, readings, *likelihoods);
  if (!covariance) return std::nullopt;
  fit.covariance = std::move(*covariance);
  return fit;
}

std::optional<Eigen::MatrixXd> covariance_at(const std::vector<Segment>& segments,
                                             const Structure& structure, const Model& model,
                                             double encoder_step) {
  if (!why_invalid(model).empty() || segments.empty()) return std::nullopt;
  const Coordinates coordinates(structure, model, length_scale(segments));
  const Readings readings(segments, model);
  const Eigen::VectorXd x = coordinates.of(model), r = readings.missed(model).r;
  if (r.size() <= x.size() || !r.allFinite()) return std::nullopt;
  return covariance_of(coordinates, x, readings, Likelihoods(readings, r, encoder_step));
}

std::vector<Model> left_out(const std::vector<std::vector<Segment>>& blocks,
                            const Structure& structure, const Model& at, double encoder_step) {
  std::vector<Model> out(blocks.size(), at);
  if (!why_invalid(at).empty()) return out;
  double scale = 1.0;
  for (const std::vector<Segment>& block : blocks) scale = std::max(scale, length_scale(block));
  const Coordinates coordinates(structure, at, scale);
  const Eigen::VectorXd x = coordinates.of(at);
  std::vector<Segment> together;
  for (const std::vector<Segment>& block : blocks)
    together.insert(together.end(), block.begin(), block.end());
  const Readings of_all(together, at);
  std::vector<Readings> readings;
  std::vector<Eigen::VectorXd> left;
  for (const std::vector<Segment>& block : blocks) {
    readings.emplace_back(block, at, of_all.outputs());
    left.push_back(readings.back().missed(at).r);
    if (!left.back().allFinite()) return out;
  }
  if (of_all.rows() <= x.size()) return out;
  const Likelihoods likelihoods(of_all, of_all.missed(at).r, encoder_step);
  const std::vector<std::size_t> every = coordinates.free();
  std::vector<NormalEquations> equations(blocks.size());
  std::vector<double> costs(blocks.size(), 0.0);
  for (std::size_t b = 0; b < blocks.size(); ++b) {
    Missed block = readings[b].missed(coordinates, x.data(), every);
    if (block.r.size() != left[b].size() || !block.by.allFinite()) return out;
    const Eigen::VectorXd g = likelihoods.weighted(block.r, block.by);
    equations[b] = normal_equations(block.by, g);
  }
  const std::vector<Eigen::VectorXd> steps = steps_without_each(equations);
  for (std::size_t b = 0; b < blocks.size(); ++b) {
    if (left[b].size() > 0) costs[b] = likelihoods.minus_log_likelihood(readings[b], left[b]);
  }
  // Whether this model is the more probable one for all blocks but one.
  const auto lowers = [&](std::size_t without, const Model& model) {
    double before = 0.0, sum = 0.0;
    for (std::size_t b = 0; b < blocks.size(); ++b) {
      if (b == without || left[b].size() == 0) continue;
      const Eigen::VectorXd r = readings[b].missed(model).r;
      if (r.size() != left[b].size() || !r.allFinite()) return false;
      before += costs[b];
      sum += likelihoods.minus_log_likelihood(readings[b], r);
    }
    return sum < before;
  };
  for (std::size_t b = 0; b < blocks.size(); ++b) {
    for (const double share : kStepShares) {
      Eigen::VectorXd there = x + share * steps[b];
      for (Eigen::Index i = 0; i < there.size(); ++i) {
        const auto [lower, upper] = coordinates.bounds(i);
        there(i) = std::clamp(there(i), lower, upper);
      }
      if (!there.allFinite()) break;
      Model model = coordinates.model(there.data());
      if (!why_invalid(model).empty() || !lowers(b, model)) continue;
      out[b] = std::move(model);
      break;
    }
  }
  return out;
}

}  // namespace servotwin
