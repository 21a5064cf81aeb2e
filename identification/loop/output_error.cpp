#include "identification/loop/output_error.h"

#include <ceres/ceres.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <span>

#include "identification/least_squares/bounded.h"
#include "identification/least_squares/chart.h"
#include "identification/least_squares/covariance.h"
#include "identification/least_squares/jackknife.h"
#include "identification/least_squares/parallel.h"
#include "identification/recording/motion_range.h"
#include "twin/difference.h"
#include "twin/twin.h"
#include "twin/two_mass_axis.h"

namespace servotwin {

namespace {

// With play the error jumps where a contact moves past another: after a few rounds it hardly falls
// any more, and each takes a few simulations per parameter.
constexpr int kMaxRoundsOfPlay = 6;
constexpr double kInfinite = std::numeric_limits<double>::infinity();

/// - log P(r) above its least value, as half a square: the residual that least squares needs.
class ReadingLikelihood {
 public:
  ReadingLikelihood(double encoder_step, double sigma)
      : half_(0.5 * encoder_step / sigma), sigma_(sigma) {
    least_ = minus_log(0.0);
    const double density = std::exp(-0.5 * half_ * half_) / std::sqrt(2.0 * std::numbers::pi);
    const double inside = std::erf(half_ / std::numbers::sqrt2);
    curvature_ = half_ > 1e-3 ? 2.0 * half_ * density / inside : 1.0;
  }
  /// - log P per sample, with the constants that depend on sigma.
  [[nodiscard]] double minus_log_likelihood(double r) const {
    return minus_log(std::abs(r) / sigma_) +
           (half_ > 1e-3 ? 0.0 : std::log(sigma_ * std::sqrt(2.0 * std::numbers::pi)));
  }
  [[nodiscard]] double residual(double r) const {
    const double size = std::sqrt(2.0 * std::max(0.0, minus_log(std::abs(r) / sigma_) - least_));
    return r < 0.0 ? -size : size;
  }
  /// d residual / d r.
  [[nodiscard]] double slope(double r) const {
    const double size = std::abs(residual(r));
    if (size < 1e-5) return std::sqrt(curvature_) / sigma_;
    return score(std::abs(r) / sigma_) / size / sigma_;
  }

 private:
  static double log_tail(double t) {  // log Phi(-t)
    if (t < 6.0) return std::log(0.5 * std::erfc(t / std::numbers::sqrt2));
    const double u = 1.0 / (t * t);
    return -0.5 * t * t - std::log(t * std::sqrt(2.0 * std::numbers::pi)) +
           std::log1p(-u * (1.0 - 3.0 * u * (1.0 - 5.0 * u)));
  }
  /// t = |r| / sigma.
  [[nodiscard]] double minus_log(double t) const {
    if (half_ <= 1e-3) return 0.5 * t * t;
    // Phi(half - t) - Phi(-half - t): two tails of one side.
    const double near = log_tail(t - half_), far = log_tail(t + half_);
    return -(near + std::log1p(-std::exp(std::min(0.0, far - near))));
  }
  /// d minus_log / dt.
  [[nodiscard]] double score(double t) const {
    if (half_ <= 1e-3) return t;
    const auto log_density = [](double z) {
      return -0.5 * z * z - 0.5 * std::log(2.0 * std::numbers::pi);
    };
    const double log_p = -minus_log(t);
    return std::exp(log_density(t - half_) - log_p) - std::exp(log_density(t + half_) - log_p);
  }

  double half_, sigma_, least_ = 0.0, curvature_ = 1.0;
};

/// Between a model of the structure and its coordinates: numerator, coefficients, chart, shapes.
class Coordinates {
 public:
  Coordinates(const Structure& structure, const Model& start, double length_scale)
      : structure_(structure),
        template_(start),
        length_scale_(length_scale),
        axes_(shape_axes(structure.effects, length_scale)) {
    for (std::size_t i = 0; i < structure.effects.size(); ++i) {
      // A limit takes away all of the torque beyond it. Left free, the share would trade with the
      // limit and the viscous friction, and the model would be wrong in larger moves.
      if (limits_motor(structure.effects[i])) {
        template_.effects[i].coefficient[0] = 1.0;
        continue;
      }
      const auto coefficients = coefficients_of(structure.effects[i]);
      for (std::size_t c = 0; c < coefficients.size(); ++c) {
        if (told_from_loop(coefficients[c], structure.order) || structure.every_coefficient)
          slots_.push_back({i, c});
      }
    }
    numerators_ = structure.order - (structure.matched_feedforward ? 1 : 0);
  }

  [[nodiscard]] Eigen::VectorXd of(const Model& model) const {
    std::vector<double> x;
    for (int i = 0; i < numerators_; ++i)
      x.push_back(model.loop.numerator[static_cast<std::size_t>(i)]);
    for (const Slot& slot : slots_)
      x.push_back(model.effects[slot.effect].coefficient[slot.coefficient]);
    for (double q : chart_of(Chart::kStable, structure_.order, model.loop.denominator, {}))
      x.push_back(q);
    std::size_t axis = 0;
    for (std::size_t i = 0; i < structure_.effects.size(); ++i) {
      for (std::size_t p = 0; p < shapes_of(structure_.effects[i]).size(); ++p)
        x.push_back(axes_[axis++].coordinate(model.effects[i].shape[p]));
    }
    for (const Mode& m : model.loop.modes)
      x.insert(x.end(), {m.alpha, m.beta, std::log(m.omega), std::log(m.zeta), m.gamma, m.delta});
    if (structure_.moving) {
      for (const Mode& m : model.loop.modes) x.insert(x.end(), {m.slope, m.curve, m.zeta_slope});
    }
    return Eigen::Map<Eigen::VectorXd>(x.data(), static_cast<Eigen::Index>(x.size()));
  }

  [[nodiscard]] Model model(const double* x) const {
    Model out = template_;
    for (int i = 0; i < numerators_; ++i) out.loop.numerator[static_cast<std::size_t>(i)] = *x++;
    for (const Slot& slot : slots_) out.effects[slot.effect].coefficient[slot.coefficient] = *x++;
    out.loop.denominator = denominator_at(Chart::kStable, structure_.order, x);
    x += structure_.order;
    std::size_t axis = 0;
    for (std::size_t i = 0; i < structure_.effects.size(); ++i) {
      for (std::size_t p = 0; p < shapes_of(structure_.effects[i]).size(); ++p)
        out.effects[i].shape[p] = axes_[axis++].value(*x++);
    }
    for (Mode& m : out.loop.modes) {
      m = {std::exp(x[2]), std::exp(x[3]), x[0], x[1], x[4], x[5], m.slope, m.curve, m.zeta_slope};
      x += kModeCoordinates;
    }
    for (Mode& m : out.loop.modes) {
      if (!structure_.moving) break;
      m.slope = *x++;
      m.curve = *x++;
      m.zeta_slope = *x++;
    }
    return out;
  }

  /// Bounds of the coordinates: the physical ones.
  [[nodiscard]] std::pair<double, double> bounds(Eigen::Index i) const {
    const auto k = static_cast<std::size_t>(i) - static_cast<std::size_t>(numerators_);
    if (i < numerators_) return {-1e300, 1e300};
    if (k < slots_.size()) {
      const Parameter p =
          stretched(coefficients_of(structure_.effects[slots_[k].effect])[slots_[k].coefficient],
                    length_scale_);
      return {p.lower, p.upper};
    }
    const auto shape = k - slots_.size();
    if (shape < static_cast<std::size_t>(structure_.order)) return {-1e300, 1e300};
    const std::size_t at = shape - static_cast<std::size_t>(structure_.order);
    if (at < axes_.size()) return {axes_[at].lower, axes_[at].upper};
    const auto of_modes = at - axes_.size();
    if (of_modes >=
        static_cast<std::size_t>(kModeCoordinates) * static_cast<std::size_t>(structure_.modes))
      return {-kMaxModeTravel, kMaxModeTravel};
    if (of_modes % kModeCoordinates == 3) return {-1e300, std::log(kMaxDamping)};
    return {-1e300, 1e300};
  }

  /// The coordinates that are not those of these effects.
  [[nodiscard]] std::vector<std::size_t> without(const std::vector<std::size_t>& held) const {
    const auto is_held = [&](std::size_t effect) {
      return std::find(held.begin(), held.end(), effect) != held.end();
    };
    std::vector<bool> free(static_cast<std::size_t>(numerators_), true);
    for (const Slot& slot : slots_) free.push_back(!is_held(slot.effect));
    free.resize(free.size() + static_cast<std::size_t>(structure_.order), true);
    for (std::size_t i = 0; i < structure_.effects.size(); ++i)
      free.resize(free.size() + shapes_of(structure_.effects[i]).size(), !is_held(i));
    free.resize(static_cast<std::size_t>(of(template_).size()), true);
    std::vector<std::size_t> out;
    for (std::size_t i = 0; i < free.size(); ++i) {
      if (free[i]) out.push_back(i);
    }
    return out;
  }

  /// d model / d coordinate at x, of every coordinate: models whose parameters are the derivatives.
  [[nodiscard]] std::vector<Model> directions(const double* x) const {
    std::vector<Model> out;
    const auto along = [&](const auto& set) {
      out.push_back(empty_like<double>(template_));
      set(out.back());
    };
    for (int i = 0; i < numerators_; ++i)
      along([&](Model& d) { d.loop.numerator[static_cast<std::size_t>(i)] = 1.0; });
    x += numerators_;
    for (const Slot& slot : slots_)
      along([&](Model& d) { d.effects[slot.effect].coefficient[slot.coefficient] = 1.0; });
    x += slots_.size();
    const Eigen::Matrix3d by_chart = chart_jacobian(Chart::kStable, structure_.order, x);
    for (int j = 0; j < structure_.order; ++j) {
      along([&](Model& d) {
        for (int i = 0; i < structure_.order; ++i)
          d.loop.denominator[static_cast<std::size_t>(i)] = by_chart(i, j);
      });
    }
    x += structure_.order;
    std::size_t axis = 0;
    for (std::size_t i = 0; i < structure_.effects.size(); ++i) {
      for (std::size_t p = 0; p < shapes_of(structure_.effects[i]).size(); ++p, ++axis, ++x) {
        const double slope = axes_[axis].logarithmic ? axes_[axis].value(*x) : 1.0;
        along([&](Model& d) { d.effects[i].shape[p] = slope; });
      }
    }
    for (std::size_t m = 0; m < template_.loop.modes.size(); ++m, x += kModeCoordinates) {
      along([&](Model& d) { d.loop.modes[m].alpha = 1.0; });
      along([&](Model& d) { d.loop.modes[m].beta = 1.0; });
      along([&](Model& d) { d.loop.modes[m].omega = std::exp(x[2]); });
      along([&](Model& d) { d.loop.modes[m].zeta = std::exp(x[3]); });
      along([&](Model& d) { d.loop.modes[m].gamma = 1.0; });
      along([&](Model& d) { d.loop.modes[m].delta = 1.0; });
    }
    for (std::size_t m = 0; structure_.moving && m < template_.loop.modes.size(); ++m) {
      along([&](Model& d) { d.loop.modes[m].slope = 1.0; });
      along([&](Model& d) { d.loop.modes[m].curve = 1.0; });
      along([&](Model& d) { d.loop.modes[m].zeta_slope = 1.0; });
    }
    return out;
  }

  /// d parameters / d coordinates at x, with the parameters in the order of the covariance (every
  /// numerator, coefficients, alpha and beta of every mode, a1..an, shapes, omega, zeta, gamma,
  /// delta of every mode, slope, curve and zeta_slope of every one that moves).
  [[nodiscard]] Eigen::MatrixXd parameters_by_coordinates(const Eigen::VectorXd& x) const {
    std::vector<double> all;
    const std::vector<Model> along = directions(x.data());
    for (const Model& d : along) {
      const auto order = static_cast<std::size_t>(structure_.order);
      all.insert(all.end(), d.loop.numerator.begin(), d.loop.numerator.begin() + structure_.order);
      for (const Slot& slot : slots_)
        all.push_back(d.effects[slot.effect].coefficient[slot.coefficient]);
      for (const Mode& m : d.loop.modes) all.insert(all.end(), {m.alpha, m.beta});
      for (std::size_t i = 0; i < order; ++i) all.push_back(d.loop.denominator[i]);
      for (const Effect& effect : d.effects) {
        for (std::size_t p = 0; p < shapes_of(effect.kind).size(); ++p)
          all.push_back(effect.shape[p]);
      }
      for (const Mode& m : d.loop.modes) all.insert(all.end(), {m.omega, m.zeta, m.gamma, m.delta});
      for (const Mode& m : d.loop.modes) {
        if (structure_.moving) all.insert(all.end(), {m.slope, m.curve, m.zeta_slope});
      }
    }
    const auto columns = static_cast<Eigen::Index>(along.size());
    return Eigen::Map<Eigen::MatrixXd>(all.data(), static_cast<Eigen::Index>(all.size()) / columns,
                                       columns);
  }

 private:
  // alpha, beta, log omega, log zeta, gamma, delta
  static constexpr int kModeCoordinates = 6;
  static constexpr double kMaxDamping = 0.95;
  struct Slot {
    std::size_t effect = 0, coefficient = 0;
  };
  const Structure& structure_;
  Model template_;
  double length_scale_;
  std::vector<ShapeAxis> axes_;
  std::vector<Slot> slots_;
  int numerators_ = 0;
};

/// The sigma under which these residuals are most probable.
double most_probable_sigma(const Eigen::VectorXd& r, double encoder_step) {
  const double rms = std::sqrt(r.squaredNorm() / static_cast<double>(r.size()));
  if (encoder_step < 1e-3 * rms) return rms;
  double best = rms, least = 1e300;
  // The readings do not determine a sigma below a hundredth of a step.
  for (double sigma = 0.01 * encoder_step; sigma < 1.3 * rms + 0.02 * encoder_step; sigma *= 1.15) {
    const ReadingLikelihood likelihood(encoder_step, sigma);
    double sum = 0.0;
    for (double value : r) sum += likelihood.minus_log_likelihood(value);
    if (sum < least) least = sum, best = sigma;
  }
  return best;
}

/// With play a fit ends in a better optimum by differences: they see past the next contact.
Simulated by_differences(const Model& model, std::span<const Model> directions,
                         const Segment& segment, Outputs outputs) {
  Simulated out;
  out.error = simulate(model, segment, outputs);
  out.by.resize(out.error.size(), static_cast<Eigen::Index>(directions.size()));
  for (std::size_t i = 0; i < directions.size(); ++i)
    out.by.col(static_cast<Eigen::Index>(i)) =
        difference(model, directions[i], segment, outputs, out.error);
  return out;
}

/// What is missed, with its derivatives by the coordinates; 0 by those that are not free.
struct Missed {
  Eigen::VectorXd r;  ///< empty if the model is not valid
  Eigen::MatrixXd by;
};

/// Of the motor, from which on they count: fewer do not tell how well it is simulated.
constexpr std::ptrdiff_t kFewestReadings = 300;
/// Deviation of the motor's readings over that of the recorded encoder's, at least: readings that
/// are all of one rest, on one step, would have none.
constexpr double kMinMotorSigmaRatio = 1e-2;

/// What the encoders of some segments say of a model: of the recorded one, and on an axis of two
/// masses also of the motor's where every segment has it. One row per sample that counts (those
/// that determine the starting state do not) and output, in turns. The zeros of the two encoders
/// are not the same: the motor's is where its rows have the mean 0.
class Readings {
 public:
  Readings(const std::vector<Segment>& segments, const Model& start) : segments_(segments) {
    if (!segments.empty()) settled_ = starting_state_samples(start, segments.front());
    const bool both = !segments.empty() && two_mass_of(start) != nullptr &&
                      std::all_of(segments.begin(), segments.end(), [](const Segment& s) {
                        return s.actual_motor.size() == s.size();
                      });
    if (both) {
      for (const Segment& s : segments) {
        for (Eigen::Index k = s.size() - std::max<Eigen::Index>(0, counted(s)); k < s.size(); ++k)
          motor_is_known_.push_back(std::isfinite(s.actual_motor(k)));
      }
      if (std::count(motor_is_known_.begin(), motor_is_known_.end(), true) >= kFewestReadings)
        outputs_ = Outputs::kBoth;
      else
        motor_is_known_.clear();
    }
    for (const Segment& s : segments)
      first_.push_back(first_.back() + per_sample() * std::max<Eigen::Index>(0, counted(s)));
  }

  [[nodiscard]] Eigen::Index per_sample() const { return static_cast<Eigen::Index>(outputs_); }
  [[nodiscard]] Eigen::Index rows() const { return first_.back(); }
  [[nodiscard]] double row_s() const {
    return segments_.front().sample_time_s / static_cast<double>(per_sample());
  }
  /// The motor's reading may be lost.
  [[nodiscard]] bool known(Eigen::Index row) const {
    return motor_is_known_.empty() || row % 2 == 0 ||
           motor_is_known_[static_cast<std::size_t>(row / 2)];
  }
  /// Those of one output that are known.
  [[nodiscard]] Eigen::VectorXd of(Eigen::Index output, const Eigen::VectorXd& r) const {
    if (per_sample() == 1) return r;
    std::vector<double> out;
    for (Eigen::Index row = output; row < r.size(); row += 2) {
      if (known(row)) out.push_back(r(row));
    }
    return Eigen::Map<Eigen::VectorXd>(out.data(), static_cast<Eigen::Index>(out.size()));
  }

  /// Measured minus simulated error; empty if the model is not valid.
  [[nodiscard]] Eigen::VectorXd missed(const Model& model) const {
    if (!why_invalid(model).empty()) return {};
    Eigen::VectorXd out(rows());
    for (std::size_t i = 0; i < segments_.size(); ++i)
      put(i, simulate(model, segments_[i], outputs_), out);
    center(out);
    return out;
  }
  [[nodiscard]] Missed missed(const Coordinates& coordinates, const double* x,
                              const std::vector<std::size_t>& free) const;

 private:
  [[nodiscard]] Eigen::Index counted(const Segment& s) const {
    return s.size() - std::max(settled_, s.lead);
  }
  void put(std::size_t segment, const Eigen::ArrayXd& simulated, Eigen::VectorXd& out) const {
    const Segment& s = segments_[segment];
    const Eigen::Index from = first_[segment], n = first_[segment + 1] - from;
    if (n <= 0) return;
    if (per_sample() == 1) {
      out.segment(from, n) = ((s.command - s.actual) - simulated).tail(n).matrix();
      return;
    }
    const Eigen::Index first = simulated.size() - n;
    for (Eigen::Index row = 0; row < n; ++row) {
      const Eigen::Index k = (first + row) / 2;
      const double reading = row % 2 == 0 ? s.actual(k) : s.actual_motor(k);
      out(from + row) = known(from + row) ? s.command(k) - reading - simulated(first + row) : 0.0;
    }
  }
  void center(Eigen::Ref<Eigen::VectorXd> column) const {
    if (per_sample() == 1) return;
    double sum = 0.0, count = 0.0;
    for (Eigen::Index row = 1; row < column.size(); row += 2) {
      if (known(row)) sum += column(row), count += 1.0;
    }
    for (Eigen::Index row = 1; row < column.size(); row += 2)
      column(row) = known(row) ? column(row) - sum / count : 0.0;
  }

  const std::vector<Segment>& segments_;
  Eigen::Index settled_ = 0;
  Outputs outputs_ = Outputs::kRecorded;
  std::vector<Eigen::Index> first_{0};  // row of every segment
  std::vector<bool> motor_is_known_;
};

Missed Readings::missed(const Coordinates& coordinates, const double* x,
                        const std::vector<std::size_t>& free) const {
  const Model model = coordinates.model(x);
  if (!why_invalid(model).empty()) return {};
  const std::vector<Model> all = coordinates.directions(x);
  std::vector<Model> directions;
  for (const std::size_t i : free) directions.push_back(all[i]);
  Missed out;
  out.r.resize(rows());
  out.by.setZero(rows(), static_cast<Eigen::Index>(all.size()));
  const bool has_play = plays(model);
  // One task for every segment and every pass over it.
  const std::size_t passes = (directions.size() + kParametersPerPass - 1) / kParametersPerPass;
  in_parallel(segments_.size() * passes, [&](std::size_t task) {
    const std::size_t i = task / passes, first = task % passes * kParametersPerPass;
    const Segment& s = segments_[i];
    const Eigen::Index n = first_[i + 1] - first_[i];
    if (n <= 0) return;
    const auto some = std::span<const Model>(directions)
                          .subspan(first, std::min(kParametersPerPass, directions.size() - first));
    const Simulated simulated =
        has_play ? by_differences(model, some, s, outputs_) : simulate(model, some, s, outputs_);
    if (first == 0) put(i, simulated.error, out.r);
    for (std::size_t c = 0; c < some.size(); ++c)
      out.by.col(static_cast<Eigen::Index>(free[first + c])).segment(first_[i], n) =
          -simulated.by.col(static_cast<Eigen::Index>(c)).tail(n);
  });
  center(out.r);
  for (const std::size_t i : free) center(out.by.col(static_cast<Eigen::Index>(i)));
  return out;
}

/// The likelihood of every output's readings.
class Likelihoods {
 public:
  /// With the deviations under which these are most probable. Of the motor's encoder the step is
  /// part of its deviation.
  Likelihoods(const Readings& readings, const Eigen::VectorXd& r, double encoder_step) {
    for (Eigen::Index output = 0; output < readings.per_sample(); ++output) {
      const double step = output == 0 ? encoder_step : 0.0;
      const double sigma = most_probable_sigma(readings.of(output, r), step);
      sigmas_.push_back(output == 0 ? sigma : std::max(sigma, kMinMotorSigmaRatio * sigmas_[0]));
      of_output_.emplace_back(step, sigmas_.back());
    }
  }
  [[nodiscard]] double sigma(std::size_t output = 0) const { return sigmas_[output]; }
  [[nodiscard]] const ReadingLikelihood& of(Eigen::Index row) const {
    return of_output_[static_cast<std::size_t>(row) % of_output_.size()];
  }
  [[nodiscard]] double minus_log_likelihood(const Readings& readings,
                                            const Eigen::VectorXd& r) const {
    double sum = 0.0;
    for (Eigen::Index row = 0; row < r.size(); ++row) {
      if (readings.known(row)) sum += of(row).minus_log_likelihood(r(row));
    }
    return sum;
  }
  /// The residuals of least squares for these; `jacobian`, of r, becomes theirs.
  Eigen::VectorXd weighted(const Eigen::VectorXd& r, Eigen::MatrixXd& jacobian) const {
    Eigen::VectorXd out(r.size());
    for (Eigen::Index k = 0; k < r.size(); ++k) {
      jacobian.row(k) *= of(k).slope(r(k));
      out(k) = of(k).residual(r(k));
    }
    return out;
  }

 private:
  std::vector<double> sigmas_;
  std::vector<ReadingLikelihood> of_output_;
};

class ReadingCost final : public ceres::CostFunction {
 public:
  ReadingCost(const Readings& readings, const Coordinates& coordinates, Eigen::Index parameters,
              const Likelihoods& likelihoods, const std::vector<std::size_t>& free)
      : readings_(readings), coordinates_(coordinates), likelihoods_(likelihoods), free_(free) {
    mutable_parameter_block_sizes()->push_back(static_cast<int>(parameters));
    set_num_residuals(static_cast<int>(readings.rows()));
  }

  bool Evaluate(double const* const* x, double* residuals, double** jacobians) const override {
    const Eigen::Index rows = num_residuals(), count = parameter_block_sizes()[0];
    const bool derivatives = jacobians != nullptr && jacobians[0] != nullptr;
    Missed at;
    if (derivatives) {
      at = readings_.missed(coordinates_, x[0], free_);
    } else {
      at.r = readings_.missed(coordinates_.model(x[0]));
    }
    if (at.r.size() != rows || !at.r.allFinite()) return false;
    for (Eigen::Index k = 0; k < rows; ++k) residuals[k] = likelihoods_.of(k).residual(at.r(k));
    if (!Eigen::Map<const Eigen::VectorXd>(residuals, rows).allFinite()) return false;
    if (!derivatives) return true;
    using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
    Eigen::Map<RowMajor> jacobian(jacobians[0], rows, count);
    for (Eigen::Index k = 0; k < rows; ++k)
      jacobian.row(k) = likelihoods_.of(k).slope(at.r(k)) * at.by.row(k);
    return jacobian.allFinite();
  }

 private:
  const Readings& readings_;
  const Coordinates& coordinates_;
  const Likelihoods& likelihoods_;
  const std::vector<std::size_t>& free_;
};

std::optional<Eigen::MatrixXd> covariance_of(const Coordinates& coordinates,
                                             const Eigen::VectorXd& x, const Readings& readings,
                                             const Likelihoods& likelihoods) {
  Missed at = readings.missed(coordinates, x.data(), coordinates.without({}));
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
  const Coordinates coordinates(structure, start, length_scale(segments));
  const Readings readings(segments, start);
  Eigen::VectorXd x = coordinates.of(start);
  Eigen::VectorXd r = readings.missed(start);
  if (r.size() <= x.size() || !r.allFinite()) return std::nullopt;
  const std::vector<std::size_t> free = coordinates.without(options.held);

  std::optional<Likelihoods> likelihoods;
  for (int pass = 0; pass < options.passes; ++pass) {
    const double before = likelihoods ? likelihoods->sigma() : 0.0;
    likelihoods.emplace(readings, r, options.encoder_step);
    if (pass > 0 && std::abs(likelihoods->sigma() - before) < 0.05 * before) break;
    ceres::Problem problem;
    problem.AddResidualBlock(new ReadingCost(readings, coordinates, x.size(), *likelihoods, free),
                             nullptr, x.data());
    for (Eigen::Index i = 0; i < x.size(); ++i) {
      const auto [lower, upper] = coordinates.bounds(i);
      if (lower > -1e299) problem.SetParameterLowerBound(x.data(), static_cast<int>(i), lower);
      if (upper < 1e299) problem.SetParameterUpperBound(x.data(), static_cast<int>(i), upper);
    }
    const int rounds = plays(start) ? std::min(options.rounds, kMaxRoundsOfPlay) : options.rounds;
    ceres::Solver::Options solver = bounded_options(ceres::DENSE_QR, rounds, options.tolerance);
    solver.gradient_tolerance = 1e-30;
    ceres::Solver::Summary summary;
    ceres::Solve(solver, &problem, &summary);
    if (!summary.IsSolutionUsable()) return std::nullopt;
    r = readings.missed(coordinates.model(x.data()));
  }
  OutputErrorFit fit;
  fit.model = coordinates.model(x.data());
  // Their coordinates are logarithms, and lose the last digit.
  for (const std::size_t place : options.held) fit.model.effects[place] = start.effects[place];

  fit.sigma = likelihoods->sigma();
  if (readings.per_sample() > 1) fit.motor_sigma = likelihoods->sigma(1);
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
  const Eigen::VectorXd x = coordinates.of(model), r = readings.missed(model);
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
  std::vector<Readings> readings;
  std::vector<Eigen::VectorXd> left;
  for (const std::vector<Segment>& block : blocks) {
    together.insert(together.end(), block.begin(), block.end());
    readings.emplace_back(block, at);
    left.push_back(readings.back().missed(at));
    if (!left.back().allFinite()) return out;
  }
  const Readings of_all(together, at);
  if (of_all.rows() <= x.size()) return out;
  const Likelihoods likelihoods(of_all, of_all.missed(at), encoder_step);
  const std::vector<std::size_t> every = coordinates.without({});
  std::vector<NormalEquations> equations(blocks.size());
  for (std::size_t b = 0; b < blocks.size(); ++b) {
    Missed block = readings[b].missed(coordinates, x.data(), every);
    if (block.r.size() != left[b].size() || !block.by.allFinite()) return out;
    const Eigen::VectorXd g = likelihoods.weighted(block.r, block.by);
    equations[b] = normal_equations(block.by, g);
  }
  const std::vector<Eigen::VectorXd> steps = steps_without_each(equations);
  // Of the blocks other than one.
  const auto cost = [&](std::size_t without, const Model& model) {
    double sum = 0.0;
    for (std::size_t b = 0; b < blocks.size(); ++b) {
      if (b == without || left[b].size() == 0) continue;
      const Eigen::VectorXd r = readings[b].missed(model);
      if (r.size() != left[b].size() || !r.allFinite()) return kInfinite;
      sum += likelihoods.minus_log_likelihood(readings[b], r);
    }
    return sum;
  };
  for (std::size_t b = 0; b < blocks.size(); ++b) {
    const double before = cost(b, at);
    for (const double share : kStepShares) {
      Eigen::VectorXd there = x + share * steps[b];
      for (Eigen::Index i = 0; i < there.size(); ++i) {
        const auto [lower, upper] = coordinates.bounds(i);
        there(i) = std::clamp(there(i), lower, upper);
      }
      if (!there.allFinite()) break;
      Model model = coordinates.model(there.data());
      if (!why_invalid(model).empty() || !(cost(b, model) < before)) continue;
      out[b] = std::move(model);
      break;
    }
  }
  return out;
}

}  // namespace servotwin
