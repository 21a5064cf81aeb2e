#include "diagnosis/search/selection.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "diagnosis/search/selector.h"
#include "diagnosis/statistics/thresholds.h"

namespace servotwin {

namespace {

// RMS with a new cause over RMS before, both refitted in free simulation: with a smaller
// improvement the cause is discarded, since better values of the other parameters did as much.
constexpr double kMaxRmsRatioAfterRefit = 0.99;

// RMS ratio of a filter that is most of what is left, and the share of the squared error that the
// screen forecasts of it: it then comes before the causes, which would stand for it.
constexpr double kMaxRmsRatioOfMostError = 0.3, kMinGainOfMostError = 0.5;

}  // namespace

void Selector::run() {
  settle();
  settled_ = now_.current;
  delay();
  baseline_ = now_.current.rms();
  integrator();
  add_filter(kMaxRmsRatioOfMostError, kMinGainOfMostError);
  add_causes();
  if (begin_with_part()) add_causes();
  if (filter_in_place_of_causes()) add_causes();
  if (add_filter(kMaxRmsRatioClearlyBetter, kMinScreenGain)) {
    ask_again_beside_filter();
    add_causes();
  }
  if (better_law()) add_causes();
  if (part_masses()) {
    better_law();
    add_causes();
  }
  if (law_beside_rests()) add_causes();
  replace_misfit_by_law();
  give_filter_to_baseline();
}

void Selector::back_to(const State& before) {
  now_ = before;
  search_.follow(now_.current);
}

void Selector::add_causes() {
  while (static_cast<int>(now_.found.size()) < kMaxCauses) {
    const State before = now_;
    if (!add_one()) {
      if (!add_delay()) break;
      continue;
    }
    const std::size_t added = now_.found.at(last_).kind;
    settle();
    delay();
    one_law_of_friction();
    integrator();
    anti_windup();
    // Discard a cause if better values of the other parameters lower the error as much.
    const auto one = now_.found.find(last_);
    const bool stays_it = one == now_.found.end() || !now_.current.has(one->second.kind) ||
                          !search_.is_plausible(before.current.model) ||
                          search_.is_plausible(now_.current.model);
    if (now_.current.rms() >= kMaxRmsRatioAfterRefit * before.current.rms() || !stays_it) {
      steps_.emplace_back(stays_it
                              ? "  no better after refitting in free simulation: discarded"
                              : "  not plausible after refitting in free simulation: discarded");
      back_to(before);
      rejected_.insert(added);
      continue;
    }
    if (last_ == "presliding" || last_ == "stribeck")
      friction_ = std::hypot(friction_, removed_rms(before.current, now_.current));
    remove_unnecessary();
  }
}

void Selector::settle() {
  options_.begin("to refine the model");
  search_.polish(now_.current);
  search_.follow(now_.current);
  now_.as_is = now_.current;
  search_.judge_as_is(now_.as_is);
  search_.judge(now_.current);
  now_.fitted = now_.current;
  // Coefficients estimated along a coarsely measured motion may not suit the simulation.
  if (now_.as_is.rms() < kMaxErrorRatioOfLargeGain * now_.current.rms()) {
    Hypothesis polished = now_.current;
    search_.judge_polished(polished);
    if (polished.rms() < now_.current.rms()) now_.current = std::move(polished);
  }
  if (search_.fit(now_.fitted, {now_.current.point})) {
    search_.judge(now_.fitted);
  } else {
    now_.fitted = now_.current;
  }
}

Cause Selector::cause_by_improvement(std::string id, const Hypothesis& before) const {
  Cause cause;
  cause.id = std::move(id);
  cause.statistic = paired_z(before.pieces, now_.current.pieces);
  cause.p = 0.5 * std::erfc(cause.statistic / std::sqrt(2.0));
  cause.wins = 1.0 - cause.p;
  return cause;
}

bool Selector::remove_unnecessary() {
  if (now_.found.empty()) return false;
  for (const auto& [id, one] : std::map<std::string, Found>(now_.found)) {
    if (id == last_) continue;
    if (!now_.current.has(one.kind)) {  // another effect has replaced it
      steps_.push_back(text("  %s: no longer needed, removed", id.c_str()));
      now_.found.erase(id);
      continue;
    }
    Hypothesis less;
    less.structure = without(now_.current.structure, id, one.kind);
    if (!search_.fit(less, {point_of(now_.current.model, less.structure)})) continue;
    search_.judge(less);
    if (std::min(now_.fitted.rms(), now_.current.rms()) < kMaxRmsRatioToAdd * less.rms()) continue;
    steps_.push_back(text("  %s: no longer needed, removed", id.c_str()));
    now_.current = std::move(less);
    now_.found.erase(id);
    // A law that contained both causes has become the effect of the one that stays.
    for (auto& [other, kept] : now_.found) {
      if (now_.current.has(kept.kind)) continue;
      kept.kind = other == "stribeck" ? kind_of<FallingFriction>() : kind_of<Presliding>();
    }
    settle();
    return true;
  }
  return false;
}

Selected select_causes(Search& search, Hypothesis baseline, const DiagnoseOptions& options) {
  Selector selection(search, std::move(baseline), options);
  selection.run();
  return {selection.settled(), selection.current(), selection.undelayed(), selection.found(),
          selection.steps()};
}

}  // namespace servotwin
