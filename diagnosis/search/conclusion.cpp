#include "diagnosis/search/conclusion.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>
#include <numeric>
#include <span>
#include <string_view>

#include "diagnosis/search/extension.h"
#include "diagnosis/search/judgement.h"

namespace servotwin {

namespace {

// Prior hit rate of a cause that removes the whole error, and how much lower it is for a cause that
// removes next to nothing. It allows for causes that the catalogue does not contain. Chosen, not
// fitted; how well it holds is measured (docs/measurements.md 11, calibration error).
constexpr double kHitRate = 0.97, kHitRateLoss = 0.4;
// RMS over that of the earlier model on its own data above which the machine has changed.
constexpr double kMinRmsOverEarlier = 2.0;
// RMS over noise floor above which the residual is not chance.
constexpr double kMinRmsOverFloorOfStructure = 4.0;
// RMS over noise floor above which the named causes do not explain the recording.
constexpr double kMaxRmsOverFloorToAccept = 5.0;
// Misfit of any model over the error that its causes remove: a smaller residual is no evidence of a
// further cause.
constexpr double kModelMisfitShare = 0.15;
// RMS over noise floor that the error without a cause must exceed for the cause to be named.
constexpr double kMinRmsOverFloorOfCause = 1.3;
// A suspicion below is none.
constexpr double kMinConfidenceToSuspect = 0.05;
// Share of the squared error above the noise floor: with more unexplained, the verdict is
// "unexplained".
constexpr double kMaxUnexplainedShare = 0.5;

/// Two causes that repeat with position at the same period imitate a third one, and each other: an
/// error of the screw and one of the encoder together can do what a force ripple does.
void mark_common_periods(Diagnosis& diagnosis) {
  const auto period_of = [&](const Cause& cause) {
    const auto& effects = diagnosis.extended.model.effects;
    return cause.place < effects.size()
               ? shape_of(diagnosis.extended.model, effects[cause.place].kind, "period")
               : kAbsent;
  };
  for (Cause& cause : diagnosis.causes) {
    for (const Cause& other : diagnosis.causes) {
      auto& known = cause.ambiguous_with;
      if (&cause == &other || std::find(known.begin(), known.end(), other.id) != known.end())
        continue;
      if (std::abs(period_of(cause) / period_of(other) - 1.0) < kSamePeriod)
        known.push_back(other.id);
    }
  }
}

/// A range of speeds: the first and the last of sorted steps, and its share of the travel.
struct SpeedRange {
  std::size_t first = 0, last = 0;
  double travel = 0.0;
};

/// The range of these sorted steps with the most travel whose speeds hardly differ.
SpeedRange commonest(std::span<const double> steps) {
  constexpr double kWidthOfRange = 1.1;  // highest speed over lowest: the transfer hardly changes
  SpeedRange best;
  double within = 0.0;
  std::size_t first = 0;
  for (std::size_t last = 0; last < steps.size(); ++last) {
    within += steps[last];
    while (steps[first] * kWidthOfRange < steps[last]) within -= steps[first++];
    if (within > best.travel) best = {first, last, within};
  }
  return best;
}

/// Whether the axis moves at one speed, but for the ramps to it.
bool at_one_speed(const std::vector<Segment>& segments) {
  // Shares of the travel: at the speed at least, and in any other range of speeds at most.
  constexpr double kMinShareOfSpeed = 0.5, kMaxShareOfOther = 0.1;
  constexpr double kStep_s = 0.02;  // so long that the resolution of the command does not count
  std::vector<double> steps;
  for (const Segment& segment : segments) {
    const Eigen::Index every =
        std::max<Eigen::Index>(1, std::lround(kStep_s / segment.sample_time_s));
    for (Eigen::Index k = every; k < segment.command.size(); k += every) {
      const double step = std::abs(segment.command[k] - segment.command[k - every]);
      if (step > 0.0) steps.push_back(step);
    }
  }
  std::sort(steps.begin(), steps.end());
  const double all = std::accumulate(steps.begin(), steps.end(), 0.0);
  const SpeedRange most = commonest(steps);
  const std::span<const double> sorted(steps);
  return all > 0.0 && most.travel >= kMinShareOfSpeed * all &&
         commonest(sorted.first(most.first)).travel <= kMaxShareOfOther * all &&
         commonest(sorted.subspan(most.last + 1)).travel <= kMaxShareOfOther * all;
}

/// At one speed a period of the position is one frequency: a force and an error of the reading that
/// repeat with it differ only by a factor, which the fit finds for either.
void mark_at_one_speed(Diagnosis& diagnosis, const std::vector<Segment>& segments) {
  constexpr std::array<std::string_view, 3> kPeriodic{"cogging", "lead_error", "encoder_error"};
  const auto periodic = [&](const Cause& cause) {
    return std::find(kPeriodic.begin(), kPeriodic.end(), cause.id) != kPeriodic.end();
  };
  if (std::none_of(diagnosis.causes.begin(), diagnosis.causes.end(), periodic) ||
      !at_one_speed(segments))
    return;
  for (Cause& cause : diagnosis.causes) {
    if (!periodic(cause)) continue;
    for (const std::string_view rival : kPeriodic) {
      auto& known = cause.ambiguous_with;
      if (rival != cause.id && std::find(known.begin(), known.end(), rival) == known.end())
        known.emplace_back(rival);
    }
    cause.wins = std::min(cause.wins, 1.0 / static_cast<double>(kPeriodic.size()));
  }
}

}  // namespace

bool unforeseeable(const Diagnosis& diagnosis, const Cause& cause) {
  if (cause.place >= diagnosis.extended.model.effects.size()) return false;
  const auto shapes = shapes_of(diagnosis.extended.model.effects[cause.place].kind);
  return !shapes.empty() && shapes.front().scan == Scan::kMoments;
}

bool may_be_zero(const Gain& gain) {
  return gain.low <= 0.0 && gain.after > kMaxRmsRatioOfClearGain * gain.before;
}

void conclude(Diagnosis& diagnosis, const SegmentedAxis& axis, const std::vector<Segment>& holdout,
              const NoiseFloor& floor, const DiagnoseOptions& options) {
  for (Cause& cause : diagnosis.suspected) diagnosis.causes.push_back(std::move(cause));
  diagnosis.suspected.clear();
  std::sort(diagnosis.causes.begin(), diagnosis.causes.end(),
            [](const Cause& l, const Cause& r) { return l.worth > r.worth; });

  mark_common_periods(diagnosis);
  mark_at_one_speed(diagnosis, axis.segments);
  const std::vector<ResidualStretch> stretches =
      residual_stretches(diagnosis.extended.model, holdout);
  diagnosis.regimes = by_regime(stretches);
  diagnosis.regressors = by_regressor(stretches);
  diagnosis.peaks = spectrum_peaks(stretches);
  diagnosis.lag = command_lag(holdout);
  const double noise = std::isfinite(floor.rms) ? floor.rms * floor.rms : 0.0;
  // The error without causes is that of the baseline. An effect that the baseline contains already
  // counts as explained for itself; for the others only where there are none: however much it
  // explains, it says nothing about what they leave.
  const auto in_baseline = [&](const Cause& cause) {
    const auto& effects = diagnosis.extended.model.effects;
    return cause.place < effects.size() && std::isfinite(cause.gain.before) &&
           diagnosis.baseline.model.find(effects[cause.place].kind) != nullptr;
  };
  const double left = diagnosis.extended.holdout.rms * diagnosis.extended.holdout.rms - noise;
  const auto unexplained_of = [&](double error) {
    const double all = error * error - noise;
    return all > 0.0 ? std::clamp(left / all, 0.0, 1.0) : 0.0;
  };
  double without = diagnosis.baseline.holdout.rms;
  if (std::all_of(diagnosis.causes.begin(), diagnosis.causes.end(), in_baseline)) {
    for (const Cause& cause : diagnosis.causes) without = std::max(without, cause.gain.before);
  }
  diagnosis.unexplained_share = unexplained_of(without);
  // Isolated events are not predictable on other motion; the error that they leave on the hold-out
  // is no evidence of another cause.
  const bool no_worse =
      diagnosis.extended.holdout.rms <= kMaxRmsRatioNoWorse * diagnosis.baseline.holdout.rms;
  const bool pushed =
      no_worse && std::any_of(diagnosis.causes.begin(), diagnosis.causes.end(),
                              [&](const Cause& cause) { return unforeseeable(diagnosis, cause); });
  if (pushed) diagnosis.unexplained_share = 0.0;
  // confidence = prior hit rate x P(beats nearest rival) x explained share. The unexplained rest
  // may have a cause that is not in the catalogue.
  for (Cause& cause : diagnosis.causes) {
    const double stays = cause.gain.after / cause.gain.before;
    const double right =
        std::isfinite(stays) ? kHitRate - kHitRateLoss * std::min(1.0, stays * stays) : kHitRate;
    const double unexplained = pushed || !in_baseline(cause)
                                   ? diagnosis.unexplained_share
                                   : unexplained_of(std::max(without, cause.gain.before));
    cause.confidence = cause.counts.empty() ? right * cause.wins * (1.0 - unexplained) : 1.0;
  }
  // The cause that removes the least error is doubted if its gain may be zero. (Impulses are named
  // all the same: other motion cannot confirm them, see the condition below.)
  if (!diagnosis.causes.empty() && may_be_zero(diagnosis.causes.back().gain))
    diagnosis.causes.back().doubt = CauseDoubt::kGain;
  // A disturbance that acts at rest raises the noise floor too; the true floor is not above the
  // residual of the model.
  const double quiet = std::min(floor.rms, diagnosis.extended.holdout.rms);
  // What other motion cannot confirm has at least to stand out where it was found.
  const bool stands_out = !(diagnosis.baseline.training.rms <= kMinRmsOverFloorOfCause * quiet);
  const auto unsure =
      std::stable_partition(diagnosis.causes.begin(), diagnosis.causes.end(), [&](const Cause& c) {
        const bool seen = !c.counts.empty() || !(c.gain.before <= kMinRmsOverFloorOfCause * quiet);
        // Of several ambiguous changes one is real: they are named together, unless their
        // confidence is low for other reasons too.
        const double each = 1.0 / (1.0 + static_cast<double>(c.ambiguous_with.size()));
        const double one_of_them =
            diagnosis.against_earlier && !(c.wins < each) ? c.confidence / each : c.confidence;
        return (one_of_them >= kMinConfidenceToName && c.doubt == CauseDoubt::kNone && seen) ||
               (no_worse && stands_out && unforeseeable(diagnosis, c));
      });
  std::move(unsure, diagnosis.causes.end(), std::back_inserter(diagnosis.suspected));
  diagnosis.causes.erase(unsure, diagnosis.causes.end());
  std::erase_if(diagnosis.suspected,
                [](const Cause& c) { return c.confidence < kMinConfidenceToSuspect; });
  // The error that an earlier model had on its own data is no change of the machine.
  double usual = kMinRmsOverFloorOfStructure * floor.rms;
  if (std::isfinite(diagnosis.earlier_rms))
    usual = std::max(usual, kMinRmsOverEarlier * diagnosis.earlier_rms);
  // Causes that are only suspected do not explain the error.
  const double stays =
      (diagnosis.causes.empty() ? diagnosis.baseline : diagnosis.extended).holdout.rms;
  const bool structured = std::isfinite(usual) && stays > usual;
  // The error that the causes remove. A residual below the usual misfit of a model, as a share of
  // it, is no evidence of another cause.
  const double named = std::sqrt(std::max(
      0.0, without * without - diagnosis.extended.holdout.rms * diagnosis.extended.holdout.rms));
  const bool much_is_left =
      structured && (diagnosis.unexplained_share > kMaxUnexplainedShare ||
                     diagnosis.extended.holdout.rms >
                         std::max(kMaxRmsOverFloorToAccept * floor.rms, kModelMisfitShare * named));
  diagnosis.verdict = much_is_left                ? Verdict::kUnexplained
                      : !diagnosis.causes.empty() ? Verdict::kExplained
                      : structured                ? Verdict::kUnexplained
                                                  : Verdict::kNothingSignificant;
  diagnosis.not_observable =
      not_observable(axis, {diagnosis.against_earlier, options.encoder_in_loop,
                            diagnosis.extended.model.loop.order == 3, Channels(holdout).in_cut});
  std::erase_if(diagnosis.not_observable, [&](const NotObservable& one) {
    const auto is_it = [&](const Cause& cause) { return cause.id == one.id; };
    return std::any_of(diagnosis.causes.begin(), diagnosis.causes.end(), is_it) ||
           std::any_of(diagnosis.suspected.begin(), diagnosis.suspected.end(), is_it);
  });
  diagnosis.suggested_test = suggested_test(diagnosis, axis);
}

}  // namespace servotwin
