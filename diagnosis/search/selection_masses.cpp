// Two masses in the search for causes.
#include <algorithm>
#include <cmath>
#include <limits>

#include "diagnosis/search/selector.h"
#include "diagnosis/statistics/thresholds.h"
#include "identification/loop/structure_choice.h"
#include "identification/loop/two_mass_fit.h"
#include "twin/two_mass_axis.h"

namespace servotwin {

namespace {

// RMS of two masses over that of a model whose compliance is none of a machine, or stands beside a
// filter of the control, up to which they take its place: beside the loop such a vibration follows
// two masses closely, with a frequency and a damping that are those of no spring, and a filter and
// a mode have twice their parameters.
constexpr double kMaxRmsRatioOfSpring = 1.02;
// The same over that of a model with a filter of the control, which has more parameters and leaves
// little where it stands for a load on a spring; both without the noise.
constexpr double kMaxRatioOverFilter = 0.9;

// RMS over noise floor above which they are tried even where nothing that vibrates or has a gap is
// promising beside the rigid axis.
constexpr double kMinRmsOverFloorUnscreened = 4.0;
// RMS over noise floor above which they are tried in place of a filter of the control.
constexpr double kMinRmsOverFloorOfFilter = 1.1;
// Share of the squared error that a mode or a gap must promise where friction explains ten times
// what is left (docs/theory.md 10).
constexpr double kMinGainBesideMisfit = 1.0 - kMaxErrorRatioOfNearlyAll * kMaxErrorRatioOfNearlyAll;

const std::vector<std::size_t> kModeAndGaps{kind_of<Compliance>(), kind_of<Backlash>(),
                                            kind_of<BacklashInLoop>(),
                                            kind_of<BacklashBehindEncoder>()};

/// Whether its compliance is none of a machine.
bool vibrates_like_no_machine(const Model& model) {
  const Effect* mode = model.find(kind_of<Compliance>());
  constexpr double kScale = 1.0;  // a vibration has no lengths
  return mode != nullptr && at_end_of("compliance", model, *mode, kScale);
}

/// The most that a spring may leave to be accepted in place of a model that leaves `rms`. `floor`:
/// the noise floor.
double most_of_spring(const Model& without, double rms, double floor) {
  const bool filtered = without.find(kind_of<ControlFilter>()) != nullptr,
             mode = without.find(kind_of<Compliance>()) != nullptr;
  if ((filtered && mode) || vibrates_like_no_machine(without)) return kMaxRmsRatioOfSpring * rms;
  if (!filtered) return kMaxRmsRatioClearlyBetter * rms;
  // As Search::ratio_beyond_noise().
  const double noise = std::isfinite(floor) ? std::min(floor, rms) : 0.0;
  return std::hypot(noise, kMaxRatioOverFilter * std::sqrt(rms * rms - noise * noise));
}

/// The same of two masses of either kind.
double most_of(const Model& two_masses, const Model& without, double rms, double floor) {
  return plays(two_masses) ? kMaxRmsRatioClearlyBetter * rms : most_of_spring(without, rms, floor);
}

}  // namespace

bool Selector::part_masses() {
  if (!may_have_two_masses()) return false;
  const std::vector<std::size_t> kinds = two_mass_kinds(), laws = permitted_laws();
  if (kinds.empty()) return false;
  const auto left_by = [&](const Hypothesis& h) {  // in the training data
    return h.structure.effects.empty() ? kAbsent
                                       : servotwin::judge(h.model, search_.training()).rms;
  };
  const double left = left_by(now_.current), floor = search_.floor().rms;
  Hypothesis best;
  const Hypothesis& without = now_.current;
  double least = std::numeric_limits<double>::infinity();
  const auto take = [&](const Hypothesis& rigid) {
    options_.begin("two masses");
    Hypothesis h;
    if (rigid.structure.effects.empty() ||
        !search_.part_masses(h, rigid, without.model, most_of_spring(without.model, left, floor),
                             kinds, laws))
      return;
    // The cross-validation takes as long as four fits.
    if (!(left_by(h) < most_of(h.model, without.model, left, floor))) return;
    search_.judge(h);
    steps_.push_back(text("as two masses (%s) beside %zu effects, order %d: %s RMS",
                          identity_of(two_mass_of(h.model)->kind).id.data(),
                          rigid.structure.effects.size(), h.structure.order,
                          size_of(h.rms()).c_str()));
    if (h.rms() < std::min(least, most_of(h.model, without.model, without.rms(), floor)))
      least = h.rms(), best = std::move(h);
  };
  const int order = without.structure.order;
  const bool delayed = without.has(kind_of<TimeDelay>()),
             filtered = without.has(kind_of<ControlFilter>());
  // Below it no other start is tried.
  const double clearly = filtered && !without.has(kind_of<Compliance>())
                             ? most_of_spring(without.model, without.rms(), floor)
                             : kMaxRmsRatioClearlyBetter * without.rms();
  const auto found = [&] { return least < clearly; };
  // A load on a spring comes late: a filter and a delay are both in its place.
  if (delayed && filtered) take(law_alone(order, false));
  const Hypothesis alone = law_alone(order, delayed);
  if (!found()) take(alone);
  if (!found() && alone.structure.effects.size() < without.structure.effects.size())
    take(without_vibration());
  const double reached = std::min(least, clearly);
  if (options_.identify.order == 0 && !(reached < kMinRmsOverFloorForTwoMasses * floor)) {
    const Hypothesis other = law_alone(order == 2 ? 3 : 2, delayed);
    if (!(left_by(other) > kMaxRmsRatioOfOtherOrder * left_by(alone))) take(other);
  }
  return !best.structure.effects.empty() && accept_two_masses(std::move(best));
}

bool Selector::may_have_two_masses() const {
  const double floor = search_.floor().rms;
  const bool filtered = now_.current.has(kind_of<ControlFilter>()),
             mode = now_.found.count("compliance") > 0, gap = now_.found.count("backlash") > 0;
  // It would only be suspected, however little it leaves.
  if (vibrates_like_no_machine(now_.current.model)) return true;
  if (filtered && (now_.filter_for_mode || mode))
    return now_.current.rms() > kMinRmsOverFloorOfFilter * floor;
  if (!(now_.current.rms() > kMinRmsOverFloorForTwoMasses * floor)) return false;
  if (mode || gap) return true;
  // As for a single cause: what is left may be the misfit of the law of friction.
  if (!(now_.current.rms() > kMinRemovedShareOfCause * baseline_)) return false;
  if (!(now_.current.rms() > kLawMisfitShare * friction_))
    return promised(kModeAndGaps, kMinGainBesideMisfit);
  // A law of friction can imitate a gap so well that no gap beside it is promising.
  if (now_.current.rms() > kMinRmsOverFloorUnscreened * floor) return true;
  return promised(kModeAndGaps, filtered ? kMinGainOfMasses : kMinScreenGain);
}

bool Selector::promised(std::vector<std::size_t> kinds, double min_gain) const {
  std::erase_if(kinds, [&](std::size_t kind) { return options_.leaves_out(cause_of(kind)); });
  const std::vector<Screened> screened = search_.screen(now_.current, kinds);
  return std::any_of(screened.begin(), screened.end(), [min_gain](const Screened& s) {
    return s.p < kMaxScreenP && s.gain > min_gain;
  });
}

std::vector<std::size_t> Selector::two_mass_kinds() const {
  const bool reading = Channels(search_.recorded(), options_.encoder_in_loop).reading;
  // What is recorded beside the motor's encoder is that of the load.
  const std::vector<Segment>& all = search_.recorded();
  const bool has_motor = std::all_of(
      all.begin(), all.end(), [](const Segment& s) { return s.actual_motor.size() == s.size(); });
  std::vector<std::size_t> kinds;
  for (std::size_t kind = 0; kind < kEffectKinds; ++kind) {
    // Play in front of an encoder outside the loop is an effect on its reading.
    const bool asked =
        kind != kind_of<PlayOutside>() && (reading || kind != kind_of<TwoMassOutside>());
    if (has_motor &&
        (kind == kind_of<TwoMassMotorEncoder>() || kind == kind_of<PlayMotorEncoder>()))
      continue;
    if (acts_on_axis(kind) && asked && !options_.leaves_out(cause_of(kind))) kinds.push_back(kind);
  }
  return kinds;
}

std::vector<std::size_t> Selector::permitted_laws() const {
  std::vector<std::size_t> laws;
  for (const std::size_t law : kLawsOnLoad) {
    const bool falls = law != kind_of<Presliding>();
    if (!options_.leaves_out("presliding") && !(falls && options_.leaves_out("stribeck")))
      laws.push_back(law);
  }
  return laws;
}

Hypothesis Selector::law_alone(int order, bool delayed) {
  Hypothesis h;
  h.structure = now_.current.structure;
  h.structure.order = order;
  if (!delayed) h.structure.matched_feedforward = false;  // the lag is that of the loop
  std::erase_if(h.structure.effects, [delayed](std::size_t kind) {
    return !is_friction_law(kind) && kind != kind_of<ConstantForce>() &&
           !(delayed && kind == kind_of<TimeDelay>());
  });
  const bool same = order == now_.current.structure.order;
  const std::vector<Point> from = same ? std::vector{point_of(now_.current.model, h.structure)}
                                       : starts_in_other_order(h.structure);
  if (!search_.fit(h, from)) return {};
  search_.polish(h);
  return h;
}

Hypothesis Selector::without_vibration() const {
  Hypothesis h = now_.current;
  const auto vibrates = [](std::size_t kind) {
    return cause_of(kind) == "compliance" || cause_of(kind) == "backlash";
  };
  std::erase_if(h.structure.effects, vibrates);
  std::erase_if(h.model.effects, [&](const Effect& effect) { return vibrates(effect.kind); });
  h.point = point_of(h.model, h.structure);
  return h;
}

bool Selector::accept_two_masses(Hypothesis two_masses) {
  const State before = now_;
  now_.current = std::move(two_masses);
  settle();
  if (!(now_.current.rms() < most_of(now_.current.model, before.current.model, before.current.rms(),
                                     search_.floor().rms)) ||
      !search_.is_plausible(now_.current.model)) {
    back_to(before);
    return false;
  }
  std::erase_if(now_.found, [&](const auto& one) { return !now_.current.has(one.second.kind); });
  const std::size_t kind = two_mass_of(now_.current.model)->kind;
  // Where two masses only take the place of a compliance, its evidence stays.
  const bool in_its_place =
      !(now_.current.rms() < kMaxRmsRatioClearlyBetter * before.current.rms());
  const auto known = before.found.find(std::string(cause_of(kind)));
  const Cause cause = in_its_place && known != before.found.end()
                          ? known->second.cause
                          : cause_by_improvement(cause_of(kind), before.current);
  now_.found[cause.id] = {cause, kind};
  if (const std::size_t law = law_of(now_.current.structure); law != kind_of<CoulombFriction>())
    named_by(law, cause);
  last_ = cause.id;
  steps_.push_back(text("  %s: added", cause.id.c_str()));
  rejected_.clear();
  return true;
}

}  // namespace servotwin
