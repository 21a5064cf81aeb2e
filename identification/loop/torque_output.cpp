#include "identification/loop/torque_output.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

#include "identification/loop/identify.h"
#include "identification/loop/message.h"
#include "identification/loop/readings.h"
#include "identification/loop/structure_choice.h"
#include "twin/twin.h"

namespace servotwin {

namespace {

// Of a lag that a drive's display has: more is another recording's torque.
constexpr int kMostGridSteps = 20, kMostGridStepsOfLead = 10;
constexpr double kLagGrid_s = 1e-3, kLagTolerance_s = 1e-6;
// Squared residual with a lag over that without it, or of a filter over that of a delay, above
// which the motion does not show it.
constexpr double kMaxRatioOfLag = 0.999;

// Scatter of a torque over its RMS, below which it is a constant with rounding.
constexpr double kMinScatterShare = 1e-6;

// Rows in which a torque has its highest value: noise has one of them, a limit many.
constexpr double kMinRowsAtLimit = 20.0, kMinShareAtLimit = 2e-3;

// What a fit to both may add to the residual of the position, without the encoder's rounding: over
// that of the position alone (2 % in all), or over the tracking error. The model is there for the
// latter: what it loses of it then is nothing that anyone would measure.
constexpr double kMaxAddedShare = 0.2, kMaxAddedShareOfError = 1e-4;
// Of the torque about its mean, left in one half of the training data by the scale of the other:
// more is not understood, and must not move the model; and left on held-out data: more is that of
// another motion.
constexpr double kMaxShareTogether = 0.3, kMaxShareLeft = 0.7;

// All forces of a model and the speed of its loop can grow together while the position hardly
// changes, most where a filter of the control is part of it. Only the torque ends that, a long way
// off: some fits of many rounds.
constexpr int kLongRounds = 150, kMostFits = 6;
constexpr double kLongTolerance = 1e-8;
constexpr double kMinGain = 1.0;  // of the logarithm of the likelihood: below it nothing is shown

/// Deviation of the position from a model, without the rounding of the encoder, and of the command.
double position_sigma(const Readings& readings, const Model& model, double encoder_step) {
  const Eigen::VectorXd missed = readings.missed(model).r;
  return missed.size() > 0 ? Likelihoods(readings, missed, encoder_step).sigma() : kAbsent;
}

/// RMS of the tracking error about its mean.
double tracking_rms(const std::vector<Segment>& segments) {
  double sum = 0.0, square = 0.0, count = 0.0;
  for (const Segment& s : segments) {
    const Eigen::ArrayXd error = s.command - s.actual;
    sum += error.sum();
    square += error.square().sum();
    count += static_cast<double>(s.size());
  }
  return std::sqrt(std::max(0.0, square / count - std::pow(sum / count, 2)));
}

struct Range {
  double low = HUGE_VAL, high = -HUGE_VAL;
  [[nodiscard]] bool changes() const {
    return high - low > kMinScatterShare * std::max(std::abs(low), std::abs(high));
  }
};
Range range_of(const std::vector<Segment>& segments) {
  Range out;
  for (const Segment& s : segments) {
    for (const double torque : s.torque) {
      if (!std::isfinite(torque)) continue;
      out.low = std::min(out.low, torque);
      out.high = std::max(out.high, torque);
    }
  }
  return out;
}

/// Takes out the rows in which the torque stands at its lowest or highest value; their share.
double leave_out_limits(std::vector<Segment>& segments) {
  const Range range = range_of(segments);
  double all = 0.0, out = 0.0;
  for (const Segment& s : segments) all += static_cast<double>(s.torque.isFinite().count());
  for (const double limit : {range.low, range.high}) {
    double at_limit = 0.0;
    for (const Segment& s : segments) at_limit += static_cast<double>((s.torque == limit).count());
    if (at_limit < std::max(kMinRowsAtLimit, kMinShareAtLimit * all)) continue;
    for (Segment& s : segments) s.torque = (s.torque == limit).select(kAbsent, s.torque);
    out += at_limit;
  }
  return all > 0.0 ? out / all : 0.0;
}

/// Force and velocity of a model where a torque was recorded, for many lags.
class SimulatedTorque {
 public:
  SimulatedTorque(const Model& model, const std::vector<Segment>& segments) {
    for (const Segment& s : segments) {
      if (s.torque.size() != s.size()) continue;
      constexpr Outputs kTorque{.torque = true};
      const Eigen::ArrayXd all = simulate(model, s, kTorque);
      const auto of = [&](Eigen::Index output) -> Eigen::ArrayXd {
        return all(Eigen::seqN(output, s.size(), kTorque.per_sample()));
      };
      const Eigen::Index first = std::max(s.lead, starting_state_samples(model, s));
      parts_.push_back({of(kTorque.torque_at()), of(kTorque.torque_at() + 1), s.torque,
                        std::min(first, s.size()), s.sample_time_s});
    }
  }
  /// The sum of squares that scale, viscous part and offset leave.
  [[nodiscard]] double left(const TorqueLag& lag) const {
    Eigen::Matrix4d products = Eigen::Matrix4d::Zero();
    for (const Part& part : parts_) {
      const Eigen::ArrayXd force = lagged(part.force, lag, part.sample_time_s),
                           velocity = lagged(part.velocity, lag, part.sample_time_s);
      for (Eigen::Index k = part.first; k < force.size(); ++k) {
        if (!std::isfinite(part.torque(k))) continue;
        const Eigen::Vector4d row(force(k), velocity(k), 1.0, part.torque(k));
        products += row * row.transpose();
      }
    }
    const Eigen::Vector3d with_torque = products.topRightCorner<3, 1>();
    const Eigen::Vector3d by = products.topLeftCorner<3, 3>().ldlt().solve(with_torque);
    return products(3, 3) - by.dot(with_torque);
  }

 private:
  struct Part {
    Eigen::ArrayXd force, velocity, torque;
    Eigen::Index first = 0;  // that counts
    double sample_time_s = 0.0;
  };
  std::vector<Part> parts_;
};

}  // namespace

TorqueData torque_data(const SegmentedAxis& axis, double share, bool split_each) {
  std::vector<Segment> segments = axis.segments;
  double at_limit_share = 0.0;
  if (!range_of(split(segments, share, split_each).first).changes()) {
    for (Segment& s : segments) s.torque.resize(0);
  } else {
    at_limit_share = leave_out_limits(segments);
  }
  auto [training, holdout] = split(segments, share, split_each);
  return {axis.torque_unit, at_limit_share, std::move(training), with_lead_in(holdout, segments)};
}

TorqueLag lag_of_torque(const Model& model, const std::vector<Segment>& segments) {
  const SimulatedTorque simulated(model, segments);
  TorqueLag best;
  const double without = simulated.left(best);
  double least = kMaxRatioOfLag * without;
  for (const bool filter : {false, true}) {
    TorqueLag lag{0.0, filter};
    double left = without;
    const auto try_at = [&](double s) {
      const double here = simulated.left({s, filter});
      if (here < left) left = here, lag.s = s;
    };
    for (int i = filter ? 1 : -kMostGridStepsOfLead; i <= kMostGridSteps; ++i)
      try_at(i * kLagGrid_s);
    for (double step = 0.5 * kLagGrid_s; step > kLagTolerance_s; step *= 0.5) {
      const double middle = lag.s;
      for (const double s : {middle - step, middle + step}) {
        if (!filter || s > 0.0) try_at(s);
      }
    }
    if (left < least) best = lag, least = kMaxRatioOfLag * left;
  }
  return best;
}

std::optional<OutputErrorFit> fitted_with_torque(const Model& model, const TorqueData& data,
                                                 const NoiseFloor& floor) {
  const Readings position(data.training, model);
  if (!model.loop.modes.empty() || !Readings(data.training, model, TorqueLag()).outputs().torque)
    return std::nullopt;
  TorqueLag lag;
  const Structure structure = structure_of(model);
  OutputErrorOptions options{floor.encoder_step};
  const double alone = position_sigma(position, model, floor.encoder_step);
  const double most = std::hypot(
      alone, std::max(kMaxAddedShare * alone, kMaxAddedShareOfError * tracking_rms(data.training)));
  std::optional<OutputErrorFit> found;
  for (int i = 0; i < kMostFits; ++i) {
    const Model& from = found ? found->model : model;
    options.torque = lag = lag_of_torque(from, data.training);
    auto fit = output_error(data.training, structure, from, options);
    if (!fit || !why_invalid(fit->model).empty()) break;
    if (!(position_sigma(position, fit->model, floor.encoder_step) <= most)) return std::nullopt;
    const bool gains = !found || fit->minus_log_likelihood < found->minus_log_likelihood - kMinGain;
    if (gains) found = std::move(fit);
    if (!gains) break;
    options.rounds = kLongRounds;
    options.tolerance = kLongTolerance;
  }
  if (!found) return std::nullopt;
  // By the scale of one half of the training data the torque of the other is judged.
  const auto [first, second] = split(data.training, 0.5, false);
  const auto share = [&](const std::vector<Segment>& of, const std::vector<Segment>& judged) {
    const TorqueScale by = Readings(of, found->model, lag).missed(found->model).torque;
    return torque_error(found->model, by, lag, judged).share();
  };
  if (!(share(first, second) <= kMaxShareTogether && share(second, first) <= kMaxShareTogether))
    return std::nullopt;
  return found;
}

TorqueError torque_error(const Model& model, const TorqueScale& by, const TorqueLag& lag,
                         const std::vector<Segment>& segments) {
  std::vector<double> recorded;
  double left = 0.0;
  for (const Segment& s : segments) {
    if (s.torque.size() != s.size()) continue;
    const Eigen::ArrayXd simulated = simulated_torque(model, by, lag, s);
    for (Eigen::Index k = std::max(s.lead, starting_state_samples(model, s)); k < s.size(); ++k) {
      if (!std::isfinite(s.torque(k))) continue;
      left += std::pow(s.torque(k) - simulated(k), 2);
      recorded.push_back(s.torque(k));
    }
  }
  if (recorded.empty()) return {};
  const Eigen::Map<const Eigen::ArrayXd> all(recorded.data(), std::ssize(recorded));
  return {std::sqrt(left / static_cast<double>(recorded.size())),
          std::sqrt((all - all.mean()).square().mean())};
}

TorqueOutput motor_torque(const Model& model, const TorqueData& data) {
  if (!Readings(data.training, model, TorqueLag()).outputs().torque) {
    const bool none = std::all_of(data.training.begin(), data.training.end(),
                                  [](const Segment& s) { return s.torque.size() == 0; });
    return {std::nullopt, none ? "it does not change, or is not in all of the motion that is fitted"
                               : "too few of its values are in the motion that is fitted"};
  }
  MotorTorque out;
  out.unit = data.unit;
  out.at_limit_share = data.at_limit_share;
  out.lag = lag_of_torque(model, data.training);
  out.by = Readings(data.training, model, out.lag).missed(model).torque;
  out.training_rms = torque_error(model, out.by, out.lag, data.training).rms;
  const TorqueError held = torque_error(model, out.by, out.lag, data.judged_on);
  if (held.share() > kMaxShareLeft)
    return {std::nullopt, message(std::round(100.0 * held.share()),
                                  " % of its scatter would be left on held-out motion: it is not "
                                  "that of this motion, or some of its values are wrong")};
  out.holdout_rms = held.rms;
  out.holdout_scatter = held.scatter;
  return {out, {}};
}

}  // namespace servotwin
