// Laws of friction in the search for causes: one law for two effects, a free one, and what a wrong
// one stood for.
#include <algorithm>
#include <cmath>

#include "diagnosis/search/selector.h"
#include "diagnosis/statistics/thresholds.h"
#include "identification/least_squares/parallel.h"
#include "identification/loop/two_mass_fit.h"
#include "twin/two_mass_axis.h"

namespace servotwin {

namespace {

// RMS over noise floor above which a law of friction with a free virgin curve is tried.
constexpr double kMinRmsOverFloorForFreeLaw = 2.0;
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

bool Selector::free_law() {
  const auto friction = now_.found.find("presliding");
  if (friction == now_.found.end() ||
      !(now_.current.rms() > kMinRmsOverFloorForFreeLaw * search_.floor().rms))
    return false;
  if (options_.leaves_out("stribeck")) return false;  // the law also falls with speed
  options_.begin(identity_of(kind_of<Gms>()).id);
  Hypothesis h;
  h.structure = now_.current.structure;
  auto& effects = h.structure.effects;
  std::erase(effects, kind_of<FallingFriction>());
  std::replace_if(effects.begin(), effects.end(), is_friction_law, kind_of<Gms>());
  if (!search_.fit_friction(h, point_of(now_.current.model, h.structure))) return false;
  search_.judge(h);
  steps_.push_back(text("  as gms: %s RMS", size_of(h.rms()).c_str()));
  if (!(h.rms() < kMaxRmsRatioClearlyBetter * now_.current.rms())) return false;
  const State before = now_;
  now_.current = std::move(h);
  settle();
  if (!(now_.current.rms() < kMaxRmsRatioClearlyBetter * before.current.rms())) {
    back_to(before);
    return false;
  }
  named_by(kind_of<Gms>(), friction->second.cause);
  rejected_.clear();
  return true;
}

bool Selector::law_beside_rests() {
  const std::size_t dwell = kind_of<DwellStiction>();
  if (now_.found.count("presliding") + now_.found.count("stribeck") == 0 ||
      now_.current.has(dwell) || has_two_masses(now_.current.structure) ||
      options_.leaves_out(cause_of(dwell)) ||
      !(now_.current.rms() > kMinRmsOverFloorForTwoMasses * search_.floor().rms))
    return false;
  const Screened screened = search_.screen(now_.current, {dwell}).front();
  if (screened.p > kMaxScreenP || screened.gain < kMinScreenGainBesideLaw) return false;
  std::vector<Hypothesis> all;
  for (const std::size_t law : permitted_laws()) {
    Hypothesis h;
    h.structure = now_.current.structure;
    auto& effects = h.structure.effects;
    std::erase(effects, kind_of<FallingFriction>());
    std::replace_if(effects.begin(), effects.end(), is_friction_law, law);
    effects.push_back(dwell);
    h.point = point_of(now_.current.model, h.structure);
    // From the default values of the law: the fitted ones imitate the force that grows at rest.
    auto of_law =
        h.point.shapes.begin() + static_cast<std::ptrdiff_t>(shapes_before(h.structure, law));
    for (const Parameter& p : shapes_of(law)) *of_law++ = p.start;
    std::copy(screened.shapes.begin(), screened.shapes.end(),
              h.point.shapes.end() - static_cast<std::ptrdiff_t>(screened.shapes.size()));
    all.push_back(std::move(h));
  }
  if (all.empty()) return false;
  options_.begin("friction that grows at rest");
  std::vector<char> fits(all.size());
  in_parallel(all.size(), [&](std::size_t i) {
    fits[i] = search_.fit_friction(all[i], Point(all[i].point));
    if (fits[i]) search_.judge_as_is(all[i]);
  });
  Hypothesis* best = nullptr;
  for (std::size_t i = 0; i < all.size(); ++i) {
    if (fits[i] && (best == nullptr || all[i].rms() < best->rms())) best = &all[i];
  }
  if (best == nullptr) return false;
  search_.polish(*best);
  search_.judge_polished(*best);
  const auto law = *std::find_if(best->structure.effects.begin(), best->structure.effects.end(),
                                 is_friction_law);
  steps_.push_back(text("as %s beside a force that grows at rest: %s RMS",
                        identity_of(law).id.data(), size_of(best->rms()).c_str()));
  if (!(best->rms() < kMaxRmsRatioClearlyBetter * now_.current.rms())) return false;
  const State before = now_;
  now_.current = *best;
  settle();
  if (!(now_.current.rms() < kMaxRmsRatioClearlyBetter * before.current.rms()) ||
      !search_.is_plausible(now_.current.model)) {
    back_to(before);
    return false;
  }
  const Cause cause = cause_by_improvement(cause_of(dwell), before.current);
  last_ = cause.id;
  now_.found.erase("stribeck");
  now_.found[cause.id] = {cause, dwell};
  named_by(law, cause);
  steps_.push_back(text("  %s: added", cause.id.c_str()));
  rejected_.clear();
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
    const auto& effects = now_.current.structure.effects;
    const auto law = *std::find_if(effects.begin(), effects.end(), is_friction_law);
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
