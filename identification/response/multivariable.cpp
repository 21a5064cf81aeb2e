#include "identification/response/multivariable.h"

#include <ceres/ceres.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <numbers>
#include <optional>
#include <stdexcept>

#include "identification/least_squares/bounded.h"
#include "identification/least_squares/covariance.h"
#include "identification/least_squares/pole_filter.h"
#include "identification/response/frequency_response.h"
#include "identification/response/multivariable_problem.h"
#include "twin/maxwell_slip.h"
#include "twin/shown_units.h"
#include "twin/two_pi.h"

namespace servotwin {

namespace {

constexpr double kMinFrequency_hz = 0.02, kPoleShareOfNyquist = 0.9;
constexpr double kMinPoleDamping = 5e-4, kMaxPoleDamping = 5.0;
// Residual of a higher order over a lower one, at most, to accept it.
constexpr double kMaxResidualRatioToAccept = 0.97;
constexpr double kResidualFloor = 1e-6;  // residual over output RMS below which nothing is gained
constexpr int kRounds = 60;              // of Levenberg-Marquardt
constexpr double kCoarseTolerance = 1e-4, kFineTolerance = 1e-8;  // change of cost at which it ends
constexpr int kMaxOrdersWithoutGain = 3;  // orders without a gain after which the search ends
constexpr Eigen::Index kRowsPerColumn = 10;
constexpr double kMinTransform = 2.0;  // lines: below them the removed mean distorts the spectrum
constexpr double kDeviationOfUnusablePoint =
    1e9;                                 // deviation of an unusable point over the largest response
constexpr double kShortestBreak = 1e-8;  // [m | rad]
constexpr double kLongestBreak = 0.25;   // of the travel
constexpr double kFittedFirst = 2.0 / 3.0;  // of the training data, where something is chosen

using Place = MultivariablePlace;

Place place_of(const std::vector<FittedPole>& poles, double fastest) {
  Place out;
  for (const FittedPole& pole : poles) {
    out.pair.push_back(pole.pair);
    out.poles.push_back(std::log(std::clamp(pole.omega, kTwoPi * kMinFrequency_hz, fastest)));
    if (pole.pair)
      out.poles.push_back(std::log(std::clamp(pole.zeta, kMinPoleDamping, kMaxPoleDamping)));
  }
  return out;
}

class Cost final : public ceres::CostFunction {
 public:
  Cost(const MultivariableProblem& problem, const Place& at, int& evaluations)
      : problem_(problem), pair_(at.pair), evaluations_(evaluations) {
    mutable_parameter_block_sizes()->push_back(static_cast<int>(at.poles.size()));
    if (!at.log_distances.empty())
      mutable_parameter_block_sizes()->push_back(static_cast<int>(at.log_distances.size()));
    set_num_residuals(static_cast<int>(problem.rows() * problem.outputs()));
  }
  bool Evaluate(double const* const* x, double* residuals, double** jacobians) const override {
    const auto block = [&](std::size_t i) {
      if (i >= parameter_block_sizes().size()) return std::vector<double>{};
      return std::vector<double>(x[i], x[i] + parameter_block_sizes()[i]);
    };
    const auto wanted = [&](std::size_t i) {
      return i < parameter_block_sizes().size() && jacobians != nullptr && jacobians[i] != nullptr;
    };
    ++evaluations_;
    const auto left = problem_.solve({pair_, block(0), block(1)}, {wanted(0), wanted(1)});
    Eigen::Map<Eigen::MatrixXd>(residuals, left.residual.rows(), left.residual.cols()) =
        left.residual;
    using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
    for (const std::size_t i : {0U, 1U}) {
      if (wanted(i))
        Eigen::Map<RowMajor>(jacobians[i], num_residuals(), parameter_block_sizes()[i]) =
            i == 0 ? left.by_poles : left.by_distances;
    }
    return left.residual.allFinite() && left.by_poles.allFinite() && left.by_distances.allFinite();
  }

 private:
  const MultivariableProblem& problem_;
  std::vector<bool> pair_;
  int& evaluations_;
};

double fastest(double sample_time_s) {
  return kPoleShareOfNyquist * std::numbers::pi / sample_time_s;
}

/// Tolerance of a search, and which parameters it varies.
struct Search {
  double tolerance = kCoarseTolerance;
  bool distances = false;         // else they are held
  std::vector<double> longest{};  // of every element
};

/// Levenberg-Marquardt from a place; nothing if it does not converge.
std::optional<Place> refined(const MultivariableProblem& problem, Place at, Search search,
                             int& evaluations) {
  ceres::Problem solved;
  std::vector<double*> blocks{at.poles.data()};
  if (!at.log_distances.empty()) blocks.push_back(at.log_distances.data());
  solved.AddResidualBlock(new Cost(problem, at, evaluations), nullptr, blocks);
  const auto bound = [&](std::vector<double>& values, std::size_t i, double lower, double upper) {
    values[i] = std::clamp(values[i], std::log(lower), std::log(upper));
    solved.SetParameterLowerBound(values.data(), static_cast<int>(i), std::log(lower));
    solved.SetParameterUpperBound(values.data(), static_cast<int>(i), std::log(upper));
  };
  std::size_t value = 0;
  for (const bool pair : at.pair) {
    bound(at.poles, value++, kTwoPi * kMinFrequency_hz, fastest(problem.sample_time_s()));
    if (pair) bound(at.poles, value++, kMinPoleDamping, kMaxPoleDamping);
  }
  if (!at.log_distances.empty() && !search.distances)
    solved.SetParameterBlockConstant(at.log_distances.data());
  for (std::size_t i = 0; search.distances && i < at.log_distances.size(); ++i)
    bound(at.log_distances, i, kShortestBreak, search.longest[i]);
  ceres::Solver::Options options =
      bounded_options(ceres::DENSE_NORMAL_CHOLESKY, kRounds, search.tolerance);
  options.gradient_tolerance = 1e-30;
  const ceres::Solver::Summary summary = solve_bounded(options, solved);
  if (!summary.IsSolutionUsable()) return std::nullopt;
  return at;
}

/// The frequency responses of all channels over the first part of every record, side by side;
/// nothing where that is too short for them.
std::optional<ResponsePoints> responses(const MultivariableData& data, double share) {
  const std::size_t outputs = data.records.front().outputs.size();
  ResponsePoints out;
  std::vector<FrequencyResponse> found;
  try {
    std::vector<ResponseRecord> records;
    for (std::size_t j = 0; j < outputs; ++j) {
      for (std::size_t r = 0; r < data.records.size(); ++r) {
        const MultivariableRecord& record = data.records[r];
        const auto head =
            static_cast<Eigen::Index>(share * static_cast<double>(record.inputs[0].size()));
        if (j > 0) {
          records[r].output = record.outputs[j].head(head);
          continue;
        }
        ResponseRecord one;
        for (std::size_t i = 0; i < record.inputs.size(); ++i) {
          const double distance = data.inputs[i].break_distance;
          const Eigen::ArrayXd input = record.inputs[i].head(head);
          one.inputs.push_back(distance > 0.0 ? friction_input(input, distance) : input);
        }
        one.output = record.outputs[j].head(head);
        records.push_back(std::move(one));
      }
      found.push_back(frequency_response(records, data.sample_time_s));
    }
  } catch (const std::runtime_error&) {
    return std::nullopt;
  }
  // Where any channel is significant.
  std::vector<Eigen::Index> places;
  for (const FrequencyResponse& response : found) {
    for (std::size_t i = 0; i < response.channels.size(); ++i) {
      const auto more = response.significant(i, (kMinTransform - 0.5) / response.window_s,
                                             0.4 / data.sample_time_s);
      places.insert(places.end(), more.begin(), more.end());
    }
  }
  std::sort(places.begin(), places.end());
  places.erase(std::unique(places.begin(), places.end()), places.end());
  if (places.empty()) return std::nullopt;
  const auto count = static_cast<Eigen::Index>(places.size());
  const std::size_t inputs = data.records.front().inputs.size();
  out.response.resize(count, static_cast<Eigen::Index>(outputs * inputs));
  out.deviation.resize(count, static_cast<Eigen::Index>(outputs * inputs));
  Eigen::Index column = 0;
  for (const FrequencyResponse& response : found) {
    for (std::size_t i = 0; i < inputs; ++i, ++column) {
      const ResponsePoints one = response.points(i, places);
      out.omega = one.omega;
      out.overlap = one.overlap;
      double most = 0.0;
      for (Eigen::Index k = 0; k < count; ++k) {
        if (std::isfinite(std::abs(one.response(k, 0))))
          most = std::max(most, std::abs(one.response(k, 0)));
      }
      for (Eigen::Index k = 0; k < count; ++k) {
        const bool says = std::isfinite(std::abs(one.response(k, 0))) &&
                          std::isfinite(one.deviation(k, 0)) && one.deviation(k, 0) > 0.0;
        out.response(k, column) = says ? one.response(k, 0) : 0.0;
        out.deviation(k, column) =
            says ? one.deviation(k, 0) : kDeviationOfUnusablePoint * std::max(most, 1e-300);
      }
    }
  }
  return out;
}

/// Start of a search of this order if no frequency response is significant: pairs, evenly spaced in
/// log frequency.
Place spread_out(int order, double sample_time_s) {
  std::vector<FittedPole> poles;
  const int pairs = order / 2;
  for (int i = 0; i < pairs; ++i)
    poles.push_back({true, kTwoPi * 2.0 * std::pow(0.05 / sample_time_s, (i + 0.5) / pairs), 0.3});
  if (order % 2 == 1) poles.push_back({false, kTwoPi * 5.0});
  return place_of(poles, fastest(sample_time_s));
}

struct Best {
  Place at;
  Eigen::ArrayXd scale;
  double cost = 0.0;  // log of the residual, summed over the outputs
};

/// The best point of this order: from every start twice, the second time with the outputs weighted
/// by the residuals of the first.
std::optional<Best> sought(MultivariableProblem& problem, const std::vector<Place>& starts,
                           const Search& search, int& evaluations) {
  std::optional<Best> best;
  const Eigen::ArrayXd spread = problem.spread();
  for (const Place& start : starts) {
    problem.set_scale(spread);
    std::optional<Place> at = start;
    for (int pass = 0; pass < 2 && at; ++pass) {
      at = refined(problem, *at, search, evaluations);
      if (!at) break;
      const auto left = problem.solve(*at, {});
      problem.set_scale((rms_of(left.residual) * problem.scale()).max(1e-9 * spread));
    }
    if (!at) continue;
    const double cost = (problem.scale() / spread).log().sum();
    if (!std::isfinite(cost) || (best && cost >= best->cost)) continue;
    best = Best{*at, problem.scale(), cost};
  }
  if (best) problem.set_scale(best->scale);
  return best;
}

using Starts = std::vector<std::vector<FittedPole>>;  // by order, from 1

Starts starts_within(const MultivariableData& data, double share, int most) {
  const auto points = responses(data, share);
  return points ? starting_poles(*points, most) : Starts{};
}

/// Break distances as they are given.
std::vector<Place> starts_of(const Starts& by_order, int order, const MultivariableData& data) {
  Place out =
      static_cast<std::size_t>(order) <= by_order.size()
          ? place_of(by_order[static_cast<std::size_t>(order) - 1], fastest(data.sample_time_s))
          : spread_out(order, data.sample_time_s);
  for (const MultivariableInput& input : data.inputs) {
    if (input.break_distance > 0.0) out.log_distances.push_back(std::log(input.break_distance));
  }
  return {out};
}

/// Residual of a place, found in the first two thirds of the training data, over the last third (as
/// MultivariableTrial::left).
double left_of(const MultivariableProblem& problem, const Place& at, double from, double to) {
  const auto left = problem.solve(at, {});
  const Eigen::ArrayXd rms = problem.judged(at, left.coefficients, from, to);
  return std::exp((rms / problem.spread_between(from, to)).max(kResidualFloor).log().mean());
}

void check(const MultivariableData& data, const MultivariableOptions& options) {
  if (data.records.empty() || data.inputs.empty() || data.records.front().outputs.empty())
    throw std::runtime_error("a multivariable fit needs a record, an input and an output");
  for (const MultivariableRecord& record : data.records) {
    if (record.inputs.size() != data.inputs.size())
      throw std::runtime_error("a record has " + std::to_string(record.inputs.size()) + " of " +
                               std::to_string(data.inputs.size()) + " inputs");
  }
  if (!(options.training_share >= 0.1 && options.training_share <= 0.95))
    throw std::runtime_error("the training share must be from 0.1 to 0.95");
  if (options.order < 0 || options.order > kMaxPoles || options.most < 1 ||
      options.most > kMaxPoles)
    throw std::runtime_error("the order must lie between 1 and " + std::to_string(kMaxPoles));
  for (std::size_t i = 0; i < data.inputs.size(); ++i) {
    const double distance = data.inputs[i].break_distance,
                 longest = longest_break_distance(data, i, options);
    const std::string unit = micro(data.inputs[i].rotary);
    if (distance > longest)
      throw std::runtime_error("input " + std::to_string(i + 1) +
                               ": an element that slides after " + std::to_string(1e6 * distance) +
                               " " + unit +
                               " equals the position where the axis travels no further; at most " +
                               std::to_string(1e6 * longest) + " " + unit + " here");
    double least = std::numeric_limits<double>::max(), most = -least;
    for (const MultivariableRecord& record : data.records) {
      least = std::min(least, record.inputs[i].minCoeff());
      most = std::max(most, record.inputs[i].maxCoeff());
    }
    if (!(most > least))
      throw std::runtime_error("input " + std::to_string(i + 1) +
                               " never changes: its effect cannot be identified");
  }
}

}  // namespace

double longest_break_distance(const MultivariableData& data, std::size_t input,
                              const MultivariableOptions& options) {
  double travel = 0.0;
  for (const MultivariableRecord& record : data.records) {
    const Eigen::ArrayXd& x = record.inputs[input];
    const auto head = static_cast<Eigen::Index>(kFittedFirst * options.training_share *
                                                static_cast<double>(x.size()));
    if (head > 0) travel = std::max(travel, x.head(head).maxCoeff() - x.head(head).minCoeff());
  }
  return kLongestBreak * travel;
}

Eigen::ArrayXd friction_input(const Eigen::ArrayXd& position, double break_distance) {
  Eigen::ArrayXd out = Eigen::ArrayXd::Zero(position.size());
  for (Eigen::Index k = 1; k < position.size(); ++k)
    out(k) = slip(out(k - 1), 1.0 / break_distance, 1.0, position(k) - position(k - 1));
  return out;
}

int MultivariableFit::order() const {
  int sum = 0;
  for (const FittedPole& pole : poles) sum += pole.pair ? 2 : 1;
  return sum;
}

std::complex<double> MultivariableFit::at(std::size_t output, std::size_t input,
                                          double omega) const {
  const std::complex<double> s(0.0, omega);
  const auto row = static_cast<Eigen::Index>(input);
  const Eigen::MatrixXd& c = coefficients.at(output);
  std::complex<double> out = c(row, c.cols() - 1);
  Eigen::Index k = 0;
  for (const FittedPole& pole : poles) {
    if (pole.pair) {
      out += (c(row, k) * s + c(row, k + 1)) /
             (s * s + 2.0 * pole.zeta * pole.omega * s + pole.omega * pole.omega);
      k += 2;
    } else {
      out += c(row, k++) / (s + pole.omega);
    }
  }
  return out;
}

Eigen::MatrixXd answer_of(const MultivariableFit& fit, const MultivariableData& data,
                          const MultivariableRecord& record, const std::vector<bool>& wanted) {
  const double h = data.sample_time_s;
  const Eigen::Index rows = record.outputs.front().size();
  const auto outputs = static_cast<Eigen::Index>(fit.coefficients.size());
  Eigen::MatrixXd out = Eigen::MatrixXd::Zero(rows, outputs);
  for (std::size_t i = 0; i < data.inputs.size(); ++i) {
    if (!wanted[i]) continue;
    const double distance = fit.break_distances[i];
    const Spline u = distance > 0.0
                         ? Spline::straight(friction_input(record.inputs[i], distance), h)
                     : data.inputs[i].smooth ? Spline::through(record.inputs[i], h)
                                             : Spline::straight(record.inputs[i], h);
    // Coefficients of this input: one row per output.
    Eigen::MatrixXd c(outputs, fit.order() + 1);
    for (Eigen::Index j = 0; j < outputs; ++j)
      c.row(j) = fit.coefficients[static_cast<std::size_t>(j)].row(static_cast<Eigen::Index>(i));
    Eigen::Index first = 0;
    for (const FittedPole& pole : fit.poles) {
      const double value[] = {std::log(pole.omega), pole.pair ? std::log(pole.zeta) : 0.0};
      const PoleFilter filter(pole.pair, value, h, false);
      filter.answer(u, rows, [&](Eigen::Index k, const Eigen::Vector4d& w) {
        if (pole.pair)
          out.row(k) += (w(1) * c.col(first) + w(0) * c.col(first + 1)).transpose();
        else
          out.row(k) += w(0) * c.col(first).transpose();
      });
      first += filter.width();
    }
    out += u.value.matrix() * c.col(first).transpose();
  }
  return out;
}

MultivariableMatrices matrices_of(const MultivariableFit& fit) {
  const Eigen::Index n = fit.order(), inputs = fit.coefficients.front().rows();
  const auto outputs = static_cast<Eigen::Index>(fit.coefficients.size());
  MultivariableMatrices out;
  out.a.setZero(n * outputs, n * outputs);
  out.b.resize(n * outputs, inputs);
  out.c.setZero(outputs, n * outputs);
  out.d.resize(outputs, inputs);
  for (Eigen::Index j = 0; j < outputs; ++j) {
    const Eigen::MatrixXd& c = fit.coefficients[static_cast<std::size_t>(j)];
    Eigen::Index at = n * j;
    out.b.middleRows(at, n) = c.leftCols(n).transpose();
    out.d.row(j) = c.col(n).transpose();
    for (const FittedPole& pole : fit.poles) {
      out.c(j, at) = 1.0;
      out.a(at, at) = pole.pair ? -2.0 * pole.zeta * pole.omega : -pole.omega;
      if (pole.pair) {
        out.a(at, at + 1) = 1.0;
        out.a(at + 1, at) = -pole.omega * pole.omega;
      }
      at += pole.pair ? 2 : 1;
    }
  }
  return out;
}

MultivariableFit identify_multivariable(const MultivariableData& data,
                                        const MultivariableOptions& options) {
  check(data, options);
  MultivariableFit out;
  const auto enough = [&](const MultivariableProblem& problem, int order) {
    const Eigen::Index columns =
        order * (problem.inputs() + problem.records()) + problem.inputs() + problem.records();
    return problem.rows() > kRowsPerColumn * columns;
  };

  // The order and the break distances, within the training data.
  int order = options.order;
  std::vector<Place> found;  // of the order chosen
  Search last{kFineTolerance};
  for (std::size_t i = 0; i < data.inputs.size(); ++i) {
    if (data.inputs[i].break_distance > 0.0)
      last.longest.push_back(longest_break_distance(data, i, options));
  }
  const bool seek = !last.longest.empty() && options.seek_break_distances;
  if (order == 0 || seek) {
    const double share = kFittedFirst * options.training_share;
    MultivariableProblem problem(data, share);
    const int first = order == 0 ? 1 : order, most = order == 0 ? options.most : order;
    const Starts starts = starts_within(data, share, most);
    double least = std::numeric_limits<double>::infinity();
    int futile = 0;
    for (int tried = first;
         tried <= most && futile < kMaxOrdersWithoutGain && enough(problem, tried); ++tried) {
      const auto best = sought(problem, starts_of(starts, tried, data), {}, out.evaluations);
      MultivariableTrial trial{tried, std::numeric_limits<double>::quiet_NaN()};
      if (best) trial.left = left_of(problem, best->at, share, options.training_share);
      ++futile;
      if (trial.left < kMaxResidualRatioToAccept * least) {
        least = trial.left;
        order = tried;
        found = {best->at};
        futile = 0;
      }
      if (options.order == 0) out.trials.push_back(trial);
    }
    for (MultivariableTrial& trial : out.trials) trial.chosen = trial.order == order;
    if (seek && !found.empty()) {
      const auto best =
          sought(problem, found, {kCoarseTolerance, true, last.longest}, out.evaluations);
      if (best) {
        out.distances.left_given = least;
        out.distances.left_found = left_of(problem, best->at, share, options.training_share);
        out.distances.taken = last.distances =
            out.distances.left_found < kMaxResidualRatioToAccept * least;
        if (last.distances) found = {best->at};
      }
    }
  }
  MultivariableProblem problem(data, options.training_share);
  if (order == 0 || !enough(problem, order))
    throw std::runtime_error("the records are too short: at least " +
                             std::to_string(kRowsPerColumn) +
                             " samples are needed for every coefficient of the simplest fit");
  if (found.empty())
    found = starts_of(starts_within(data, options.training_share, order), order, data);
  const auto best = sought(problem, found, last, out.evaluations);
  if (!best) throw std::runtime_error("no finite fit of order " + std::to_string(order));

  const auto left = problem.solve(best->at, {true, last.distances});
  out.scale = problem.scale();
  out.training = rms_of(left.residual) * problem.scale();
  out.holdout = problem.judged(best->at, left.coefficients, options.training_share, 1.0);
  out.holdout_outputs = problem.spread_between(options.training_share, 1.0);
  out.parts = problem.parts_between(best->at, left.coefficients, options.training_share, 1.0);
  const Eigen::Map<const Eigen::VectorXd> stacked(left.residual.data(), left.residual.size());
  Eigen::MatrixXd jacobian(left.by_poles.rows(), left.by_poles.cols() + left.by_distances.cols());
  jacobian.leftCols(left.by_poles.cols()) = left.by_poles;
  jacobian.rightCols(left.by_distances.cols()) = left.by_distances;
  const Eigen::MatrixXd covariance = robust_covariance(jacobian, stacked, data.sample_time_s);
  std::size_t element = 0;
  for (const MultivariableInput& input : data.inputs) {
    out.break_distances.push_back(input.break_distance);
    out.break_deviations.push_back(0.0);
    if (!(input.break_distance > 0.0)) continue;
    const Eigen::Index i = left.by_poles.cols() + static_cast<Eigen::Index>(element);
    const double distance = std::exp(best->at.log_distances[element++]);
    if (!last.distances) continue;
    out.break_distances.back() = distance;
    out.break_deviations.back() = distance * std::sqrt(std::max(0.0, covariance(i, i)));
  }

  // By frequency.
  struct Found {
    FittedPole pole;
    Eigen::Index first = 0;  // of its coefficients
  };
  std::vector<Found> poles;
  Eigen::Index value = 0, first = 0;
  for (const bool pair : best->at.pair) {
    const auto at = [&](Eigen::Index i) {
      return std::exp(best->at.poles[static_cast<std::size_t>(i)]);
    };
    const auto deviation = [&](Eigen::Index i) {
      return at(i) * std::sqrt(std::max(0.0, covariance(i, i)));
    };
    Found one;
    one.pole.pair = pair;
    one.pole.omega = at(value);
    // A pole on a bound of the search is not determined by the data.
    const double fast = fastest(data.sample_time_s), slow = kTwoPi * kMinFrequency_hz;
    const bool bound = one.pole.omega < 1.001 * slow || one.pole.omega > 0.999 * fast;
    one.pole.omega_deviation = bound ? std::numeric_limits<double>::infinity() : deviation(value);
    if (pair) {
      one.pole.zeta = at(value + 1);
      one.pole.zeta_deviation = deviation(value + 1);
    }
    one.first = first;
    poles.push_back(one);
    value += pair ? 2 : 1;
    first += (pair ? 2 : 1) * (problem.inputs() + problem.records());
  }
  std::sort(poles.begin(), poles.end(),
            [](const Found& l, const Found& r) { return l.pole.omega < r.pole.omega; });
  out.coefficients.assign(static_cast<std::size_t>(problem.outputs()),
                          Eigen::MatrixXd::Zero(problem.inputs(), order + 1));
  Eigen::Index column = 0;
  for (const Found& one : poles) {
    const Eigen::Index width = one.pole.pair ? 2 : 1;
    out.poles.push_back(one.pole);
    for (Eigen::Index j = 0; j < problem.outputs(); ++j) {
      for (Eigen::Index i = 0; i < problem.inputs(); ++i)
        out.coefficients[static_cast<std::size_t>(j)].row(i).segment(column, width) =
            left.coefficients.col(j).segment(one.first + width * i, width).transpose();
    }
    column += width;
  }
  for (Eigen::Index j = 0; j < problem.outputs(); ++j)
    out.coefficients[static_cast<std::size_t>(j)].col(order) =
        left.coefficients.col(j).segment(first, problem.inputs());
  return out;
}

}  // namespace servotwin
