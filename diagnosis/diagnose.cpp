#include "diagnosis/diagnose.h"

#include <algorithm>
#include <cmath>

#include "diagnosis/bootstrap.h"
#include "diagnosis/cuts.h"
#include "diagnosis/dropped_samples.h"
#include "diagnosis/selection.h"
#include "identification/noise_floor.h"
#include "twin/twin.h"

namespace servotwin {

namespace {

constexpr double kStructured = 2.0;  // of the noise floor: more is not chance

double root_mean(const std::vector<double>& pieces, const std::vector<std::size_t>& places) {
  double sum = 0.0;
  for (const std::size_t i : places) sum += pieces[i];
  return std::sqrt(sum / static_cast<double>(places.size()));
}

Gain gain_of(const Model& without, const Model& with, const std::vector<Segment>& holdout) {
  const std::vector<double> before = left_by(without, holdout), after = left_by(with, holdout);
  Gain gain;
  gain.before = judge(without, holdout).rms;
  gain.after = judge(with, holdout).rms;
  if (before.size() < 4) return gain;
  const auto differences = bootstrap(before.size(), [&](const std::vector<std::size_t>& places) {
    return root_mean(before, places) - root_mean(after, places);
  });
  gain.low = differences[static_cast<std::size_t>(0.025 * kResamples)];
  gain.high = differences[static_cast<std::size_t>(0.975 * kResamples)];
  return gain;
}

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

Diagnosis diagnose(const SegmentedAxis& recorded, const DiagnoseOptions& options) {
  Diagnosis out;
  SegmentedAxis axis = recorded;
  const NoiseFloor floor = noise_floor(recorded.segments);
  DroppedSamples dropped;
  if (std::find(options.leave_out.begin(), options.leave_out.end(), "dropped_samples") ==
      options.leave_out.end())
    dropped = bridge_dropped(axis, floor.encoder_step);
  const Identified identified = identify(axis, options.identify);
  if (!identified.refusals.empty())
    throw std::runtime_error(axis.axis + ": " + identified.refusals.front());
  out.baseline = identified.record;
  std::vector<Eigen::ArrayXd> residuals;
  for (const Segment& s : axis.segments)
    residuals.emplace_back(s.command - s.actual - simulate(out.baseline.model, s));
  find_cuts(axis.segments, residuals);
  const std::vector<Segment> training = cut(axis.segments, -1e300, out.baseline.training_to_s);
  const std::vector<Segment> holdout =
      cut(axis.segments, out.baseline.training_to_s + 0.5 * axis.sample_time_s, 1e300);

  Search search(training, options.identify.bounds, floor);
  Hypothesis baseline;
  baseline.structure.order = out.baseline.model.loop.order;
  baseline.structure.matched_feedforward = out.baseline.model.find(kind_of<TimeDelay>()) != nullptr;
  for (const Effect& effect : out.baseline.model.effects)
    baseline.structure.effects.push_back(effect.kind);
  if (!search.fit(baseline, {point_of(out.baseline.model, baseline.structure)}))
    throw std::runtime_error(axis.axis + ": the baseline model could not be fitted again");

  const Channels channels(axis.segments);
  const std::vector<std::size_t> baseline_effects = baseline.structure.effects;
  Selected selected = select_causes(search, std::move(baseline), options, channels);
  const Hypothesis& current = selected.model;
  const auto& found = selected.found;
  out.steps = std::move(selected.steps);

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
    if (one.kind == kind_of<TimeDelay>()) {
      // A loop that is fitted again would imitate it.
      Model at_once = extended;
      at_once.effects[i].shape[0] = 0.0;
      cause.gain = gain_of(at_once, extended, holdout);
      cause.without = at_once;
      cause.statistic = paired_z(left_by(at_once, training), left_by(extended, training));
    } else {
      Hypothesis less;
      less.structure = without(current.structure, id, one.kind);
      if (!search.fit(less, {point_of(current.model, less.structure)})) continue;
      cause.gain = gain_of(less.model, extended, holdout);
      cause.without = less.model;
      if (!named) {
        search.judge(less);
        cause.statistic = paired_z(less.pieces, current.pieces);
      }
    }
    if (!named) {
      cause.p = 0.5 * std::erfc(cause.statistic / std::sqrt(2.0));
      cause.confidence = 1.0 - cause.p;
    }
    out.causes.push_back(std::move(cause));
  }
  if (dropped.any()) {
    const std::vector<Segment> as_recorded =
        cut(recorded.segments, out.baseline.training_to_s + 0.5 * axis.sample_time_s, 1e300);
    Cause cause;
    cause.id = "dropped_samples";
    cause.place = kNoEffect;
    cause.confidence = 1.0;  // counted, not inferred
    cause.counts = {{"missing", static_cast<double>(dropped.missing)},
                    {"gaps", static_cast<double>(dropped.gaps)},
                    {"held", static_cast<double>(dropped.held)}};
    if (dropped.held > 0) {  // what is not in the recording has no error
      cause.gain.before = judge(extended, as_recorded).rms;
      cause.gain.after = judge(extended, holdout).rms;
    }
    out.causes.push_back(std::move(cause));
  }
  std::sort(out.causes.begin(), out.causes.end(), [](const Cause& l, const Cause& r) {
    const auto worth = [](const Gain& g) {
      return std::isfinite(g.before) ? g.before * g.before - g.after * g.after : 0.0;
    };
    return worth(l.gain) > worth(r.gain);
  });

  std::vector<ResidualStretch> stretches;
  for (const Segment& s : holdout)
    stretches.push_back(
        {s.command, s.command - s.actual - simulate(extended, s), s.sample_time_s, s.start_s});
  out.regimes = by_regime(stretches);
  out.regressors = by_regressor(stretches);
  out.peaks = spectrum_peaks(stretches);
  const double noise = std::isfinite(floor.rms) ? floor.rms * floor.rms : 0.0;
  const double all = out.baseline.holdout.rms * out.baseline.holdout.rms - noise;
  const double left = out.extended.holdout.rms * out.extended.holdout.rms - noise;
  out.unexplained_share = all > 0.0 ? std::clamp(left / all, 0.0, 1.0) : 0.0;
  out.fits = search.fits();
  const bool structured =
      std::isfinite(floor.rms) && out.extended.holdout.rms > kStructured * floor.rms;
  out.verdict = !out.causes.empty() ? Verdict::kExplained
                : structured        ? Verdict::kUnexplained
                                    : Verdict::kNothingSignificant;
  out.suggested_test = suggested_test(out, recorded);
  return out;
}

}  // namespace servotwin
