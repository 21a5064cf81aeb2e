#include "identification/loop/pole_search.h"

#include <ceres/ceres.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>
#include <sstream>

#include "identification/least_squares/bounded.h"
#include "identification/least_squares/chart.h"
#include "identification/least_squares/covariance.h"
#include "identification/least_squares/interruption.h"
#include "identification/least_squares/parallel.h"
#include "identification/recording/motion_range.h"
#include "twin/linear_algebra.h"
#include "twin/two_pi.h"

namespace servotwin {

namespace {

PoleBounds below_nyquist(PoleBounds bounds, double h) {
  const double nyquist = 0.5 / h;
  bounds.real_max_hz = std::min(bounds.real_max_hz, nyquist);
  bounds.omega_max_hz = std::min(bounds.omega_max_hz, nyquist);
  return bounds;
}

// Share of a force that acts through a mode: between 0 and 1 where the encoder is at the same
// place. Without bounds friction may vanish while its effect through a mode goes to infinity.
constexpr double kMinDelta = -1.0, kMaxDelta = 2.0, kMaxGamma = 1.0;
constexpr double kSamplesPerRadian = 1.0;  // of a mode, on thinned data
constexpr double kSlowestMode_hz = 2.0, kMinModeDamping = 5e-4, kMaxModeDamping = 0.95;
constexpr double kModeShareOfNyquist = 0.9;

/// The coordinates of modes: log omega, log zeta, gamma, delta of each.
std::vector<double> coordinates_of(const std::vector<Mode>& modes) {
  std::vector<double> out;
  for (const Mode& m : modes)
    out.insert(out.end(), {std::log(m.omega), std::log(m.zeta), m.gamma, m.delta});
  return out;
}

std::vector<Mode> modes_at(const double* coordinates, std::size_t count) {
  std::vector<Mode> out(count);
  for (Mode& m : out) {
    m.omega = std::exp(*coordinates++);
    m.zeta = std::exp(*coordinates++);
    m.gamma = *coordinates++;
    m.delta = *coordinates++;
  }
  return out;
}

/// The projected residual as one Ceres cost: the parameters are the chart's q, the stretched
/// shapes, where they are free, and the coordinates of the modes, where there are any.
///
/// Levenberg-Marquardt asks a residual r and its Jacobian J for r^T r, J^T r and J^T J only. The
/// triangle of the QR of [J r] has the same ones in one row per parameter and one more, so that the
/// solver does not carry all samples.
class ProjectedCost final : public ceres::CostFunction {
 public:
  ProjectedCost(const Projection& data, Chart chart, const std::vector<ShapeAxis>& axes,
                std::vector<double> held, std::size_t modes, int& evaluations)
      : data_(data),
        chart_(chart),
        axes_(axes),
        held_(std::move(held)),
        modes_(modes),
        evaluations_(evaluations) {
    const int order = data.structure().order;
    shapes_ = held_.empty() ? static_cast<int>(axes.size()) : 0;
    const int of_modes = kModeShapes * static_cast<int>(modes);
    mutable_parameter_block_sizes()->push_back(order);
    if (shapes_ > 0) mutable_parameter_block_sizes()->push_back(shapes_);
    if (of_modes > 0) mutable_parameter_block_sizes()->push_back(of_modes);
    set_num_residuals(order + shapes_ + of_modes + 1);
    // Errors in micrometres or milliradians alike: the solver sees them relative to their own size.
    double sum = 0.0;
    for (const Signals& s : data.segments()) sum += s.error.square().sum();
    if (sum > 0.0) unit_ = std::sqrt(static_cast<double>(data.rows()) / sum);
  }

  [[nodiscard]] double unit() const { return unit_; }

  [[nodiscard]] Point point(double const* const* parameters) const {
    Point at;
    at.denominator = denominator_at(chart_, data_.structure().order, parameters[0]);
    at.shapes = held_;
    if (held_.empty()) {
      for (std::size_t i = 0; i < axes_.size(); ++i)
        at.shapes.push_back(axes_[i].value(parameters[1][i]));
    }
    if (modes_ > 0) at.modes = modes_at(parameters[shapes_ > 0 ? 2 : 1], modes_);
    return at;
  }

  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override {
    const Point at = point(parameters);
    const Eigen::Index rows = num_residuals();
    Eigen::Map<Eigen::VectorXd> out(residuals, rows);
    // Ceres asks for the cost of a step first, which needs no derivatives, and for the Jacobian
    // where the step is taken.
    if (jacobians == nullptr) {
      out.setZero();
      out(rows - 1) = unit_ * std::sqrt(2.0 * data_.solve(at).cost);
      ++evaluations_;
      return std::isfinite(out(rows - 1));
    }
    const Eigen::MatrixXd triangle = this->triangle(at, parameters[0]);
    out = triangle.col(rows - 1);
    Eigen::Index column = 0;
    for (std::size_t block = 0; block < parameter_block_sizes().size(); ++block) {
      const Eigen::Index size = parameter_block_sizes()[block];
      using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
      if (jacobians[block] != nullptr) {
        Eigen::Map<RowMajor>(jacobians[block], rows, size) = triangle.middleCols(column, size);
      }
      column += size;
    }
    return triangle.allFinite();
  }

 private:
  [[nodiscard]] Eigen::MatrixXd triangle(const Point& at, const double* q) const {
    const auto lin = data_.linearise(at);
    const int order = data_.structure().order;
    const Eigen::Index columns = num_residuals();
    Eigen::MatrixXd both(data_.rows(), columns);
    both.leftCols(order) =
        lin.jacobian.leftCols(order) * chart_jacobian(chart_, order, q).topLeftCorner(order, order);
    for (int i = 0; i < shapes_; ++i) {
      const auto k = static_cast<std::size_t>(i);
      both.col(order + i) =
          lin.jacobian.col(order + i) * (axes_[k].logarithmic ? at.shapes[k] : 1.0);
    }
    const Eigen::Index by_modes = kModeShapes * static_cast<Eigen::Index>(modes_);
    if (by_modes > 0) both.middleCols(order + shapes_, by_modes) = lin.jacobian.rightCols(by_modes);
    for (std::size_t i = 0; i < modes_; ++i) {
      const Eigen::Index c = order + shapes_ + kModeShapes * static_cast<Eigen::Index>(i);
      both.col(c) *= at.modes[i].omega;
      both.col(c + 1) *= at.modes[i].zeta;
    }
    both.col(columns - 1) = lin.at.residual;
    both *= unit_;
    return triangle_of(both);
  }

  const Projection& data_;
  Chart chart_;
  const std::vector<ShapeAxis>& axes_;
  std::vector<double> held_;
  std::size_t modes_;
  int shapes_ = 0;
  int& evaluations_;
  double unit_ = 1.0;
};

/// e = lag * v on average: start value of the search for a delay.
double mean_lag_s(const std::vector<Signals>& segments) {
  double product = 0.0, square = 0.0;
  for (const Signals& s : segments) {
    product += (s.error * s.command.first).sum();
    square += s.command.first.square().sum();
  }
  return square > 0.0 ? product / square : 0.0;
}

struct Candidate {
  Point point;
  double cost = 0.0;
  bool converged = false;  // to an optimum of the data
};

PoleSet first_inside(const Loop& loop, const PoleBounds& bounds) {
  if (auto set = inside(loop, bounds)) return *set;
  // The pole set closest to the box, moved onto it.
  const PoleLabels labels = labels_of(loop);
  PoleSet best;
  double distance = 1e300;
  for (int i = 0; i < labels.count; ++i) {
    const PoleSet& set = labels.set[static_cast<std::size_t>(i)];
    PoleSet moved;
    moved.real = std::clamp(set.real, bounds.real_min_hz * kTwoPi, bounds.real_max_hz * kTwoPi);
    moved.omega = std::clamp(set.omega, bounds.omega_min_hz * kTwoPi, bounds.omega_max_hz * kTwoPi);
    moved.zeta = std::clamp(set.zeta, bounds.zeta_min, bounds.zeta_max);
    const auto apart = [](double a, double b) {
      return std::abs(std::log(std::max(a, 1e-9) / std::max(b, 1e-9)));
    };
    const double d = (loop.order == 3 ? apart(set.real, moved.real) : 0.0) +
                     apart(set.omega, moved.omega) + apart(set.zeta, moved.zeta);
    if (d < distance) distance = d, best = moved;
  }
  return best;
}

/// Levenberg-Marquardt from one candidate.
Candidate refine(const Projection& data, Chart chart, const Candidate& from,
                 const PoleBounds& bounds, const PoleSearchOptions& search, int rounds,
                 int& evaluations) {
  const int order = data.structure().order;
  const std::vector<ShapeAxis> axes =
      shape_axes(data.structure().effects, length_scale(data.segments()));
  Loop loop;
  loop.order = order;
  loop.denominator = from.point.denominator;
  const PoleSet named = chart == Chart::kPoles ? first_inside(loop, bounds) : PoleSet{};
  std::vector<double> q = chart_of(chart, order, from.point.denominator, named);
  std::vector<double> shapes = from.point.shapes;
  const bool free_shapes = search.search_shapes && !axes.empty();
  if (free_shapes) {
    for (std::size_t i = 0; i < axes.size(); ++i) {
      shapes[i] = axes[i].coordinate(shapes[i]);
    }
  }

  ceres::Problem problem;
  auto* cost = new ProjectedCost(data, chart, axes, free_shapes ? std::vector<double>{} : shapes,
                                 from.point.modes.size(), evaluations);
  std::vector<double> modes = coordinates_of(from.point.modes);
  std::vector<double*> blocks{q.data()};
  if (free_shapes) blocks.push_back(shapes.data());
  if (!modes.empty()) blocks.push_back(modes.data());
  problem.AddResidualBlock(cost, nullptr, blocks);  // the problem owns the cost
  if (free_shapes) {
    for (std::size_t i = 0; i < axes.size(); ++i) {
      problem.SetParameterLowerBound(shapes.data(), static_cast<int>(i), axes[i].lower);
      problem.SetParameterUpperBound(shapes.data(), static_cast<int>(i), axes[i].upper);
    }
  }
  const double fastest = kModeShareOfNyquist * std::numbers::pi / data.segments().front().h;
  for (std::size_t i = 0; i < modes.size(); i += kModeShapes) {
    const auto within = [&](std::size_t k, double lower, double upper) {
      problem.SetParameterLowerBound(modes.data(), static_cast<int>(k), std::log(lower));
      problem.SetParameterUpperBound(modes.data(), static_cast<int>(k), std::log(upper));
      modes[k] = std::clamp(modes[k], std::log(lower), std::log(upper));
    };
    within(i, kTwoPi * kSlowestMode_hz, fastest);
    within(i + 1, kMinModeDamping, kMaxModeDamping);
    const auto between = [&](std::size_t k, double lower, double upper) {
      problem.SetParameterLowerBound(modes.data(), static_cast<int>(k), lower);
      problem.SetParameterUpperBound(modes.data(), static_cast<int>(k), upper);
      modes[k] = std::clamp(modes[k], lower, upper);
    };
    const double period = std::exp(-modes[i]);
    between(i + 2, -kMaxGamma * period, kMaxGamma * period);
    between(i + 3, kMinDelta, kMaxDelta);
  }
  if (chart == Chart::kPoles) {
    const auto box = [&](int i, double lower, double upper) {
      problem.SetParameterLowerBound(q.data(), i, std::log(lower));
      problem.SetParameterUpperBound(q.data(), i, std::log(upper));
      q[static_cast<std::size_t>(i)] =
          std::clamp(q[static_cast<std::size_t>(i)], std::log(lower), std::log(upper));
    };
    if (order == 3) box(0, bounds.real_min_hz * kTwoPi, bounds.real_max_hz * kTwoPi);
    box(order - 2, bounds.omega_min_hz * kTwoPi, bounds.omega_max_hz * kTwoPi);
    box(order - 1, bounds.zeta_min, bounds.zeta_max);
  }
  // Few columns, well scaled by Ceres.
  ceres::Solver::Options options =
      bounded_options(ceres::DENSE_NORMAL_CHOLESKY, rounds, search.tolerance);
  options.gradient_tolerance = 1e-30;  // the relative decrease alone decides
  // Damped at first, and no search along the step: a whole step of Gauss and Newton from a start
  // that is far off leads to another optimum, and to which one is chance.
  options.initial_trust_region_radius = 1.0;
  options.max_num_line_search_step_size_iterations = 0;
  // A step that changes the parameters by this share of them changes the cost by less than its
  // tolerance, unless the derivatives are wrong there: then a smaller one does not help.
  options.parameter_tolerance = 1e-3 * std::sqrt(search.tolerance);
  const ceres::Solver::Summary summary = solve_bounded(options, problem);

  Candidate out;
  out.point = cost->point(blocks.data());
  out.cost =
      summary.IsSolutionUsable() ? summary.final_cost / (cost->unit() * cost->unit()) : 1e300;
  out.converged = summary.termination_type == ceres::CONVERGENCE;
  return out;
}

/// The grid: pairs with zeta <= 1 and a real pole, and sorted real triples.
std::vector<std::array<double, kMaxOrder>> grid(int order, const PoleBounds& b) {
  const auto points = [](double low, double high, int count) {
    std::vector<double> out;
    for (int i = 0; i < count; ++i) {
      out.push_back(std::exp(std::log(low) + (std::log(high) - std::log(low)) * (i + 0.5) / count));
    }
    return out;
  };
  std::vector<std::array<double, kMaxOrder>> out;
  const auto omegas = points(b.omega_min_hz * kTwoPi, b.omega_max_hz * kTwoPi, order == 2 ? 14 : 8);
  const auto zetas = points(b.zeta_min, std::min(b.zeta_max, 1.0), order == 2 ? 6 : 4);
  if (order == 2) {
    for (double omega : omegas) {
      for (double zeta : zetas) out.push_back(denominator_of({0.0, omega, zeta}, 2));
    }
    if (b.zeta_max > 1.0) {
      for (double omega : omegas)
        out.push_back(denominator_of({0.0, omega, std::sqrt(b.zeta_max)}, 2));
    }
    return out;
  }
  const auto reals = points(b.real_min_hz * kTwoPi, b.real_max_hz * kTwoPi, 8);
  for (double real : reals) {
    for (double omega : omegas) {
      for (double zeta : zetas) out.push_back(denominator_of({real, omega, zeta}, 3));
    }
  }
  for (std::size_t i = 0; i < reals.size(); ++i) {
    for (std::size_t j = i + 1; j < reals.size(); ++j) {
      for (std::size_t k = j + 1; k < reals.size(); ++k) {
        Loop loop;
        const double omega = std::sqrt(reals[j] * reals[k]);
        loop.denominator =
            denominator_of({reals[i], omega, (reals[j] + reals[k]) / (2.0 * omega)}, 3);
        if (inside(loop, b)) out.push_back(loop.denominator);
      }
    }
  }
  return out;
}

}  // namespace

std::string why_invalid(const PoleBounds& b) {
  const auto pair = [](const char* name, double low, double high) -> std::string {
    if (low > 0.0 && low < high && std::isfinite(high)) return {};
    std::ostringstream out;
    out << name << ": " << low << " .. " << high << " must be positive, the lower below the upper";
    return out.str();
  };
  if (auto why = pair("real pole bounds [Hz]", b.real_min_hz, b.real_max_hz); !why.empty())
    return why;
  if (auto why = pair("natural frequency bounds [Hz]", b.omega_min_hz, b.omega_max_hz);
      !why.empty())
    return why;
  return pair("damping ratio bounds", b.zeta_min, b.zeta_max);
}

std::optional<PoleSet> inside(const Loop& loop, const PoleBounds& b, double tolerance) {
  const PoleLabels labels = labels_of(loop);
  const auto within = [tolerance](double value, double low, double high) {
    return value >= low * (1.0 - tolerance) && value <= high * (1.0 + tolerance);
  };
  for (int i = 0; i < labels.count; ++i) {
    const PoleSet& set = labels.set[static_cast<std::size_t>(i)];
    const bool real = loop.order == 2 || within(set.real / kTwoPi, b.real_min_hz, b.real_max_hz);
    if (real && within(set.omega / kTwoPi, b.omega_min_hz, b.omega_max_hz) &&
        within(set.zeta, b.zeta_min, b.zeta_max)) {
      return set;
    }
  }
  return std::nullopt;
}

Projection thinned(const std::vector<Signals>& segments, const Structure& structure, double step_s,
                   bool free_response) {
  Eigen::Index rows = 0;
  for (const Signals& s : segments) rows += s.size();
  int every = static_cast<int>(std::floor(step_s / segments.front().h + 1e-9));
  while (every > 1 && rows / every < 1000) --every;
  std::vector<Signals> thin;
  for (const Signals& s : segments) thin.push_back(decimated(s, every));
  return {std::move(thin), structure, free_response};
}

Projection thinned(const Projection& data, double step_s) {
  return thinned(data.segments(), data.structure(), step_s, data.has_free_response());
}

std::optional<PoleFit> pole_search(const Projection& data, const PoleSearchOptions& options) {
  if (data.segments().empty() || data.rows() < 50) return std::nullopt;
  const int order = data.structure().order;
  const double h = data.segments().front().h;
  const PoleBounds bounds = below_nyquist(options.bounds, h);

  std::vector<double> shapes = options.shapes;
  if (shapes.empty()) {
    const double scale = length_scale(data.segments());
    for (std::size_t kind : data.structure().effects) {
      for (const Parameter& of_machines : shapes_of(kind)) {
        const Parameter p = stretched(of_machines, scale);
        const bool delay = identity_of(kind).acts == Acts::kCommandDelay;
        shapes.push_back(delay ? std::clamp(mean_lag_s(data.segments()), p.lower, p.upper)
                               : p.start);
      }
    }
  }

  // Thinned data for the coarse search; command splines and filters stay exact at any step.
  // Friction with memory needs enough samples at reversals.
  double step_s = options.from.empty() ? 8.0e-3 : 2.0e-3;
  const auto show = [&](const std::vector<Mode>& modes) {
    for (const Mode& mode : modes) step_s = std::min(step_s, kSamplesPerRadian / mode.omega);
  };
  show(options.modes);
  for (const Point& point : options.from) show(point.modes);
  const Projection coarse = thinned(data, step_s);
  PoleSearchOptions ranking = options;
  ranking.tolerance = std::max(options.tolerance, 1e-6);

  PoleFit fit;
  std::vector<Candidate> candidates, clamped;
  if (options.from.empty()) {
    for (const auto& denominator : grid(order, bounds)) {
      throw_if_interrupted();
      Candidate candidate;
      candidate.point = {denominator, shapes, options.modes};
      const auto solution = coarse.solve(candidate.point);
      ++fit.evaluations;
      if (!std::isfinite(solution.cost)) continue;
      candidate.cost = solution.cost;
      // Candidates that need negative friction are excluded (thesis 3.7), unless all of them do.
      (solution.clamped ? clamped : candidates).push_back(std::move(candidate));
    }
    if (candidates.empty()) candidates = std::move(clamped);
  }
  std::sort(candidates.begin(), candidates.end(),
            [](const auto& l, const auto& r) { return l.cost < r.cost; });

  const auto apart = [order](const Candidate& l, const Candidate& r) {
    double most = 0.0;
    for (int i = 0; i < order; ++i) {
      const auto k = static_cast<std::size_t>(i);
      most = std::max(most, std::abs(std::log(l.point.denominator[k] / r.point.denominator[k])));
    }
    return most;
  };
  std::vector<Candidate> refined;
  std::vector<Candidate> seeds;
  for (const Candidate& candidate : candidates) {
    if (static_cast<int>(seeds.size()) >= options.starts) break;
    const bool fresh = std::all_of(seeds.begin(), seeds.end(),
                                   [&](const auto& s) { return apart(s, candidate) > 0.4; });
    if (fresh) seeds.push_back(candidate);
  }
  for (const Point& point : options.from) seeds.push_back({point});
  refined.resize(seeds.size());
  std::vector<int> evaluations(seeds.size());
  in_parallel(seeds.size(), [&](std::size_t i) {
    refined[i] = refine(coarse, Chart::kStable, seeds[i], bounds, ranking, 40, evaluations[i]);
  });
  fit.evaluations = std::accumulate(evaluations.begin(), evaluations.end(), fit.evaluations);
  if (refined.empty()) return std::nullopt;
  std::sort(refined.begin(), refined.end(),
            [](const auto& l, const auto& r) { return l.cost < r.cost; });

  // The best fits to the thinned data, without duplicates, refined on all data.
  std::vector<Candidate> finals;
  std::vector<Candidate> used;
  for (const Candidate& candidate : refined) {
    if (candidate.cost > 1.2 * refined.front().cost || finals.size() >= 2) break;
    if (std::any_of(used.begin(), used.end(),
                    [&](const auto& u) { return apart(u, candidate) < 0.02; }))
      continue;
    used.push_back(candidate);
    // Where nothing was left out, this is the fit to all data already.
    const bool ended = coarse.rows() == data.rows() && candidate.converged &&
                       ranking.tolerance == options.tolerance;
    finals.push_back(
        ended ? candidate
              : refine(data, Chart::kStable, candidate, bounds, options, 60, fit.evaluations));
  }
  std::sort(finals.begin(), finals.end(),
            [](const auto& l, const auto& r) { return l.cost < r.cost; });
  Candidate best = finals.front();

  Loop loop;
  loop.order = order;
  loop.denominator = best.point.denominator;
  if (!inside(loop, bounds)) {
    // The optimum is outside the box: search inside it, from there and from the best grid points.
    std::vector<Candidate> from{best};
    from.insert(
        from.end(), seeds.begin(),
        seeds.begin() + static_cast<std::ptrdiff_t>(std::min<std::size_t>(2, seeds.size())));
    Candidate within;
    within.cost = 1e300;
    for (const Candidate& start : from) {
      Candidate other = refine(coarse, Chart::kPoles, start, bounds, ranking, 40, fit.evaluations);
      if (other.cost < within.cost) within = std::move(other);
    }
    best = refine(data, Chart::kPoles, within, bounds, options, 60, fit.evaluations);
    loop.denominator = best.point.denominator;
    fit.on_bound = true;
  }
  if (!(best.cost < 1e300)) return std::nullopt;
  fit.point = best.point;
  fit.solution = data.solve(best.point);
  fit.poles = first_inside(loop, bounds);
  return fit;
}

Eigen::MatrixXd covariance(const Projection& data, const PoleFit& fit) {
  return robust_covariance(data.full_jacobian(fit.point, fit.solution.linear),
                           fit.solution.residual, data.segments().front().h);
}

double condition_number(const Projection& data, const Point& point) {
  Eigen::MatrixXd r = data.regressors(point);
  r.leftCols(data.structure().order) *=
      1e3;  // command columns in mm; force columns per unit force carry no length
  Eigen::Index kept = 0;
  for (Eigen::Index c = 0; c < r.cols(); ++c) {
    if (r.col(c).squaredNorm() > 0.0) r.col(kept++) = r.col(c);
  }
  r.conservativeResize(Eigen::NoChange, kept);
  if (kept == 0) return std::numeric_limits<double>::infinity();
  // From the R of a QR: the tall matrix itself needs no SVD.
  const Eigen::VectorXd singular = singular_values(triangle_of(r));
  return singular(singular.size() - 1) > 0.0 ? singular(0) / singular(singular.size() - 1)
                                             : std::numeric_limits<double>::infinity();
}

}  // namespace servotwin
