// Laws of friction in the search for causes: one law for two effects, a better one beside all
// causes, and what a wrong one stood for.
#include <algorithm>
#include <cmath>

#include "diagnosis/search/selector.h"
#include "diagnosis/statistics/thresholds.h"
#include "identification/least_squares/parallel.h"
#include "identification/loop/structure_choice.h"
#include "identification/loop/two_mass_fit.h"
#include "twin/two_mass_axis.h"

namespace servotwin {

namespace {

// RMS over noise floor above which another law of friction is tried beside all causes: below it
// there is little to gain for the time that it takes.
constexpr double kMinRmsOverFloorForBetterLaw = 1.5;
// Share of the squared error that the screen must forecast for a force that grows at rest, for it
// to be tried beside other laws of friction.
constexpr double kMinScreenGainBesideLaw = 0.1;

}  // namespace

void Selector::one_law_of_friction() {
  if (last_ != "presliding" && last_ != "stribeck") return;
  if (options_.leaves_out("presliding") || options_.leaves_out("stribeck"))
    return;  // the law contains both
  const Found friction = now_.found.at(last_);
  const bool both = now_.found.count("presliding") > 0 && now_.found.count("stribeck") > 0;
  if (std::find(kLaws.begin(), kLaws.end(), friction.kind) != kLaws.end()) return;
  // A law would have to be clearly better here, which would be less than the noise.
  if (!both && kMaxRmsRatioClearlyBetter * now_.current.rms() < search_.floor().low) return;
  Hypothesis best = now_.current;
  std::size_t law = kEffectKinds;
  for (const std::size_t kind : {kind_of<LuGre>(), kind_of<PreslidingStribeck>()}) {
    options_.begin(identity_of(kind).id);
    Hypothesis h;
    h.structure = now_.current.structure;
    auto& effects = h.structure.effects;
    std::erase(effects, kind_of<FallingFriction>());
    std::replace(effects.begin(), effects.end(), kind_of<Presliding>(), kind);
    std::replace(effects.begin(), effects.end(), kind_of<CoulombFriction>(), kind);
    if (std::find(effects.begin(), effects.end(), kind) == effects.end() ||
        !search_.fit_friction(h, point_of(now_.current.model, h.structure)))
      continue;
    search_.judge(h);
    steps_.push_back(
        text("  as %s: %s RMS", identity_of(kind).id.data(), size_of(h.rms()).c_str()));
    // Where only one of the two causes was found, the law implies more than is known: it must be
    // clearly better.
    if (!both && h.rms() > kMaxRmsRatioClearlyBetter * now_.current.rms()) continue;
    if (h.rms() < kMaxRmsRatioToAdd * best.rms()) best = std::move(h), law = kind;
  }
  if (law == kEffectKinds) return;
  now_.current = std::move(best);
  settle();
  named_by(law, friction.cause);
}

std::optional<Hypothesis> Selector::best_of_laws(const std::vector<std::size_t>& laws,
                                                 const Screened* beside) {
  std::vector<Hypothesis> all;
  for (const std::size_t law : laws) {
    Hypothesis h;
    h.structure = now_.current.structure;
    auto& effects = h.structure.effects;
    std::erase(effects, kind_of<FallingFriction>());
    std::replace_if(effects.begin(), effects.end(), is_friction_law, law);
    if (std::find(effects.begin(), effects.end(), law) == effects.end()) continue;
    if (beside != nullptr) effects.push_back(beside->kind);
    h.point = point_of(now_.current.model, h.structure);
    // From the default values of the law: those of the old law are fitted to what it is not.
    auto of_law =
        h.point.shapes.begin() + static_cast<std::ptrdiff_t>(shapes_before(h.structure, law));
    for (const Parameter& p : shapes_of(law)) *of_law++ = p.start;
    if (beside != nullptr)
      std::copy(beside->shapes.begin(), beside->shapes.end(),
                h.point.shapes.end() - static_cast<std::ptrdiff_t>(beside->shapes.size()));
    all.push_back(std::move(h));
  }
  std::vector<char> fits(all.size());
  in_parallel(all.size(), [&](std::size_t i) {
    fits[i] = search_.fit_friction(all[i], Point(all[i].point));
    if (fits[i]) search_.judge_as_is(all[i]);
  });
  const Hypothesis* least = nullptr;
  for (std::size_t i = 0; i < all.size(); ++i) {
    if (fits[i] && (least == nullptr || all[i].rms() < least->rms())) least = &all[i];
  }
  if (least == nullptr) return std::nullopt;
  Hypothesis best = *least;
  search_.polish(best);
  judge_in_simulation(best);
  return best;
}

void Selector::judge_in_simulation(Hypothesis& h) const {
  // With a limit of the motor nothing is refitted to a part of the motion (Search::judge).
  if (motor_limit_of(h.model) != nullptr) {
    search_.judge_as_is(h);
  } else {
    search_.judge_polished(h);
  }
}

bool Selector::accept_law(Hypothesis h) {
  // Coefficients estimated along the measured motion may not suit the simulation: each model counts
  // by the better of two judgements.
  const auto in_simulation = [this](Hypothesis one) {
    judge_in_simulation(one);
    return one.rms();
  };
  if (!(h.rms() < kMaxRmsRatioClearlyBetter * now_.current.rms())) return false;
  const double most =
      kMaxRmsRatioClearlyBetter * std::min(now_.current.rms(), in_simulation(now_.current));
  if (!(h.rms() < most)) return false;
  const State before = now_;
  now_.current = std::move(h);
  settle();
  if ((now_.current.rms() < most || in_simulation(now_.current) < most) &&
      search_.is_plausible(now_.current.model)) {
    friction_ = std::hypot(friction_, removed_rms(before.current, now_.current));
    rejected_.clear();
    return true;
  }
  back_to(before);
  return false;
}

bool Selector::better_law() {
  const auto friction = now_.found.find("presliding");
  // Not with play, as in Search::part_masses: the fits take long and gain little.
  if (friction == now_.found.end() || plays(now_.current.model) ||
      !(now_.current.rms() > kMinRmsOverFloorForBetterLaw * search_.floor().rms))
    return false;
  std::vector<std::size_t> laws = permitted_laws();
  // It falls with speed as well. On a load it has too many parameters.
  if (!options_.leaves_out("stribeck") && !has_two_masses(now_.current.structure))
    laws.push_back(kind_of<Gms>());
  std::erase_if(laws, [&](std::size_t law) { return now_.current.has(law); });
  options_.begin("another law of friction");
  std::optional<Hypothesis> best = best_of_laws(laws, nullptr);
  if (!best) return false;
  const std::size_t law = law_of(best->structure);
  steps_.push_back(text("as %s beside all causes: %s RMS", identity_of(law).id.data(),
                        size_of(best->rms()).c_str()));
  const Cause evidence = friction->second.cause;
  if (!accept_law(std::move(*best))) return false;
  named_by(law, evidence);
  return true;
}

bool Selector::law_beside_rests() {
  const std::size_t dwell = kind_of<DwellStiction>();
  if (now_.found.count("presliding") + now_.found.count("stribeck") == 0 ||
      now_.current.has(dwell) || has_two_masses(now_.current.structure) ||
      options_.leaves_out(cause_of(dwell)) ||
      !(now_.current.rms() > kMinRmsOverFloorForBetterLaw * search_.floor().rms))
    return false;
  const Screened screened = search_.screen(now_.current, {dwell}).front();
  if (screened.p > kMaxScreenP || screened.gain < kMinScreenGainBesideLaw) return false;
  options_.begin("friction that grows at rest");
  std::optional<Hypothesis> best = best_of_laws(permitted_laws(), &screened);
  if (!best) return false;
  const std::size_t law = law_of(best->structure);
  steps_.push_back(text("as %s beside a force that grows at rest: %s RMS",
                        identity_of(law).id.data(), size_of(best->rms()).c_str()));
  const Hypothesis before = now_.current;
  if (!accept_law(std::move(*best))) return false;
  const Cause cause = cause_by_improvement(cause_of(dwell), before);
  last_ = cause.id;
  now_.found.erase("stribeck");
  now_.found[cause.id] = {cause, dwell};
  named_by(law, cause);
  steps_.push_back(text("  %s: added", cause.id.c_str()));
  return true;
}

void Selector::replace_misfit_by_law() {
  for (const auto& [id, one] : std::map<std::string, Found>(now_.found)) {
    if (id == "presliding" || id == "stribeck" || !like_friction(one.kind)) continue;
    Hypothesis best;
    double least = now_.current.rms() / kMaxRmsRatioToAdd;
    for (const std::size_t law :
         {kind_of<Presliding>(), kind_of<LuGre>(), kind_of<PreslidingStribeck>()}) {
      const bool falls = law != kind_of<Presliding>();
      if (options_.leaves_out("presliding") || (falls && options_.leaves_out("stribeck"))) continue;
      options_.begin(identity_of(law).id);
      Hypothesis h;
      h.structure = without(now_.current.structure, id, one.kind);
      auto& effects = h.structure.effects;
      std::erase(effects, kind_of<FallingFriction>());
      std::replace_if(effects.begin(), effects.end(), is_friction_law, law);
      if (std::find(effects.begin(), effects.end(), law) == effects.end() ||
          !search_.fit_friction(h, point_of(now_.current.model, h.structure)))
        continue;
      search_.judge(h);
      if (h.rms() < least) least = h.rms(), best = std::move(h);
    }
    if (best.structure.effects.empty()) continue;
    const State before = now_;
    now_.current = std::move(best);
    settle();
    if (now_.current.rms() > before.current.rms() / kMaxRmsRatioToAdd) {
      back_to(before);
      continue;
    }
    const std::size_t law = law_of(now_.current.structure);
    steps_.push_back(text("  %s makes %s unnecessary: %s RMS", identity_of(law).id.data(),
                          id.c_str(), size_of(now_.current.rms()).c_str()));
    Cause cause = one.cause;
    cause.ambiguous_with.clear();
    now_.found.erase(id);
    named_by(law, cause);
  }
}

void Selector::named_by(std::size_t law, const Cause& evidence) {
  const double ratio = shape_of(now_.current.model, law, "breakaway_ratio");
  for (const char* id : {"presliding", "stribeck"}) {
    if (options_.leaves_out(id)) continue;
    const bool falls = id == std::string("stribeck");
    if (falls && !std::isfinite(ratio)) {
      now_.found.erase(id);
      continue;
    }
    if (falls && now_.found.count(id) == 0 && std::abs(ratio - 1.0) <= kMinStribeckShare) continue;
    Found found{now_.found.count(id) > 0 ? now_.found.at(id).cause : evidence, law};
    found.cause.id = id;
    now_.found[id] = found;
  }
}

}  // namespace servotwin
