#include "diagnosis/diagnose.h"

#include <algorithm>
#include <cmath>

#include "diagnosis/dropped_samples.h"
#include "diagnosis/selection.h"
#include "diagnosis/unexplained.h"
#include "identification/joint.h"
#include "identification/noise_floor.h"
#include "twin/twin.h"

namespace servotwin {

namespace {

// How often a cause is right that takes all of the error away, and how much less one that takes
// next to nothing: what the catalogue does not know is not in its own figures. Chosen, not fitted;
// how well it holds is measured (docs/measurements.md 11, calibration error).
constexpr double kRight = 0.97, kLessRight = 0.4;
constexpr double kGrown = 2.0;            // times what the earlier model left: something changed
constexpr double kStructured = 4.0;       // of the noise floor: more is not chance
constexpr double kFar = 5.0;              // of the noise floor: there is more than what is named
constexpr double kLeavesOfItself = 0.15;  // of the error that it takes away, any model
constexpr double kMost = 0.5;  // of the squared error beyond the floor: then nothing is explained

}  // namespace

std::string_view name_of(Verdict verdict) {
  switch (verdict) {
    case Verdict::kExplained:
      return "explained";
    case Verdict::kNothingSignificant:
      return "nothing_significant";
    case Verdict::kUnexplained:
      return "unexplained";
  }
  return "";
}

void conclude(Diagnosis& diagnosis, const SegmentedAxis& axis, const std::vector<Segment>& holdout,
              const NoiseFloor& floor) {
  std::sort(diagnosis.causes.begin(), diagnosis.causes.end(),
            [](const Cause& l, const Cause& r) { return l.worth > r.worth; });

  std::vector<ResidualStretch> stretches;
  for (const Segment& s : holdout)
    stretches.push_back({s.command, s.command - s.actual - simulate(diagnosis.extended.model, s),
                         s.sample_time_s, s.start_s});
  diagnosis.regimes = by_regime(stretches);
  diagnosis.regressors = by_regressor(stretches);
  diagnosis.peaks = spectrum_peaks(stretches);
  const double noise = std::isfinite(floor.rms) ? floor.rms * floor.rms : 0.0;
  // A cause that the baseline has already is explained by it.
  double without = diagnosis.baseline.holdout.rms;
  for (const Cause& cause : diagnosis.causes) {
    if (std::isfinite(cause.gain.before)) without = std::max(without, cause.gain.before);
  }
  const double all = without * without - noise;
  const double left = diagnosis.extended.holdout.rms * diagnosis.extended.holdout.rms - noise;
  diagnosis.unexplained_share = all > 0.0 ? std::clamp(left / all, 0.0, 1.0) : 0.0;
  // What happens at unforeseeable moments is not to be predicted, and what it leaves on other
  // motion is no evidence of another cause.
  const auto unforeseeable = [&](const Cause& cause) {
    if (cause.place >= diagnosis.extended.model.effects.size()) return false;
    const auto shapes = shapes_of(diagnosis.extended.model.effects[cause.place].kind);
    return !shapes.empty() && shapes.front().scan == Scan::kMoments;
  };
  const bool no_worse = diagnosis.extended.holdout.rms <= diagnosis.baseline.holdout.rms;
  const bool pushed =
      no_worse && std::any_of(diagnosis.causes.begin(), diagnosis.causes.end(), unforeseeable);
  if (pushed) diagnosis.unexplained_share = 0.0;
  // As sure as such a cause has been right, as it beats its rivals of the catalogue, and as all of
  // them together explain: what is left may be of a cause that is not in it.
  for (Cause& cause : diagnosis.causes) {
    const double stays = cause.gain.after / cause.gain.before;
    const double right =
        std::isfinite(stays) ? kRight - kLessRight * std::min(1.0, stays * stays) : kRight;
    cause.confidence =
        cause.counts.empty() ? right * cause.beaten * (1.0 - diagnosis.unexplained_share) : 1.0;
  }
  // What an earlier model was wrong by of itself is no change of the machine.
  double usual = kStructured * floor.rms;
  if (std::isfinite(diagnosis.earlier_rms)) usual = std::max(usual, kGrown * diagnosis.earlier_rms);
  const bool structured = std::isfinite(usual) && diagnosis.extended.holdout.rms > usual;
  // What is named takes most away, and as models of friction go what they leave is not of another
  // cause.
  const double named = std::sqrt(std::max(
      0.0, without * without - diagnosis.extended.holdout.rms * diagnosis.extended.holdout.rms));
  const bool much_is_left = structured && (diagnosis.unexplained_share > kMost ||
                                           diagnosis.extended.holdout.rms >
                                               std::max(kFar * floor.rms, kLeavesOfItself * named));
  diagnosis.verdict = much_is_left                ? Verdict::kUnexplained
                      : !diagnosis.causes.empty() ? Verdict::kExplained
                      : structured                ? Verdict::kUnexplained
                                                  : Verdict::kNothingSignificant;
  diagnosis.suggested_test = suggested_test(diagnosis, axis);
}

Diagnosis diagnose(const SegmentedAxis& recorded, const DiagnoseOptions& options) {
  Diagnosis out;
  SegmentedAxis axis = recorded;
  const NoiseFloor floor = noise_floor(recorded.segments);
  const auto is_left_out = [&](std::string_view cause) {
    const auto& all = options.leave_out;
    return std::find(all.begin(), all.end(), cause) != all.end();
  };
  DroppedSamples dropped;
  if (!is_left_out("dropped_samples")) dropped = bridge_dropped(axis, floor.encoder_step);
  IdentifyOptions loop = options.identify;
  if (is_left_out("time_delay")) loop.delay_max_s = 0.0;
  const Identified identified = identify(axis, loop);
  if (!identified.refusals.empty())
    throw std::runtime_error(axis.axis + ": " + identified.refusals.front());
  out.baseline = identified.record;
  Search search(axis.segments, out.baseline.training_to_s, options.identify.bounds, floor);
  Hypothesis baseline;
  baseline.structure.order = out.baseline.model.loop.order;
  baseline.structure.matched_feedforward = out.baseline.model.find(kind_of<TimeDelay>()) != nullptr;
  for (const Effect& effect : out.baseline.model.effects) {
    if (!is_left_out(cause_of(effect.kind))) baseline.structure.effects.push_back(effect.kind);
  }
  if (!search.fit(baseline, {point_of(out.baseline.model, baseline.structure)}))
    throw std::runtime_error(axis.axis + ": the baseline model could not be fitted again");
  if (baseline.structure.effects.size() < out.baseline.model.effects.size())
    out.baseline.model = baseline.model;

  const std::vector<std::size_t> baseline_effects = baseline.structure.effects;
  Selected selected = select_causes(search, std::move(baseline), options);
  const Hypothesis& current = selected.model;
  const auto& found = selected.found;
  out.steps = std::move(selected.steps);
  const std::vector<Segment>& training = search.training();
  const std::vector<Segment> holdout =
      cut(search.recorded(), out.baseline.training_to_s + 0.5 * axis.sample_time_s, 1e300);

  out.baseline.holdout =
      judge(out.baseline.model,
            cut(recorded.segments, out.baseline.training_to_s + 0.5 * axis.sample_time_s, 1e300));
  out.extended = out.baseline;
  out.extended.holdout = judge(out.baseline.model, holdout);
  if (!found.empty() || current.structure.effects != baseline_effects) {
    Model& model = out.extended.model;
    model = current.model;
    out.extended.method = "diagnosis";
    out.extended.training = judge(model, training);
    out.extended.holdout = judge(model, holdout);
  }
  out.extended.effect_deviations.assign(out.extended.model.effects.size(), {});

  // What each is worth: everything else as it is, fitted again without it.
  const Model& extended = out.extended.model;
  std::map<std::string, Found> causes = found;
  for (const Effect& effect : extended.effects) {
    if (const std::string id = cause_of(effect.kind); !id.empty() && causes.count(id) == 0)
      causes[id].kind = effect.kind;
  }
  for (const auto& [id, one] : causes) {
    if (extended.find(one.kind) == nullptr) continue;
    const bool named = found.count(id) > 0;
    Cause cause = one.cause;
    cause.id = id;
    while (extended.effects[cause.place].kind != one.kind) ++cause.place;
    const std::size_t i = cause.place;
    Hypothesis less;
    less.structure = without(current.structure, id, one.kind);
    if (!search.fit(less, {point_of(current.model, less.structure)})) continue;
    const Gain fitted_again = gain_of(less.model, extended, holdout);
    cause.worth = worth_of(fitted_again);
    if (one.kind == kind_of<TimeDelay>()) {
      // At once, or, where that is better, with a loop that imitates it.
      Model at_once = extended;
      at_once.effects[i].shape[0] = 0.0;
      cause.gain = gain_of(at_once, extended, holdout);
      cause.without = at_once;
      cause.statistic = paired_z(left_by(at_once, training), left_by(extended, training));
      if (fitted_again.before < cause.gain.before) {
        cause.gain = fitted_again;
        cause.without = less.model;
        cause.statistic = paired_z(left_by(less.model, training), left_by(extended, training));
      }
    } else {
      cause.gain = fitted_again;
      // A law that takes the place of another has nothing that could be taken off the machine.
      const auto laws = friction_kinds();
      if (identity_of(one.kind).replaces.empty() &&
          std::find(laws.begin(), laws.end(), one.kind) == laws.end()) {
        Model repaired = extended;
        repaired.effects.erase(repaired.effects.begin() + static_cast<std::ptrdiff_t>(i));
        judge_repair(extended, repaired, holdout, cause.gain);
      }
      cause.without = less.model;
      if (!named) {
        search.judge(less);
        cause.statistic = paired_z(less.pieces, current.pieces);
      }
    }
    if (!named) {
      cause.p = 0.5 * std::erfc(cause.statistic / std::sqrt(2.0));
      cause.beaten = 1.0 - cause.p;
    }
    out.causes.push_back(std::move(cause));
  }
  if (dropped.any()) {
    const std::vector<Segment> as_recorded =
        cut(recorded.segments, out.baseline.training_to_s + 0.5 * axis.sample_time_s, 1e300);
    Cause cause;
    cause.id = "dropped_samples";
    cause.place = kNoEffect;
    cause.counts = {{"missing", static_cast<double>(dropped.missing)},
                    {"gaps", static_cast<double>(dropped.gaps)},
                    {"held", static_cast<double>(dropped.held)}};
    if (dropped.held > 0) {  // what is not in the recording has no error
      cause.gain.before = judge(extended, as_recorded).rms;
      cause.gain.after = judge(extended, holdout).rms;
      cause.worth = worth_of(cause.gain);
    }
    out.causes.push_back(std::move(cause));
  }
  out.fits = search.fits();
  conclude(out, recorded, holdout, floor);
  if (out.verdict != Verdict::kUnexplained) return out;
  if (const auto better = with_unexplained(out.extended.model, training)) {
    out.not_understood = out.extended.model.effects.size();
    out.extended.model = *better;
    out.extended.method = "diagnosis";
    out.extended.effect_deviations.emplace_back();
    out.extended.training = judge(*better, training);
    out.extended.holdout = judge(*better, holdout);
    conclude(out, recorded, holdout, floor);
    out.verdict = Verdict::kUnexplained;
  }
  return out;
}

}  // namespace servotwin
