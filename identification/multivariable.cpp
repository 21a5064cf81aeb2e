#include "identification/multivariable.h"

#include <ceres/ceres.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <numbers>
#include <optional>
#include <stdexcept>

#include "identification/covariance.h"
#include "identification/frequency_response.h"
#include "identification/gram_solver.h"
#include "twin/hold.h"
#include "twin/maxwell_slip.h"

namespace servotwin {

namespace {

constexpr double kTwoPi = 2.0 * std::numbers::pi;
constexpr double kSlowest_hz = 0.02, kShareOfNyquist = 0.9;
constexpr double kLeastDamping = 5e-4, kMostDamping = 5.0;
constexpr double kWorthIt = 0.97;  // what a richer order leaves of what a simpler one does
constexpr double kExact = 1e-6;    // of the outputs: nothing is gained by leaving less
constexpr int kRounds = 60;        // of Levenberg-Marquardt
constexpr double kRough = 1e-4, kFine = 1e-8;  // change of cost at which it ends
constexpr int kFutile = 3;                     // orders without a gain, and the search ends
constexpr Eigen::Index kRowsPerColumn = 10;
constexpr double kLeastTransform = 2.0;  // lines: below, the mean that was removed is missing
constexpr double kUnknown = 1e9;         // deviation of a point that says nothing, in responses

/// A place of the search: of every pole log p, or log omega and log zeta.
struct Place {
  std::vector<bool> pair;
  std::vector<double> value;
};

Place place_of(const std::vector<FittedPole>& poles, double fastest) {
  Place out;
  for (const FittedPole& pole : poles) {
    out.pair.push_back(pole.pair);
    out.value.push_back(std::log(std::clamp(pole.omega, kTwoPi * kSlowest_hz, fastest)));
    if (pole.pair)
      out.value.push_back(std::log(std::clamp(pole.zeta, kLeastDamping, kMostDamping)));
  }
  return out;
}

/// The inputs of one record as they are between samples.
struct Course {
  std::vector<Spline> inputs;
  Eigen::Index size = 0, head = 0;  // samples, and how many of them are fitted
  [[nodiscard]] Eigen::Index count(bool whole) const { return whole ? size : head; }
};

Course course_of(const MultivariableRecord& record, const MultivariableData& data) {
  Course out;
  out.size = record.inputs.front().size();
  for (std::size_t i = 0; i < record.inputs.size(); ++i) {
    if (data.smooth[i]) {
      out.inputs.push_back(Spline::through(record.inputs[i], data.sample_time_s));
      continue;
    }
    Spline straight;
    straight.h = data.sample_time_s;
    straight.value = record.inputs[i];
    straight.first = straight.second = straight.third = Eigen::ArrayXd::Zero(out.size);
    for (Eigen::Index k = 0; k + 1 < out.size; ++k)
      straight.first(k) = (straight.value(k + 1) - straight.value(k)) / straight.h;
    out.inputs.push_back(std::move(straight));
  }
  return out;
}

/// The outputs of one pole to all inputs and from all starts: columns of the least squares problem,
/// `width` per input and then per record; and their derivatives by log p, or by log omega and log
/// zeta, where asked for. y = u / M and, behind it, g = u / M^2, by exact steps.
void fill_block(bool pair, const double* value, const std::vector<Course>& courses, bool whole,
                Eigen::Ref<Eigen::MatrixXd> columns, std::vector<Eigen::MatrixXd>* by) {
  const bool derivatives = by != nullptr;
  const int n = pair ? 2 : 1, states = derivatives ? 2 * n : n;
  const double omega = std::exp(value[0]), zeta = pair ? std::exp(value[1]) : 1.0;
  const double a = 2.0 * zeta * omega, b = omega * omega;
  Eigen::MatrixXd system = Eigen::MatrixXd::Zero(states, states);
  for (int first = 0; first < states; first += n) {
    if (pair) {
      system(first, first + 1) = 1.0;
      system(first + 1, first) = -b;
      system(first + 1, first + 1) = -a;
    } else {
      system(first, first) = -omega;
    }
  }
  if (derivatives) system(states - 1, 0) = 1.0;
  Eigen::VectorXd input = Eigen::VectorXd::Zero(states);
  input(n - 1) = 1.0;
  const Hold hold = discretise(system, input, courses.front().inputs.front().h, 2);

  const auto inputs = static_cast<Eigen::Index>(courses.front().inputs.size());
  const auto records = static_cast<Eigen::Index>(courses.size());
  columns.setZero();
  if (derivatives) {
    by->resize(static_cast<std::size_t>(n));
    for (Eigen::MatrixXd& one : *by) one.setZero(columns.rows(), columns.cols());
  }
  // Column c: of the rate for a pair, column c + 1 (c): of the value.
  const auto put = [&](Eigen::Index row, Eigen::Index c, const Eigen::Vector4d& w) {
    if (!pair) {
      columns(row, c) = w(0);
      if (derivatives) (*by)[0](row, c) = -omega * w(1);
      return;
    }
    columns(row, c) = w(1);
    columns(row, c + 1) = w(0);
    if (!derivatives) return;
    // By a: -s y / M, by b: -y / M, of y and of s y; s^2 g = y - a s g - b g.
    const double g = w(2), sg = w(3), ssg = w(0) - a * sg - b * g;
    (*by)[0](row, c) = -a * ssg - 2.0 * b * sg;
    (*by)[0](row, c + 1) = -a * sg - 2.0 * b * g;
    (*by)[1](row, c) = -a * ssg;
    (*by)[1](row, c + 1) = -a * sg;
  };
  Eigen::Matrix4d phi = Eigen::Matrix4d::Zero();
  phi.topLeftCorner(states, states) = hold.phi;
  Eigen::Matrix<double, 4, 3> gain = Eigen::Matrix<double, 4, 3>::Zero();
  gain.topRows(states) = hold.g;
  Eigen::Index row0 = 0;
  for (Eigen::Index r = 0; r < records; ++r) {
    const Course& course = courses[static_cast<std::size_t>(r)];
    const Eigen::Index count = course.count(whole);
    for (Eigen::Index i = 0; i < inputs; ++i) {
      const Spline& u = course.inputs[static_cast<std::size_t>(i)];
      Eigen::Vector4d w = Eigen::Vector4d::Zero();
      for (Eigen::Index k = 0; k < count; ++k) {
        put(row0 + k, n * i, w);
        w = (phi * w + gain * Eigen::Vector3d(u.value(k), u.first(k), u.second(k))).eval();
      }
    }
    for (int start = 0; start < n; ++start) {
      Eigen::Vector4d w = Eigen::Vector4d::Zero();
      w(start) = 1.0;
      const Eigen::Index c = n * (inputs + r) + start;
      for (Eigen::Index k = 0; k < count; ++k) {
        columns(row0 + k, c) = w(0);
        if (derivatives) {
          if (pair) {
            // But for what the other start has a share in.
            (*by)[0](row0 + k, c) = -a * w(3) - 2.0 * b * w(2);
            (*by)[1](row0 + k, c) = -a * w(3);
          } else {
            (*by)[0](row0 + k, c) = -omega * w(1);
          }
        }
        w = (phi * w).eval();
      }
    }
    row0 += count;
  }
}

/// The least squares problem at a place, over the heads of the records or over all of them.
class Problem {
 public:
  /// The first `share` of every record is fitted.
  Problem(const MultivariableData& data, double share) : data_(data) {
    for (const MultivariableRecord& record : data.records) {
      courses_.push_back(course_of(record, data));
      Course& course = courses_.back();
      course.head = static_cast<Eigen::Index>(share * static_cast<double>(course.size));
    }
    heads_ = target_of(false);
    scale_ = spread(heads_);
  }

  /// What the best coefficients leave of the outputs over their scale, and its derivative by the
  /// place (Kaufman), one block of rows per output.
  struct Left {
    Eigen::MatrixXd coefficients;  // one column per output
    Eigen::MatrixXd residual;      // rows x outputs
    Eigen::MatrixXd jacobian;
  };
  [[nodiscard]] Left solve(const Place& at, bool derivatives) const {
    fill(at, false, derivatives);
    const GramSolver solver(columns_);
    Left out;
    out.residual = heads_;
    out.coefficients.resize(columns_.cols(), outputs());
    for (Eigen::Index j = 0; j < outputs(); ++j)
      out.coefficients.col(j) = solver.take_out(out.residual.col(j));
    out.residual.array().rowwise() /= scale_.transpose();
    if (!derivatives) return out;
    const Eigen::Index rows = heads_.rows();
    out.jacobian.resize(rows * outputs(), static_cast<Eigen::Index>(at.value.size()));
    Eigen::Index first = 0, parameter = 0;
    for (const auto& block : derivatives_) {
      for (const Eigen::MatrixXd& by : block) {
        for (Eigen::Index j = 0; j < outputs(); ++j) {
          Eigen::VectorXd column = by * out.coefficients.col(j).segment(first, by.cols());
          solver.take_out(column);
          out.jacobian.col(parameter).segment(j * rows, rows) = -column / scale_(j);
        }
        ++parameter;
      }
      first += block.front().cols();
    }
    return out;
  }

  /// RMS of what these coefficients leave of every output in free simulation of the records, from
  /// one share of them to another: in the units of the outputs.
  [[nodiscard]] Eigen::ArrayXd judged(const Place& at, const Eigen::MatrixXd& coefficients,
                                      double from, double to) const {
    fill(at, true, false);
    return rms(between(target_of(true) - columns_ * coefficients, from, to));
  }
  /// What each source alone makes of each output there: RMS about the mean, outputs x sources.
  [[nodiscard]] Eigen::ArrayXXd parts_between(const Place& at, const Eigen::MatrixXd& coefficients,
                                              double from, double to) const {
    fill(at, true, false);
    const auto source_of = [&](Eigen::Index input) {
      return data_.source.empty() ? static_cast<int>(input)
                                  : data_.source[static_cast<std::size_t>(input)];
    };
    Eigen::ArrayXXd out(outputs(), source_of(inputs() - 1) + 1);
    for (int source = 0; source < out.cols(); ++source) {
      Eigen::MatrixXd alone = Eigen::MatrixXd::Zero(coefficients.rows(), coefficients.cols());
      Eigen::Index first = 0;
      const auto keep = [&](Eigen::Index width) {
        for (Eigen::Index i = 0; i < inputs(); ++i) {
          if (source_of(i) == source)
            alone.middleRows(first + width * i, width) =
                coefficients.middleRows(first + width * i, width);
        }
        first += width * (inputs() + records());
      };
      for (const bool pair : at.pair) keep(pair ? 2 : 1);
      keep(1);
      out.col(source) = spread(between(columns_ * alone, from, to));
    }
    return out;
  }
  /// RMS of the outputs there about their mean.
  [[nodiscard]] Eigen::ArrayXd spread_between(double from, double to) const {
    return spread(between(target_of(true), from, to));
  }
  [[nodiscard]] Eigen::ArrayXd spread() const { return spread(heads_); }

  static Eigen::ArrayXd rms(const Eigen::MatrixXd& of) {
    return (of.colwise().squaredNorm() / std::max(1.0, static_cast<double>(of.rows())))
        .transpose()
        .array()
        .sqrt();
  }

  void set_scale(const Eigen::ArrayXd& scale) { scale_ = scale; }
  [[nodiscard]] const Eigen::ArrayXd& scale() const { return scale_; }
  [[nodiscard]] Eigen::Index rows() const { return heads_.rows(); }
  [[nodiscard]] Eigen::Index outputs() const { return heads_.cols(); }
  [[nodiscard]] Eigen::Index inputs() const {
    return static_cast<Eigen::Index>(courses_.front().inputs.size());
  }
  [[nodiscard]] Eigen::Index records() const { return static_cast<Eigen::Index>(courses_.size()); }
  [[nodiscard]] double sample_time_s() const { return data_.sample_time_s; }

 private:
  static Eigen::ArrayXd spread(const Eigen::MatrixXd& of) {
    const Eigen::RowVectorXd mean = of.colwise().mean();
    return rms(of.rowwise() - mean).max(std::numeric_limits<double>::min());
  }
  [[nodiscard]] Eigen::Index rows_of(bool whole) const {
    Eigen::Index rows = 0;
    for (const Course& course : courses_) rows += course.count(whole);
    return rows;
  }
  [[nodiscard]] Eigen::MatrixXd target_of(bool whole) const {
    const auto outputs = static_cast<Eigen::Index>(data_.records.front().outputs.size());
    Eigen::MatrixXd out(rows_of(whole), outputs);
    Eigen::Index row = 0;
    for (std::size_t r = 0; r < courses_.size(); ++r) {
      const Eigen::Index count = courses_[r].count(whole);
      for (Eigen::Index j = 0; j < outputs; ++j)
        out.col(j).segment(row, count) =
            data_.records[r].outputs[static_cast<std::size_t>(j)].head(count).matrix();
      row += count;
    }
    return out;
  }
  /// Of every record the rows from one share of it to another.
  [[nodiscard]] Eigen::MatrixXd between(const Eigen::MatrixXd& whole, double from,
                                        double to) const {
    Eigen::MatrixXd out(whole.rows(), whole.cols());
    Eigen::Index row = 0, kept = 0;
    for (const Course& course : courses_) {
      const auto size = static_cast<double>(course.size);
      const auto first = static_cast<Eigen::Index>(from * size);
      const Eigen::Index count = static_cast<Eigen::Index>(to * size) - first;
      out.middleRows(kept, count) = whole.middleRows(row + first, count);
      kept += count;
      row += course.size;
    }
    out.conservativeResize(kept, Eigen::NoChange);
    return out;
  }
  /// Poles one after the other, then the inputs themselves, then an offset per record.
  void fill(const Place& at, bool whole, bool derivatives) const {
    Eigen::Index count = inputs() + records();
    for (const bool pair : at.pair) count += (pair ? 2 : 1) * (inputs() + records());
    columns_.resize(rows_of(whole), count);
    derivatives_.resize(derivatives ? at.pair.size() : 0);
    Eigen::Index c = 0;
    std::size_t value = 0;
    for (std::size_t k = 0; k < at.pair.size(); ++k) {
      const bool pair = at.pair[k];
      const Eigen::Index width = (pair ? 2 : 1) * (inputs() + records());
      fill_block(pair, at.value.data() + value, courses_, whole, columns_.middleCols(c, width),
                 derivatives ? &derivatives_[k] : nullptr);
      value += pair ? 2 : 1;
      c += width;
    }
    columns_.rightCols(inputs() + records()).setZero();
    Eigen::Index row = 0;
    for (Eigen::Index r = 0; r < records(); ++r) {
      const Course& course = courses_[static_cast<std::size_t>(r)];
      const Eigen::Index rows = course.count(whole);
      for (Eigen::Index i = 0; i < inputs(); ++i)
        columns_.col(c + i).segment(row, rows) =
            course.inputs[static_cast<std::size_t>(i)].value.head(rows).matrix();
      columns_.col(c + inputs() + r).segment(row, rows).setOnes();
      row += rows;
    }
  }

  const MultivariableData& data_;
  std::vector<Course> courses_;
  Eigen::MatrixXd heads_;  // outputs
  Eigen::ArrayXd scale_;
  // Megabytes that every evaluation would fetch again.
  mutable Eigen::MatrixXd columns_;
  mutable std::vector<std::vector<Eigen::MatrixXd>> derivatives_;
};

class Cost final : public ceres::CostFunction {
 public:
  Cost(const Problem& problem, std::vector<bool> pair, std::size_t values, int& evaluations)
      : problem_(problem), pair_(std::move(pair)), evaluations_(evaluations) {
    mutable_parameter_block_sizes()->push_back(static_cast<int>(values));
    set_num_residuals(static_cast<int>(problem.rows() * problem.outputs()));
  }
  bool Evaluate(double const* const* x, double* residuals, double** jacobians) const override {
    const auto count = static_cast<std::size_t>(parameter_block_sizes()[0]);
    const bool derivatives = jacobians != nullptr && jacobians[0] != nullptr;
    ++evaluations_;
    const Problem::Left left =
        problem_.solve({pair_, std::vector<double>(x[0], x[0] + count)}, derivatives);
    Eigen::Map<Eigen::MatrixXd>(residuals, left.residual.rows(), left.residual.cols()) =
        left.residual;
    if (derivatives) {
      using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
      Eigen::Map<RowMajor>(jacobians[0], num_residuals(), parameter_block_sizes()[0]) =
          left.jacobian;
    }
    return left.residual.allFinite() && (!derivatives || left.jacobian.allFinite());
  }

 private:
  const Problem& problem_;
  std::vector<bool> pair_;
  int& evaluations_;
};

double fastest(double sample_time_s) { return kShareOfNyquist * std::numbers::pi / sample_time_s; }

/// Levenberg-Marquardt from a place; nothing where it ends nowhere.
std::optional<Place> refined(const Problem& problem, Place at, double tolerance, int& evaluations) {
  ceres::Problem solved;
  solved.AddResidualBlock(new Cost(problem, at.pair, at.value.size(), evaluations), nullptr,
                          at.value.data());
  std::size_t value = 0;
  const auto bound = [&](double lower, double upper) {
    const auto i = static_cast<int>(value);
    at.value[value] = std::clamp(at.value[value], std::log(lower), std::log(upper));
    solved.SetParameterLowerBound(at.value.data(), i, std::log(lower));
    solved.SetParameterUpperBound(at.value.data(), i, std::log(upper));
    ++value;
  };
  for (const bool pair : at.pair) {
    bound(kTwoPi * kSlowest_hz, fastest(problem.sample_time_s()));
    if (pair) bound(kLeastDamping, kMostDamping);
  }
  ceres::Solver::Options options;
  options.linear_solver_type = ceres::DENSE_NORMAL_CHOLESKY;
  options.max_num_iterations = kRounds;
  options.function_tolerance = tolerance;
  options.gradient_tolerance = 1e-30;
  options.logging_type = ceres::SILENT;
  ceres::Solver::Summary summary;
  ceres::Solve(options, &solved, &summary);
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
    for (std::size_t j = 0; j < outputs; ++j) {
      std::vector<ResponseRecord> records;
      for (const MultivariableRecord& record : data.records) {
        const auto head =
            static_cast<Eigen::Index>(share * static_cast<double>(record.inputs[0].size()));
        ResponseRecord one;
        for (const Eigen::ArrayXd& input : record.inputs) one.inputs.push_back(input.head(head));
        one.output = record.outputs[j].head(head);
        records.push_back(std::move(one));
      }
      found.push_back(frequency_response(records, data.sample_time_s));
    }
  } catch (const std::runtime_error&) {
    return std::nullopt;
  }
  // Where any channel says something.
  std::vector<Eigen::Index> places;
  for (const FrequencyResponse& response : found) {
    for (std::size_t i = 0; i < response.channels.size(); ++i) {
      const auto more = response.significant(i, (kLeastTransform - 0.5) / response.window_s,
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
        out.deviation(k, column) = says ? one.deviation(k, 0) : kUnknown * std::max(most, 1e-300);
      }
    }
  }
  return out;
}

/// Where a search of this order begins where no response shows anything: pairs, evenly in log
/// frequency.
Place spread_out(int order, double sample_time_s) {
  std::vector<FittedPole> poles;
  const int pairs = order / 2;
  for (int i = 0; i < pairs; ++i)
    poles.push_back({true, kTwoPi * 2.0 * std::pow(0.05 / sample_time_s, (i + 0.5) / pairs), 0.3});
  if (order % 2 == 1) poles.push_back({false, kTwoPi * 5.0});
  return place_of(poles, fastest(sample_time_s));
}

struct Sought {
  Place at;
  Eigen::ArrayXd scale;
  double cost = 0.0;  // log of what is left, summed over the outputs
};

/// The best place of this order on this problem: from every start twice, the second time with the
/// outputs weighed by what the first left of them.
std::optional<Sought> sought(Problem& problem, const std::vector<Place>& starts, double tolerance,
                             int& evaluations) {
  std::optional<Sought> best;
  const Eigen::ArrayXd spread = problem.spread();
  for (const Place& start : starts) {
    problem.set_scale(spread);
    std::optional<Place> at = start;
    for (int pass = 0; pass < 2 && at; ++pass) {
      at = refined(problem, *at, tolerance, evaluations);
      if (!at) break;
      const Problem::Left left = problem.solve(*at, false);
      const Eigen::ArrayXd rms = Problem::rms(left.residual) * problem.scale();
      problem.set_scale(rms.max(1e-9 * spread));
    }
    if (!at) continue;
    const double cost = (problem.scale() / spread).log().sum();
    if (!std::isfinite(cost) || (best && cost >= best->cost)) continue;
    best = Sought{*at, problem.scale(), cost};
  }
  if (best) problem.set_scale(best->scale);
  return best;
}

using Starts = std::vector<std::vector<FittedPole>>;  // by order, from 1

Starts starts_within(const MultivariableData& data, double share, int most) {
  const auto points = responses(data, share);
  return points ? starting_poles(*points, most) : Starts{};
}

std::vector<Place> starts_of(const Starts& by_order, int order, const std::vector<Place>& more,
                             double sample_time_s) {
  std::vector<Place> out = more;
  if (static_cast<std::size_t>(order) <= by_order.size())
    out.push_back(place_of(by_order[static_cast<std::size_t>(order) - 1], fastest(sample_time_s)));
  if (out.empty()) out.push_back(spread_out(order, sample_time_s));
  return out;
}

void check(const MultivariableData& data, const MultivariableOptions& options) {
  if (data.records.empty() || data.records.front().inputs.empty() ||
      data.records.front().outputs.empty())
    throw std::runtime_error("a multivariable fit needs a record, an input and an output");
  if (!(options.training_share > 0.1 && options.training_share < 0.95))
    throw std::runtime_error("the training share must lie between 0.1 and 0.95");
  if (options.order < 0 || options.order > kMostPoles || options.most < 1 ||
      options.most > kMostPoles)
    throw std::runtime_error("the order must lie between 1 and " + std::to_string(kMostPoles));
  for (std::size_t i = 0; i < data.records.front().inputs.size(); ++i) {
    double least = std::numeric_limits<double>::max(), most = -least;
    for (const MultivariableRecord& record : data.records) {
      least = std::min(least, record.inputs[i].minCoeff());
      most = std::max(most, record.inputs[i].maxCoeff());
    }
    if (!(most > least))
      throw std::runtime_error("input " + std::to_string(i + 1) +
                               " never changes: nothing can be said of what it does");
  }
}

}  // namespace

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

MultivariableFit identify_multivariable(const MultivariableData& data,
                                        const MultivariableOptions& options) {
  check(data, options);
  MultivariableFit out;
  const double h = data.sample_time_s;
  const auto enough = [&](const Problem& problem, int order) {
    const Eigen::Index columns =
        order * (problem.inputs() + problem.records()) + problem.inputs() + problem.records();
    return problem.rows() > kRowsPerColumn * columns;
  };

  // The order, within the training data.
  int order = options.order;
  std::vector<Place> found;  // of the order chosen
  if (order == 0) {
    const double share = 2.0 / 3.0 * options.training_share;
    Problem problem(data, share);
    const Eigen::ArrayXd spread = problem.spread_between(share, options.training_share);
    const Starts starts = starts_within(data, share, options.most);
    double least = std::numeric_limits<double>::infinity();
    int futile = 0;
    for (int tried = 1; tried <= options.most && futile < kFutile && enough(problem, tried);
         ++tried) {
      const auto best = sought(problem, starts_of(starts, tried, {}, h), kRough, out.evaluations);
      MultivariableTrial trial{tried, std::numeric_limits<double>::quiet_NaN()};
      if (best) {
        const Problem::Left left = problem.solve(best->at, false);
        const Eigen::ArrayXd rms =
            problem.judged(best->at, left.coefficients, share, options.training_share);
        trial.left = std::exp((rms / spread).max(kExact).log().mean());
      }
      ++futile;
      if (trial.left < kWorthIt * least) {
        least = trial.left;
        order = tried;
        found = {best->at};
        futile = 0;
      }
      out.trials.push_back(trial);
    }
    for (MultivariableTrial& trial : out.trials) trial.chosen = trial.order == order;
  }
  Problem problem(data, options.training_share);
  if (order == 0 || !enough(problem, order))
    throw std::runtime_error("the records are too short: at least " +
                             std::to_string(kRowsPerColumn) +
                             " samples are needed for every coefficient of the simplest fit");
  const Starts starts =
      found.empty() ? starts_within(data, options.training_share, order) : Starts{};
  const auto best = sought(problem, starts_of(starts, order, found, h), kFine, out.evaluations);
  if (!best) throw std::runtime_error("no finite fit of order " + std::to_string(order));

  const Problem::Left left = problem.solve(best->at, true);
  out.scale = problem.scale();
  out.training = Problem::rms(left.residual) * problem.scale();
  out.holdout = problem.judged(best->at, left.coefficients, options.training_share, 1.0);
  out.holdout_outputs = problem.spread_between(options.training_share, 1.0);
  out.parts = problem.parts_between(best->at, left.coefficients, options.training_share, 1.0);
  const Eigen::Map<const Eigen::VectorXd> stacked(left.residual.data(), left.residual.size());
  const Eigen::MatrixXd covariance = robust_covariance(left.jacobian, stacked, h);

  // By frequency.
  struct Found {
    FittedPole pole;
    Eigen::Index first = 0;  // of its coefficients
  };
  std::vector<Found> poles;
  Eigen::Index value = 0, first = 0;
  for (const bool pair : best->at.pair) {
    const auto at = [&](Eigen::Index i) {
      return std::exp(best->at.value[static_cast<std::size_t>(i)]);
    };
    const auto deviation = [&](Eigen::Index i) {
      return at(i) * std::sqrt(std::max(0.0, covariance(i, i)));
    };
    Found one;
    one.pole.pair = pair;
    one.pole.omega = at(value);
    one.pole.omega_deviation = deviation(value);
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
