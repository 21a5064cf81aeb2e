#include "ilc/learn.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <numbers>
#include <sstream>
#include <stdexcept>

#include "ilc/feedforward.h"
#include "ilc/norm_optimal.h"
#include "ilc/reversals.h"
#include "ilc/zero_phase.h"
#include "twin/neighbour.h"
#include "twin/shown_units.h"
#include "twin/twin.h"

namespace servotwin {
namespace {

using Signal = Eigen::ArrayXd;

// Contour error over tracking error below which it is negligible.
constexpr double kNegligibleContourShare = 1e-3;

// Share of the samples from which a limit counts as active.
constexpr double kMinActiveLimitShare = 0.005;

/// From 0 to 1 and back, by half cosines at both ends.
Signal ends(Eigen::Index samples, double h, double ramp_s) {
  const auto ramp =
      std::clamp<Eigen::Index>(std::lround(ramp_s / h), 1, std::max<Eigen::Index>(1, samples / 4));
  Signal out = Signal::Ones(samples);
  for (Eigen::Index k = 0; k < std::min(ramp, samples); ++k) {
    const double w =
        0.5 - 0.5 * std::cos(std::numbers::pi * static_cast<double>(k) / static_cast<double>(ramp));
    out(k) = std::min(out(k), w);
    out(samples - 1 - k) = std::min(out(samples - 1 - k), w);
  }
  return out;
}

/// The state of one axis from trial to trial.
class Learner {
 public:
  Learner(const LearnAxis& axis, double ramp_s)
      : axis_(axis),
        filter_(axis.path.size(), axis.path.sample_time_s),
        ends_(ends(axis.path.size(), axis.path.sample_time_s, ramp_s)) {
    const Signal& omega = filter_.omega();
    q_ = axis.law.q(omega).cast<std::complex<double>>();
    learned_ = axis.law.l(omega);
    basis_ = Signal::Zero(axis.path.size());
    if (axis.law.law == Law::kNormOptimal) {
      optimal_ = std::make_unique<NormOptimal>(axis.law, axis.limits, axis.path.size(),
                                               axis.path.sample_time_s);
      return;
    }
    if (axis.basis_bandwidth_hz > 0.0) {
      LearningLaw inverse;
      inverse.model = axis.law.model;
      inverse.bandwidth_hz = axis.basis_bandwidth_hz;
      basis_ = feedforward(axis.model, inverse, axis.path, filter_);
    }
    if (axis.reversal_bandwidth_hz > 0.0) {
      LearningLaw wide = axis.law;
      wide.bandwidth_hz = axis.reversal_bandwidth_hz;
      q_reversal_ = wide.q(omega).cast<std::complex<double>>();
      weight_ = reversal_weight(axis.path.command, axis.path.sample_time_s);
    }
  }

  [[nodiscard]] Signal next(const Signal& u, const Signal& e) {
    if (optimal_) return optimal_->next(u, e);
    const Signal whole = u - basis_ + filter_.filtered(e, learned_);
    return within(basis_ + robust(whole));
  }

  [[nodiscard]] Signal basis() const { return within(basis_); }

  [[nodiscard]] double beyond_bandwidth_rms(const Signal& error) {
    return size_of(error - filter_.filtered(error, q_)).rms;
  }

  /// Where peak or rate is reached, of the samples at which the command moves.
  void say_limits(const Signal& u, LearnedAxis& out) const {
    const double peak = 0.999 * axis_.limits.peak,
                 step = 0.999 * axis_.limits.rate * axis_.path.sample_time_s;
    double moves = 0.0, held = 0.0, at_peak = 0.0;
    for (Eigen::Index k = 1; k < u.size(); ++k) {
      if (axis_.path.command(k) == axis_.path.command(k - 1)) continue;
      moves += 1.0;
      if (std::abs(u(k)) >= peak) at_peak += 1.0;
      if (std::abs(u(k)) >= peak || std::abs(u(k) - u(k - 1)) >= step) held += 1.0;
    }
    out.at_limit_share = moves > 0.0 ? held / moves : 0.0;
    out.at_peak_share = moves > 0.0 ? at_peak / moves : 0.0;
  }

 private:
  [[nodiscard]] Signal robust(const Signal& signal) {
    Signal narrow = filter_.filtered(signal, q_);
    if (weight_.size() == 0) return narrow;
    return weight_ * filter_.filtered(signal, q_reversal_) + (1.0 - weight_) * narrow;
  }
  [[nodiscard]] Signal within(const Signal& u) const {
    return limited(ends_ * u, axis_.limits, axis_.path.sample_time_s);
  }

  const LearnAxis& axis_;
  ZeroPhase filter_;
  Signal ends_, basis_, weight_;
  Eigen::ArrayXcd q_, q_reversal_, learned_;
  std::unique_ptr<NormOptimal> optimal_;
};

/// One run of the plant with its errors.
struct Run {
  std::vector<Signal> error;
  std::optional<ProgramError> contour;
  Trial trial;
};

Run run_of(const std::vector<LearnAxis>& axes, const Plant& plant,
           const std::vector<Signal>& corrections) {
  std::vector<Signal> commands;
  for (std::size_t i = 0; i < axes.size(); ++i)
    commands.push_back(axes[i].path.command + corrections[i]);
  const std::vector<Signal> positions = plant(commands);
  Run out;
  std::vector<Signal> linear, linear_actual, rotary, rotary_actual;
  for (std::size_t i = 0; i < axes.size(); ++i) {
    const Signal& command = axes[i].path.command;
    out.error.push_back(command - positions[i]);
    out.trial.axis.push_back(size_of(out.error.back()));
    (axes[i].rotary ? rotary : linear).push_back(command);
    (axes[i].rotary ? rotary_actual : linear_actual).push_back(positions[i]);
  }
  if (linear.size() >= 2 && linear.size() <= kMaxPathAxes) {
    out.contour = program_error(linear, linear_actual, rotary, rotary_actual);
    out.trial.contour = size_of(out.contour->distance);
    if (!rotary.empty()) out.trial.turned = size_of(out.contour->turned);
  }
  return out;
}

/// The contour error that is negligible compared with the tracking errors of this trial.
double nothing_beside(const Trial& first) {
  double most = 0.0;
  for (const ErrorSize& axis : first.axis) most = std::max(most, axis.rms);
  return kNegligibleContourShare * most;
}

/// The error that the aim minimises, relative to the trial without correction.
double left_of(const Trial& trial, const Trial& first, Aim aim) {
  if (aim == Aim::kContour) return trial.contour.rms;
  double sum = 0.0;
  for (std::size_t i = 0; i < trial.axis.size(); ++i) {
    const double scale = std::max(first.axis[i].rms, nothing_beside(first));
    if (scale > 0.0) sum += std::pow(trial.axis[i].rms / scale, 2.0);
  }
  return std::sqrt(sum);
}

void require_usable(const std::vector<LearnAxis>& axes) {
  if (axes.empty()) throw std::invalid_argument("there is no axis to learn");
  for (const LearnAxis& axis : axes) {
    if (axis.path.size() != axes.front().path.size() || axis.path.size() < 4)
      throw std::invalid_argument("the commands of " + axis.name + " and " + axes.front().name +
                                  " are not of one length of at least 4 samples");
  }
}

}  // namespace

ErrorSize size_of(const Signal& error) {
  if (error.size() == 0) return {};
  return {std::sqrt(error.square().mean()), error.abs().maxCoeff()};
}

namespace {

/// Sets the motion of the axis that acts on axis i, of which the segment has the command.
void move_neighbour(const std::vector<LearnAxis>& axes, std::size_t i, Segment& segment) {
  segment.neighbour_motion.resize(0);
  const auto other = axes[i].neighbour;
  if (other && coupled_by_motion(axes[i].model))
    predict_neighbour(segment, axes[i].model, axes[*other].model, axes[*other].neighbour == i);
}

}  // namespace

std::vector<std::size_t> find_neighbours(std::vector<LearnAxis>& axes,
                                         const std::vector<std::string>& named) {
  std::vector<std::size_t> without;
  for (std::size_t i = 0; i < axes.size(); ++i) {
    if (coupling_of(axes[i].model) == nullptr) continue;
    for (std::size_t other = 0; other < axes.size() && !axes[i].neighbour; ++other) {
      if (other == i || !(named[i].empty() || axes[other].name == named[i])) continue;
      axes[i].neighbour = other;
      axes[i].path.neighbour = axes[other].path.command;
    }
    if (!axes[i].neighbour) without.push_back(i);
  }
  for (std::size_t i = 0; i < axes.size(); ++i) move_neighbour(axes, i, axes[i].path);
  return without;
}

Plant on_twins(const std::vector<LearnAxis>& axes) {
  return [axes](const std::vector<Signal>& commands) {
    std::vector<Signal> out;
    for (std::size_t i = 0; i < axes.size(); ++i) {
      Segment segment = axes[i].path;
      segment.actual.resize(0);
      segment.command = commands[i];
      if (const auto other = axes[i].neighbour) segment.neighbour = commands[*other];
      move_neighbour(axes, i, segment);
      out.push_back(commands[i] - simulate(axes[i].model, segment));
    }
    return out;
  };
}

namespace {

Learned learned_with(const std::vector<LearnAxis>& axes, const Plant& plant,
                     const LearnOptions& options) {
  std::vector<std::unique_ptr<Learner>> learners;
  for (const LearnAxis& axis : axes)
    learners.push_back(std::make_unique<Learner>(axis, options.ramp_s));

  std::vector<Signal> u;
  for (const LearnAxis& axis : axes) u.push_back(Signal::Zero(axis.path.size()));
  Run run = run_of(axes, plant, u);
  if (options.aim == Aim::kContour && !run.contour)
    throw std::invalid_argument("the contour error needs two to five linear axes");
  Learned out;
  out.trials.push_back(run.trial);
  out.before = out.after = run.contour;
  for (std::size_t i = 0; i < axes.size(); ++i) {
    out.axes.push_back({u[i], run.error[i], run.error[i]});
  }

  double least = left_of(run.trial, run.trial, options.aim);
  int worse = 0;
  const int trials = options.feedforward_only ? 1 : options.trials;
  for (int trial = 1; trial <= trials; ++trial) {
    std::size_t line = 0;
    for (std::size_t i = 0; i < axes.size(); ++i) {
      if (options.feedforward_only) {
        u[i] = learners[i]->basis();
        continue;
      }
      Signal error = run.error[i];
      if (options.aim == Aim::kContour && !axes[i].rotary) {
        for (Eigen::Index k = 0; k < error.size(); ++k)
          error(k) = -run.contour->away[static_cast<std::size_t>(k)][line];
        ++line;
      }
      u[i] = learners[i]->next(u[i], error);
    }
    run = run_of(axes, plant, u);
    out.trials.push_back(run.trial);
    const double left = left_of(run.trial, out.trials.front(), options.aim);
    // A trial whose contour error is larger than without correction is not kept, even if the axes'
    // own errors fall. A contour error that is negligible compared with the tracking errors is
    // ignored.
    const bool harms =
        run.contour && run.trial.contour.rms > std::max(out.trials.front().contour.rms,
                                                        nothing_beside(out.trials.front()));
    if (left < least && !harms) {
      least = left;
      worse = 0;
      out.best = out.trials.size() - 1;
      out.after = run.contour;
      for (std::size_t i = 0; i < axes.size(); ++i) {
        out.axes[i].correction = u[i];
        out.axes[i].error_after = run.error[i];
        learners[i]->say_limits(u[i], out.axes[i]);
      }
    } else if (++worse == options.patience) {
      out.ending = Ending::kGrew;
      break;
    }
  }
  for (std::size_t i = 0; i < axes.size() && out.best == 0; ++i)
    learners[i]->say_limits(u[i], out.axes[i]);
  for (std::size_t i = 0; i < axes.size(); ++i)
    out.axes[i].beyond_bandwidth_rms = learners[i]->beyond_bandwidth_rms(out.axes[i].error_after);
  return out;
}

}  // namespace

Learned learn(const std::vector<LearnAxis>& axes, const Plant& plant, const LearnOptions& options) {
  require_usable(axes);
  Learned out = learned_with(axes, plant, options);
  std::vector<LearnAxis> rigid = axes;
  for (LearnAxis& axis : rigid) {
    out.two_masses = out.two_masses || axis.law.model.two_masses;
    axis.law.model.two_masses.reset();
  }
  if (!out.two_masses || !options.rigid_law_too || options.trials < 1) return out;
  Learned by_rigid = learned_with(rigid, plant, options);
  const auto left = [&](const Learned& one) {
    return left_of(one.trials[one.best], one.trials.front(), options.aim);
  };
  by_rigid.two_masses = by_rigid.by_rigid_law = true;
  return left(by_rigid) < left(out) ? by_rigid : out;
}

std::string without_neighbour(const std::string& axis, const std::string& named) {
  return "the model of " + axis + " contains the acceleration of " +
         (named.empty() ? "another axis" : "axis " + named) +
         ", which has no path here: what it does is not corrected";
}

std::string why_none_is_kept(const Learned& learned, const std::vector<LearnAxis>& axes) {
  const Trial& first = learned.trials.front();
  double least_um =
      std::numeric_limits<double>::infinity();  // contour, where every axis got better
  for (const Trial& trial : learned.trials) {
    bool better = &trial != &first;
    for (std::size_t i = 0; i < axes.size(); ++i)
      better = better && trial.axis[i].rms <= first.axis[i].rms;
    if (better) least_um = std::min(least_um, 1e6 * trial.contour.rms);
  }
  std::ostringstream out;
  out.precision(3);
  out << "no trial was better than no correction: ";
  if (learned.before && 1e-6 * least_um > first.contour.rms && std::isfinite(least_um)) {
    out << "the axes' errors fell, but the distance from the path grew from "
        << 1e6 * first.contour.rms << " to " << least_um << " um RMS";
  } else {
    out << "the errors grew";
  }
  for (std::size_t i = 0; i < axes.size(); ++i) {
    const LearnedAxis& axis = learned.axes[i];
    if (!(axis.at_limit_share > kMinActiveLimitShare)) continue;
    out << ", " << axes[i].name << " at its";
    if (axis.at_peak_share > kMinActiveLimitShare)
      out << " peak of " << 1e6 * axes[i].limits.peak << " " << micro(axes[i].rotary);
    if (axis.at_peak_share > kMinActiveLimitShare &&
        axis.at_limit_share > axis.at_peak_share + kMinActiveLimitShare)
      out << " or";
    if (axis.at_limit_share > axis.at_peak_share + kMinActiveLimitShare)
      out << " rate of " << 1e3 * axes[i].limits.rate << " " << milli(axes[i].rotary) << "/s";
    out << " in " << std::round(100.0 * axis.at_limit_share) << " % of the motion";
  }
  return out.str();
}

}  // namespace servotwin
