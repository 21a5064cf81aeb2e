#include "diagnosis/search/diagnose.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <complex>

#include "diagnosis/evidence/dropped_samples.h"
#include "diagnosis/search/conclusion.h"
#include "diagnosis/search/extension.h"
#include "diagnosis/search/judgement.h"
#include "diagnosis/search/selection.h"
#include "diagnosis/search/unexplained.h"
#include "diagnosis/statistics/text.h"
#include "diagnosis/statistics/thresholds.h"
#include "identification/least_squares/interruption.h"
#include "identification/loop/deviations.h"
#include "identification/loop/joint.h"
#include "identification/loop/pole_search.h"
#include "identification/loop/torque_output.h"
#include "identification/recording/motion_range.h"
#include "identification/recording/noise_floor.h"
#include "identification/torque/torque_limit.h"
#include "twin/shown_units.h"
#include "twin/twin.h"

namespace servotwin {

namespace {

// Unexplained share that a diagnosis with the other loop order must reach: a loop of another order
// can explain a part of the error together with a wrong cause that resembles the right one.
constexpr double kMaxUnexplainedShareOfOtherOrder = 0.1;
// RMS on the hold-out over that without any cause, up to which the causes are not discarded.
constexpr double kMaxRmsRatioToKeepCauses = 1.1;

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

namespace {

/// 1 where the motor is at its torque limit, from the limit in the model or, without one, from the
/// recorded torque; empty where neither is known.
Eigen::ArrayXd saturated(const Model& model, const Segment& s, const Eigen::ArrayXd& simulated) {
  const Effect* limit = motor_limit_of(model);
  if (limit == nullptr) return at_limit(s.torque, s.sample_time_s);
  Signals signals = signals_of(s);
  set_motion(signals, s.command - simulated);
  add_drive(model, signals);
  EffectMemory<double> memory;
  start_memory(limit->kind, limit->shape.data(), memory);
  const std::vector<Motion> motion = motion_along(signals, signals.command, Acts::kForce);
  Eigen::ArrayXd out(s.size());
  for (Eigen::Index k = 0; k < s.size(); ++k) {
    std::array<double, kMaxCoefficients> missing{};
    unit_forces<double>(limit->kind, limit->shape.data(), memory,
                        motion[static_cast<std::size_t>(k)], missing.data());
    // The torque that the motor does give, which equals the limit where it is saturated.
    const double given = signals.demand(k) - missing[0] + limit->shape[2] * signals.velocity(k);
    out(k) = std::abs(given) > (1.0 - 1e-9) * limit->shape[0] ? 1.0 : 0.0;
  }
  return out;
}

}  // namespace

std::vector<Segment> held_out(const std::vector<Segment>& segments, double from_s) {
  return with_lead_in(cut(segments, from_s, 1e300), segments);
}

std::vector<ResidualStretch> residual_stretches(const Model& model,
                                                const std::vector<Segment>& segments) {
  std::vector<ResidualStretch> out;
  for (const Segment& s : segments) {
    const Eigen::ArrayXd simulated = simulate(model, s);
    // Begins where the hold-out is judged from: the samples before estimate the starting state.
    const Eigen::Index from = std::max(s.lead, starting_state_samples(model, s));
    if (s.size() <= from + 10) continue;
    const Eigen::Index count = s.size() - from;
    Eigen::ArrayXd limited = saturated(model, s, simulated);
    if (limited.size() > 0) limited = limited.tail(count).eval();
    out.push_back({s.command.tail(count), (s.command - s.actual - simulated).tail(count),
                   s.sample_time_s, s.start_s + s.sample_time_s * static_cast<double>(from),
                   std::move(limited)});
  }
  return out;
}

void set_extended(ModelRecord& record, const char* method, const Model& model,
                  const std::vector<Segment>& training, const std::vector<Segment>& holdout) {
  record.model = model;
  record.method = method;
  record.training = judge(model, training);
  record.holdout = judge(model, holdout);
  record.effect_deviations.assign(model.effects.size(), {});
  record.denominator_deviation.fill(kAbsent);
  record.numerator_deviation.fill(kAbsent);
  record.pole_deviation = {kAbsent, kAbsent, kAbsent};
  record.loop_covariance.reset();
}

namespace {

/// The share of time for training, so that it contains `share` of the squared error. Returns
/// `share` itself unless the error is so unevenly distributed over the recording that training data
/// or hold-out would contain hardly any of it.
double balanced_share(const Model& model, const std::vector<Segment>& segments, double noise,
                      double share) {
  // Range of the share of the squared error in the training data that needs no other division.
  constexpr double kMinErrorShare = 0.35, kMaxErrorShare = 0.85;
  constexpr double kMinTimeShare = 0.3, kMaxTimeShare = 0.85;  // of the training data
  const double floor = std::isfinite(noise) ? noise * noise : 0.0;
  std::vector<double> sums{0.0};
  for (const double piece : left_by(model, segments))
    sums.push_back(sums.back() + std::max(0.0, piece - floor));
  const auto n = static_cast<double>(sums.size() - 1);
  const double there = sums[static_cast<std::size_t>(share * n)] / sums.back();
  if (!(there < kMinErrorShare) && !(there > kMaxErrorShare)) return share;
  const auto at = std::lower_bound(sums.begin(), sums.end(), share * sums.back());
  return std::clamp(static_cast<double>(at - sums.begin()) / n, kMinTimeShare, kMaxTimeShare);
}

/// The model without its i-th effect; the baseline where that effect replaced another one.
Model without_effect(const Model& model, std::size_t i, const Model& baseline) {
  if (!identity_of(model.effects[i].kind).replaces.empty()) return baseline;
  Model out = model;
  out.effects.erase(out.effects.begin() + static_cast<std::ptrdiff_t>(i));
  return out;
}

/// Doubts the causes whose gain on held-out data may be zero. Of several equivalent causes each has
/// no gain beside the others: starting with the least, each is tested without the causes already
/// doubted, and gets the gain that it has there.
void doubt(std::vector<Cause>& causes, const Hypothesis& all, Search& search,
           const std::vector<Segment>& holdout) {
  const auto unsure = [](const Gain& gain) { return gain.low <= 0.0; };
  std::vector<Cause*> asked;
  for (Cause& cause : causes) {
    if (unsure(cause.gain)) asked.push_back(&cause);
  }
  std::sort(asked.begin(), asked.end(),
            [](const Cause* l, const Cause* r) { return l->worth < r->worth; });
  Hypothesis rest = all;
  for (Cause* cause : asked) {
    Hypothesis less;
    const std::size_t kind = all.model.effects[cause->place].kind;
    less.structure = without(rest.structure, cause->id, kind);
    // The law of a cause that was doubted may have contained it.
    const bool contained = less.structure.effects == rest.structure.effects;
    if (contained || !search.fit_less(less, {point_of(all.model, less.structure)}, rest.model)) {
      cause->doubt = CauseDoubt::kGain;
      continue;
    }
    if (cause != asked.front()) {
      const Gain alone = gain_of(less.model, rest.model, holdout);
      if (!unsure(alone)) {
        cause->gain.before = alone.before;
        cause->gain.after = alone.after;
        cause->gain.low = alone.low;
        cause->gain.high = alone.high;
        cause->worth = worth_of(alone);
        continue;
      }
    }
    cause->doubt = CauseDoubt::kGain;
    rest = std::move(less);
  }
}

/// The model that the diagnosis starts from.
ModelRecord identified_baseline(const SegmentedAxis& axis, const DiagnoseOptions& options) {
  IdentifyOptions loop = options.identify;
  if (options.leaves_out("time_delay")) loop.delay_max_s = 0.0;
  loop.must_predict = false;  // the diagnosis is about what it does not predict
  loop.with_torque = false;   // diagnosed beside the position
  loop.beyond_loop = false;   // sought beside the causes, a part of which it would hide
  Identified identified = identify(axis, loop);
  if (!identified.exchanged.empty())
    throw UnusableRecording(axis.axis + ": " + identified.exchanged);
  if (!identified.refusals.empty())
    throw std::runtime_error(axis.axis + ": " + identified.refusals.front());
  identified.record.motion = motion_range(axis.segments);
  return std::move(identified.record);
}

/// That model fitted again without the causes that are left out, which `baseline` gets then.
Hypothesis refitted_baseline(ModelRecord& baseline, Search& search, const std::string& axis,
                             const DiagnoseOptions& options) {
  Hypothesis out;
  out.structure.order = baseline.model.loop.order;
  out.structure.matched_feedforward = baseline.model.find(kind_of<TimeDelay>()) != nullptr;
  for (const Effect& effect : baseline.model.effects) {
    if (!options.leaves_out(cause_of(effect.kind))) out.structure.effects.push_back(effect.kind);
  }
  if (!search.fit(out, {point_of(baseline.model, out.structure)}))
    throw std::runtime_error(axis + ": the baseline model could not be fitted again");
  if (out.structure.effects.size() < baseline.model.effects.size()) baseline.model = out.model;
  return out;
}

/// Measures the gain of each cause: the model is refitted without it, with all other causes.
class GainOfCauses {
 public:
  /// All must outlive it. `model`: the one with all causes.
  GainOfCauses(const Model& baseline, const Model& model, const Selected& selected, Search& search,
               const std::vector<Segment>& holdout)
      : baseline_(baseline),
        model_(model),
        selected_(selected),
        search_(search),
        holdout_(holdout) {}

  [[nodiscard]] Cause of(const std::string& id, const Found& found) const {
    const bool named = selected_.found.count(id) > 0;
    Cause cause = found.cause;
    cause.id = id;
    while (model_.effects[cause.place].kind != found.kind) ++cause.place;
    Hypothesis less = without_cause(id, found.kind, cause.place, named);
    const Gain fitted_again = gain_of(less.model, model_, holdout_);
    cause.worth = worth_of(fitted_again);
    if (found.kind == kind_of<TimeDelay>()) {
      of_delay(cause, less.model, fitted_again);
    } else {
      cause.gain = fitted_again;
      // A law of friction that replaces another one is nothing that could be repaired.
      const auto laws = friction_kinds();
      if (identity_of(found.kind).replaces.empty() &&
          std::find(laws.begin(), laws.end(), found.kind) == laws.end()) {
        judge_repair(model_, without_effect(model_, cause.place, baseline_), holdout_, cause.gain);
      }
      cause.without = less.model;
      if (!named) {
        search_.judge(less);
        cause.statistic = paired_z(less.pieces, selected_.model.pieces);
      }
    }
    if (!named) {
      cause.p = 0.5 * std::erfc(cause.statistic / std::sqrt(2.0));
      cause.wins = 1.0 - cause.p;
    }
    return cause;
  }

 private:
  /// The model refitted without a cause. `place`: of its effect. `named`: by the selection.
  [[nodiscard]] Hypothesis without_cause(const std::string& id, std::size_t kind, std::size_t place,
                                         bool named) const {
    const Hypothesis& current = selected_.model;
    Hypothesis less;
    less.structure = without(current.structure, id, kind);
    // If that fit fails, the effect is removed without a refit.
    less.model = without_effect(model_, place, baseline_);
    less.point = point_of(less.model, less.structure);
    if (kind == kind_of<TimeDelay>()) {
      // Without the delay the loop may have a velocity error that looks like a delay, but not the
      // zeros that no drive has.
      less.structure.matched_feedforward = false;
      for (const std::vector<Point>& from :
           {std::vector<Point>{point_of(current.model, less.structure)}, std::vector<Point>{}}) {
        Hypothesis lagging;
        lagging.structure = less.structure;
        if (search_.fit(lagging, from) && !delay_in_disguise(lagging.model.loop) &&
            lagging.cost < less.cost)
          less = std::move(lagging);
      }
      // If the search found a model without the delay, that is the comparison.
      if (!named && selected_.undelayed) less = *selected_.undelayed;
      return less;
    }
    if (Hypothesis fitted = less; search_.fit_less(
            fitted, {point_of(current.model, less.structure), point_of(baseline_, less.structure)},
            model_)) {
      less = std::move(fitted);
    }
    // The baseline never had a cause that was found later, and may be the better model without it.
    const std::vector<Segment>& training = search_.training();
    if (baseline_.find(kind) == nullptr &&
        judge(baseline_, training).rms < judge(less.model, training).rms)
      less.model = baseline_;
    return less;
  }

  /// Compares with the same loop without the delay or, where that is better, with a loop that
  /// imitates the delay.
  void of_delay(Cause& cause, const Model& imitation, const Gain& against_imitation) const {
    const std::vector<Segment>& training = search_.training();
    Model at_once = model_;
    at_once.effects[cause.place].shape[0] = 0.0;
    cause.gain = gain_of(at_once, model_, holdout_);
    cause.without = at_once;
    cause.statistic = paired_z(left_by(at_once, training), left_by(model_, training));
    if (against_imitation.before < cause.gain.before) {
      cause.gain = against_imitation;
      cause.without = imitation;
      cause.statistic = paired_z(left_by(imitation, training), left_by(model_, training));
    }
  }

  const Model& baseline_;
  const Model& model_;
  const Selected& selected_;
  Search& search_;
  const std::vector<Segment>& holdout_;
};

/// `as_recorded`: the hold-out before the samples were bridged.
Cause cause_of_dropped(const DroppedSamples& dropped, const Model& model,
                       const std::vector<Segment>& as_recorded,
                       const std::vector<Segment>& holdout) {
  Cause cause;
  cause.id = "dropped_samples";
  cause.place = kNoEffect;
  cause.counts = {{"missing", static_cast<double>(dropped.missing)},
                  {"gaps", static_cast<double>(dropped.gaps)},
                  {"held", static_cast<double>(dropped.held)}};
  if (dropped.held > 0) {  // samples that are missing have no error
    cause.gain.before = judge(model, as_recorded).rms;
    cause.gain.after = judge(model, holdout).rms;
    cause.worth = worth_of(cause.gain);
  }
  return cause;
}

/// The diagnosis with the division of the recording into training data and hold-out by the options.
Diagnosis diagnose_divided(const SegmentedAxis& recorded, const DiagnoseOptions& options) {
  Diagnosis out;
  SegmentedAxis axis = recorded;
  const NoiseFloor floor = noise_floor(recorded.segments);
  DroppedSamples dropped;
  if (!options.leaves_out("dropped_samples")) dropped = bridge_dropped(axis, floor.encoder_step);
  options.begin("the loop and its friction");
  out.baseline = identified_baseline(axis, options);
  Search search(axis.segments, out.baseline.training_to_s, options.identify.bounds, floor,
                axis.rotary);
  Hypothesis baseline = refitted_baseline(out.baseline, search, axis.axis, options);
  const std::vector<std::size_t> baseline_effects = baseline.structure.effects;
  Selected selected = select_causes(search, baseline, options);
  const double holdout_from_s = out.baseline.training_to_s + 0.5 * axis.sample_time_s;
  const std::vector<Segment> holdout = held_out(search.recorded(), holdout_from_s);
  const double worst = kMaxRmsRatioToKeepCauses * judge(selected.settled.model, holdout).rms;
  if (const double rms = judge(selected.model.model, holdout).rms;
      std::isfinite(worst) && !(rms < worst)) {
    selected.steps.push_back(text("the causes raise the error on held-out data (%s RMS): discarded",
                                  micro_text(rms, axis.rotary).c_str()));
    selected.model = selected.settled;
    selected.found.clear();
    search.follow(selected.model);
    search.judge(selected.model);
  }
  const Hypothesis& current = selected.model;
  const auto& found = selected.found;
  out.steps.insert(out.steps.end(), selected.steps.begin(), selected.steps.end());
  const std::vector<Segment>& training = search.training();
  // The gain of better values of the same parameters is not a gain of a cause: the baseline gets
  // them.
  const ErrorFigures settled = judge(selected.settled.model, training);
  if (settled.rms < judge(out.baseline.model, training).rms) {
    out.baseline.model = selected.settled.model;
    out.baseline.training = settled;
  }

  out.baseline.holdout = judge(out.baseline.model, held_out(recorded.segments, holdout_from_s));
  out.extended = out.baseline;
  out.extended.holdout = judge(out.baseline.model, holdout);
  if (!found.empty() || current.structure.effects != baseline_effects)
    set_extended(out.extended, "diagnosis", current.model, training, holdout);
  set_deviations(out.extended, training, floor.encoder_step);

  const Model& extended = out.extended.model;
  std::map<std::string, Found> causes = found;
  for (const Effect& effect : extended.effects) {
    if (const std::string id = cause_of(effect.kind); !id.empty() && causes.count(id) == 0)
      causes[id].kind = effect.kind;
  }
  options.begin("each cause left out");
  const GainOfCauses gain(out.baseline.model, extended, selected, search, holdout);
  for (const auto& [id, one] : causes) {
    if (extended.find(one.kind) != nullptr) out.causes.push_back(gain.of(id, one));
  }
  doubt(out.causes, current, search, holdout);
  const bool cuts_recorded = recorded.segments.front().in_cut.size() > 0;
  for (Cause& cause : out.causes) {
    cause.at_end = end_text(cause.id, extended, extended.effects[cause.place],
                            length_scale(recorded.segments));
    if (!cause.at_end.empty()) cause.doubt = CauseDoubt::kParameters;
    // Two masses have many parameters, and cuts that were not recorded are found in the residual
    // itself: a small gain may be that of any better fit.
    const std::size_t kind = extended.effects[cause.place].kind;
    const bool flexible = acts_on_axis(kind) || (kind == kind_of<CuttingForce>() && !cuts_recorded);
    if (flexible && cause.gain.after > kMaxRmsRatioOfClearGain * cause.gain.before)
      cause.doubt = CauseDoubt::kGain;
  }
  if (dropped.any(floor.rms)) {
    const std::vector<Segment> as_recorded = held_out(recorded.segments, holdout_from_s);
    out.causes.push_back(cause_of_dropped(dropped, extended, as_recorded, holdout));
  }
  out.fits = search.fits();
  conclude(out, recorded, holdout, floor, options);
  if (out.verdict != Verdict::kUnexplained) return out;
  if (const auto better = with_unexplained(out.extended.model, training)) {
    out.not_understood = out.extended.model.effects.size();
    out.extended.model = *better;
    out.extended.method = "diagnosis";
    set_deviations(out.extended, training, floor.encoder_step);
    out.extended.training = judge(*better, training);
    out.extended.holdout = judge(*better, holdout);
    conclude(out, recorded, holdout, floor, options);
    out.verdict = Verdict::kUnexplained;
  }
  return out;
}

/// A second diagnosis of the same recording with other options, after a first one that explains too
/// little.
struct SecondAttempt {
  std::string words;  ///< what is different, for the steps
  DiagnoseOptions options;
  /// Unexplained share that it must stay below to be accepted.
  double max_unexplained_share = 1.0;

  [[nodiscard]] bool explains(const Diagnosis& first, const Diagnosis& second) const {
    const bool same_data = second.baseline.training_to_s == first.baseline.training_to_s;
    const bool leaves_more =
        second.extended.holdout.rms > kMaxRmsRatioNoWorse * first.extended.holdout.rms && same_data;
    return second.unexplained_share < max_unexplained_share && !leaves_more &&
           (second.verdict == Verdict::kExplained || second.causes.size() > first.causes.size());
  }
};

/// RMS that a loop of this order leaves with Coulomb friction, and the constant force that an
/// integrator would balance, in the first `share` of the time [m | rad].
double left_by_order(int order, const SegmentedAxis& axis, double share, const PoleBounds& bounds) {
  constexpr double kStep_s = 4e-3;  // the orders differ by far more than what thinning changes
  const double begin = axis.segments.front().start_s, end = axis.segments.back().end_s();
  std::vector<Signals> signals;
  for (const Segment& s : cut(axis.segments, -1e300, begin + share * (end - begin)))
    signals.push_back(signals_of(s));
  PoleSearchOptions search;
  search.bounds = bounds;
  search.tolerance = 1e-4;
  Structure structure;
  structure.order = order;
  structure.effects = {kind_of<CoulombFriction>()};
  if (order == 2) structure.effects.push_back(kind_of<ConstantForce>());
  const Projection data = thinned(signals, structure, kStep_s);
  const auto found = pole_search(data, search);
  return found ? std::sqrt(2.0 * found->solution.cost / static_cast<double>(data.rows())) : 1e300;
}

std::vector<SecondAttempt> second_attempts(const Diagnosis& first, const SegmentedAxis& axis,
                                           const DiagnoseOptions& options) {
  std::vector<SecondAttempt> out;
  // Each attempt keeps what the one before it changed: a loop of the right order is not found in
  // training data that hardly contain the error.
  SecondAttempt next{"repeated", options};
  const double before = options.identify.training_share.value_or(training_share_of(axis.segments));
  const double share =
      balanced_share(first.extended.model, axis.segments, first.baseline.noise_floor.rms, before);
  if (options.balance && share != before) {
    next.words += text(" with %.0f %% of the time as training data", 100.0 * share);
    next.options.identify.training_share = share;
    out.push_back(next);
  }
  // A cause that makes most of the error distorts the loop that is fitted without it.
  const int present = first.baseline.model.loop.order, order = present == 2 ? 3 : 2;
  const double of_time = next.options.identify.training_share.value_or(before);
  const auto left = [&](int one) {
    return left_by_order(one, axis, of_time, options.identify.bounds);
  };
  if (options.identify.order == 0 && left(order) < kMaxRmsRatioOfOtherOrder * left(present)) {
    next.words += text("%s with a loop of order %d", out.empty() ? "" : " and", order);
    next.options.identify.order = order;
    next.max_unexplained_share = kMaxUnexplainedShareOfOtherOrder;
    out.push_back(next);
  }
  return out;
}

/// The diagnosis, and further attempts where the first one explains too little.
Diagnosis diagnose_repeatedly(const SegmentedAxis& axis, const DiagnoseOptions& options) {
  Diagnosis first = diagnose_divided(axis, options);
  const auto isolated = [&](const Cause& cause) { return unforeseeable(first, cause); };
  if (first.verdict != Verdict::kUnexplained ||
      std::any_of(first.causes.begin(), first.causes.end(), isolated) ||
      std::any_of(first.suspected.begin(), first.suspected.end(), isolated))
    return first;
  for (const SecondAttempt& attempt : second_attempts(first, axis, options)) {
    try {
      Diagnosis second = diagnose_divided(axis, attempt.options);
      if (attempt.explains(first, second)) {
        first.steps.push_back(attempt.words);
        second.steps.insert(second.steps.begin(), first.steps.begin(), first.steps.end());
        return second;
      }
      first.steps.push_back(attempt.words + ": explains no more");
    } catch (const std::runtime_error& error) {
      first.steps.push_back(attempt.words + ": " + error.what());
    }
  }
  return first;
}

/// The diagnosis of what the axis does while its motor is not at its limit, where that is enough.
Diagnosis diagnose_away_from_limit(const SegmentedAxis& axis, const DiagnoseOptions& options) {
  const TorqueLimit limit = torque_limit(axis.segments);
  if (!limit.found() || options.leaves_out("torque_saturation"))
    return diagnose_repeatedly(axis, options);
  SegmentedAxis free = axis;
  free.segments = away_from(limit, axis.segments);
  Diagnosis out;
  if (!free.segments.empty()) {
    try {
      out = diagnose_repeatedly(free, options);
      out.limit_left_out = true;
    } catch (const std::runtime_error&) {  // what is left has no motion where a fit needs it
    }
  }
  if (!out.limit_left_out) out = diagnose_repeatedly(axis, options);
  out.at_limit =
      text("%.4g %s in %zu moment%s (%.3g s in all)", limit.level, axis.torque_unit.c_str(),
           limit.moments.size(), limit.moments.size() == 1 ? "" : "s", limit.duration_s());
  return out;
}

}  // namespace

void DiagnoseOptions::begin(std::string_view what) const {
  throw_if_interrupted();
  if (progress) progress(what);
}

Diagnosis diagnose(const SegmentedAxis& axis, const DiagnoseOptions& options) {
  require_encoder(axis);
  Diagnosis out = diagnose_away_from_limit(axis, options);
  // Asked of the loop beside the causes: that of the baseline may be any, where they are large.
  for (const std::complex<double>& root : roots_of(out.extended.model.loop)) {
    if (root.imag() <= 0.0) continue;
    if (const std::string why = why_too_few_samples(std::abs(root), axis.sample_time_s);
        !why.empty())
      throw std::runtime_error(axis.axis + ": " + why);
  }
  if (has_torque(axis)) {
    const double share = options.identify.training_share.value_or(training_share_of(axis.segments));
    out.extended.torque =
        motor_torque(out.extended.model, torque_data(axis, share, options.identify.split_each))
            .torque;
  }
  return out;
}

}  // namespace servotwin
