#include "identification/loop/readings.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <span>

#include "identification/least_squares/parallel.h"
#include "twin/difference.h"
#include "twin/two_mass_axis.h"

namespace servotwin {

namespace {

/// Of motor or torque, from which on they count: fewer do not tell how well it is simulated.
constexpr Eigen::Index kFewestReadings = 300;
/// Deviation of the motor's readings over that of the recorded encoder's, at least: readings that
/// are all of one rest, on one step, would have none.
constexpr double kMinMotorSigmaRatio = 1e-2;
/// The same of the torque, over its RMS.
constexpr double kMinTorqueSigmaRatio = 1e-6;

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

/// How many samples of a segment count.
Eigen::Index counted(const Segment& s, Eigen::Index settled) {
  return std::max<Eigen::Index>(0, s.size() - std::max(settled, s.lead));
}

Outputs outputs_of(const std::vector<Segment>& segments, const Model& start, bool with_torque) {
  Outputs out;
  if (segments.empty()) return out;
  const Eigen::Index settled = starting_state_samples(start, segments.front());
  const auto all_have = [&](Eigen::ArrayXd Segment::*channel) {
    Eigen::Index known = 0;
    for (const Segment& s : segments) {
      if ((s.*channel).size() != s.size()) return false;
      known += (s.*channel).tail(counted(s, settled)).isFinite().count();
    }
    return known >= kFewestReadings;
  };
  out.motor = two_mass_of(start) != nullptr && all_have(&Segment::actual_motor);
  out.torque = with_torque && all_have(&Segment::torque);
  return out;
}

/// What is always free of one output: it is taken out of its residuals and of their derivatives, as
/// variable projection does with linear parameters (Kaufman's derivative).
class FreePart {
 public:
  /// The columns whose coefficients are free: one row per sample, 0 where a reading is lost.
  explicit FreePart(const Eigen::MatrixXd& columns)
      : scale_(columns.colwise().norm().cwiseMax(1e-300)),
        solver_(columns * scale_.cwiseInverse().asDiagonal()) {
    q_ = solver_.householderQ() *
         Eigen::MatrixXd::Identity(columns.rows(), std::min(solver_.rank(), columns.rows()));
  }
  [[nodiscard]] Eigen::VectorXd coefficients(const Eigen::VectorXd& of) const {
    return (solver_.solve(of).array() / scale_.transpose().array()).matrix();
  }
  [[nodiscard]] Eigen::VectorXd without(const Eigen::VectorXd& of) const {
    return of - q_ * (q_.transpose() * of);
  }

 private:
  Eigen::RowVectorXd scale_;
  Eigen::ColPivHouseholderQR<Eigen::MatrixXd> solver_;
  Eigen::MatrixXd q_;
};

}  // namespace

Readings::Readings(const std::vector<Segment>& segments, const Model& start,
                   const std::optional<TorqueLag>& torque)
    : Readings(segments, start, outputs_of(segments, start, torque.has_value()),
               torque.value_or(TorqueLag())) {}

Readings::Readings(const std::vector<Segment>& segments, const Model& start, Outputs outputs,
                   const TorqueLag& lag)
    : segments_(&segments), outputs_(outputs), lag_(lag) {
  const Eigen::Index settled =
      segments.empty() ? 0 : starting_state_samples(start, segments.front());
  for (const Segment& s : segments) first_.push_back(first_.back() + counted(s, settled));
  recorded_.resize(first_.back(), 1 + (outputs.motor ? 1 : 0) + (outputs.torque ? 1 : 0));
  for (std::size_t i = 0; i < segments.size(); ++i) {
    const Segment& s = segments[i];
    const Eigen::Index n = first_[i + 1] - first_[i];
    const auto put = [&](Eigen::Index column, const Eigen::ArrayXd& values) {
      recorded_.col(column).segment(first_[i], n) = values.tail(n).matrix();
    };
    put(0, s.command - s.actual);
    if (outputs.motor) put(1, s.command - s.actual_motor);
    if (outputs.torque) put(torque_column(), s.torque);
  }
}

Eigen::VectorXd Readings::of(Eigen::Index output, const Eigen::VectorXd& r) const {
  if (per_sample() == 1) return r;
  std::vector<double> out;
  for (Eigen::Index row = output; row < r.size(); row += per_sample()) {
    if (known(row)) out.push_back(r(row));
  }
  return Eigen::Map<Eigen::VectorXd>(out.data(), static_cast<Eigen::Index>(out.size()));
}

double Readings::torque_rms() const {
  if (!outputs_.torque) return 0.0;
  double sum = 0.0, count = 0.0;
  for (const double torque : recorded_.col(torque_column())) {
    if (std::isfinite(torque)) sum += torque * torque, count += 1.0;
  }
  return std::sqrt(sum / std::max(1.0, count));
}

void Readings::lag(const Segment& segment, Eigen::Ref<Eigen::VectorXd> simulated) const {
  if (!outputs_.torque || lag_.s == 0.0) return;
  for (const Eigen::Index output : {outputs_.torque_at(), outputs_.torque_at() + 1}) {
    const auto rows = Eigen::seqN(output, segment.size(), outputs_.per_sample());
    simulated(rows) = lagged(simulated(rows).array(), lag_, segment.sample_time_s).matrix();
  }
}

Missed Readings::left(const Eigen::VectorXd& simulated, const Eigen::MatrixXd& by,
                      const std::vector<std::size_t>& free, Eigen::Index coordinates) const {
  const Eigen::Index samples = recorded_.rows(), count = std::ssize(free);
  const auto at = [samples](Eigen::Index output, Eigen::Index of) {
    return Eigen::seqN(output, samples, of);
  };
  Missed out;
  out.r.resize(rows());
  out.by.setZero(count > 0 ? rows() : 0, coordinates);
  const Eigen::Index every = outputs_.per_sample();
  out.r(at(0, per_sample())) = recorded_.col(0) - simulated(at(0, every));
  for (Eigen::Index c = 0; c < count; ++c)
    out.by.col(static_cast<Eigen::Index>(free[static_cast<std::size_t>(c)]))(at(0, per_sample())) =
        -by.col(c)(at(0, every));
  // Fills in an output beside the encoder in the loop: `missed` without its free part, and the same
  // of its derivative `moved(c)` by every free coordinate.
  const auto put = [&](Eigen::Index output, const FreePart& part, const Eigen::VectorXd& missed,
                       const auto& moved) {
    out.r(at(output, per_sample())) = part.without(missed);
    for (Eigen::Index c = 0; c < count; ++c)
      out.by.col(static_cast<Eigen::Index>(free[static_cast<std::size_t>(c)]))(
          at(output, per_sample())) = part.without(moved(c));
  };
  const auto known = [&](Eigen::Index output) -> Eigen::ArrayXd {
    return recorded_.col(output).array().isFinite().cast<double>();
  };
  const auto only = [](const Eigen::ArrayXd& mask, const Eigen::ArrayXd& x) -> Eigen::VectorXd {
    return (mask > 0.0).select(x, 0.0).matrix();
  };
  if (outputs_.motor) {
    const Eigen::ArrayXd mask = known(1);
    put(1, FreePart(mask), only(mask, recorded_.col(1) - simulated(at(1, every))),
        [&](Eigen::Index c) { return only(mask, -by.col(c)(at(1, every))); });
  }
  if (outputs_.torque) {
    const Eigen::ArrayXd mask = known(torque_column());
    const auto force = at(outputs_.torque_at(), every),
               velocity = at(outputs_.torque_at() + 1, every);
    Eigen::MatrixXd columns(samples, 3);
    columns << only(mask, simulated(force)), only(mask, simulated(velocity)), mask.matrix();
    const FreePart part(columns);
    const Eigen::VectorXd torque = only(mask, recorded_.col(torque_column()));
    const Eigen::VectorXd found = part.coefficients(torque);
    out.torque = {found(0), found(1), found(2)};
    put(torque_column(), part, torque, [&](Eigen::Index c) {
      return only(mask, -found(0) * by.col(c)(force) - found(1) * by.col(c)(velocity));
    });
  }
  return out;
}

Missed Readings::missed(const Model& model) const {
  if (!why_invalid(model).empty()) return {};
  const Eigen::Index every = outputs_.per_sample();
  Eigen::VectorXd simulated(every * recorded_.rows());
  for (std::size_t i = 0; i < segments_->size(); ++i) {
    const Eigen::Index n = every * (first_[i + 1] - first_[i]);
    if (n == 0) continue;
    Eigen::VectorXd of_segment = simulate(model, (*segments_)[i], outputs_).matrix();
    lag((*segments_)[i], of_segment);
    simulated.segment(every * first_[i], n) = of_segment.tail(n);
  }
  return left(simulated, {}, {}, 0);
}

Missed Readings::missed(const Coordinates& coordinates, const double* x,
                        const std::vector<std::size_t>& free) const {
  const Model model = coordinates.model(x);
  if (!why_invalid(model).empty()) return {};
  const std::vector<Model> all = coordinates.directions(x);
  std::vector<Model> directions;
  for (const std::size_t i : free) directions.push_back(all[i]);
  const Eigen::Index every = outputs_.per_sample();
  Eigen::VectorXd simulated(every * recorded_.rows());
  Eigen::MatrixXd by(every * recorded_.rows(), std::ssize(free));
  const bool has_play = plays(model);
  // One task for every segment and every pass over it.
  const std::size_t passes = (directions.size() + kParametersPerPass - 1) / kParametersPerPass;
  in_parallel(segments_->size() * passes, [&](std::size_t task) {
    const std::size_t i = task / passes, first = task % passes * kParametersPerPass;
    const Segment& s = (*segments_)[i];
    const Eigen::Index n = every * (first_[i + 1] - first_[i]), from = every * first_[i];
    if (n <= 0) return;
    const auto some = std::span<const Model>(directions)
                          .subspan(first, std::min(kParametersPerPass, directions.size() - first));
    Simulated of_segment =
        has_play ? by_differences(model, some, s, outputs_) : simulate(model, some, s, outputs_);
    if (first == 0) {
      lag(s, Eigen::Map<Eigen::VectorXd>(of_segment.error.data(), of_segment.error.size()));
      simulated.segment(from, n) = of_segment.error.tail(n).matrix();
    }
    for (Eigen::Index c = 0; c < of_segment.by.cols(); ++c) lag(s, of_segment.by.col(c));
    by.block(from, static_cast<Eigen::Index>(first), n, std::ssize(some)) =
        of_segment.by.bottomRows(n);
  });
  return left(simulated, by, free, std::ssize(all));
}

Likelihoods::Likelihoods(const Readings& readings, const Eigen::VectorXd& r, double encoder_step) {
  for (Eigen::Index output = 0; output < readings.per_sample(); ++output) {
    const double step = output == 0 ? encoder_step : 0.0;
    double sigma = most_probable_sigma(readings.of(output, r), step);
    if (output == readings.torque_column()) {
      sigma = std::max(sigma, kMinTorqueSigmaRatio * readings.torque_rms());
    } else if (output > 0) {
      sigma = std::max(sigma, kMinMotorSigmaRatio * sigmas_[0]);
    }
    sigmas_.push_back(sigma);
    of_output_.emplace_back(step, sigma);
  }
}

double Likelihoods::minus_log_likelihood(const Readings& readings, const Eigen::VectorXd& r) const {
  double sum = 0.0;
  for (Eigen::Index row = 0; row < r.size(); ++row) {
    if (readings.known(row)) sum += of(row).minus_log_likelihood(r(row));
  }
  return sum;
}

Eigen::VectorXd Likelihoods::weighted(const Eigen::VectorXd& r, Eigen::MatrixXd& jacobian) const {
  Eigen::VectorXd out(r.size());
  for (Eigen::Index k = 0; k < r.size(); ++k) {
    jacobian.row(k) *= of(k).slope(r(k));
    out(k) = of(k).residual(r(k));
  }
  return out;
}

}  // namespace servotwin
