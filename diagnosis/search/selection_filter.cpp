// A filter of the control in the search for causes: part of the loop, and no cause
// (docs/decisions/0023-a-filter-of-the-control.md).
#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "diagnosis/search/selector.h"
#include "diagnosis/statistics/thresholds.h"
#include "identification/least_squares/parallel.h"

namespace servotwin {

namespace {

// RMS over noise floor above which a filter of the control is tried.
constexpr double kMinRmsOverFloorForFilter = 1.5;
// The same with a filter, below which nothing is left beside it: no cause is explained so by two
// poles.
constexpr double kMaxRmsOverFloorOfAll = 1.2;

}  // namespace

bool Selector::add_filter(double max_ratio, double min_gain) {
  const std::size_t filter = kind_of<ControlFilter>();
  if (now_.current.has(filter) ||
      !(now_.current.rms() > kMinRmsOverFloorForFilter * search_.floor().rms))
    return false;
  const Screened screened = search_.screen(now_.current, {filter}).front();
  if (screened.shapes.empty() || screened.p > kMaxScreenP || screened.gain < min_gain) return false;
  Hypothesis h = with_filter(screened);
  if (h.structure.effects.empty()) {
    steps_.emplace_back("with a filter of the control: every fit ends at a bound");
    return false;
  }
  search_.judge_as_is(h);
  const double frequency_hz = shape_of(h.model, filter, "frequency_hz"),
               damping_ratio = shape_of(h.model, filter, "damping_ratio");
  const std::string tried = text("with a filter of the control of %.3g Hz, damping %.2g: %s RMS",
                                 frequency_hz, damping_ratio, size_of(h.rms()).c_str());
  const char* refused = nullptr;
  if (!(search_.ratio_beyond_noise(h, now_.as_is) < max_ratio) &&
      !(h.rms() < kMaxRmsOverFloorOfAll * search_.floor().rms))
    refused = ", too little";
  else if (paired_z(now_.as_is.pieces, h.pieces) < kMinBlockZ)
    refused = ", not significant";
  steps_.push_back(tried + (refused != nullptr ? refused : ""));
  if (refused != nullptr) {
    if (now_.found.empty()) filtered_ = std::move(h);
    return false;
  }
  const State before = now_;
  // A delay has one parameter, where the filter has six and can imitate it.
  if (add_delay()) {
    if (search_.ratio_beyond_noise(now_.as_is, before.as_is) < max_ratio) return false;
    back_to(before);
  }
  const bool vibrates = promised({kind_of<Compliance>()}, kMinGainOfMasses);
  now_.current = std::move(h);
  settle();
  if (now_.as_is.rms() < before.as_is.rms() && search_.is_plausible(now_.current.model)) {
    now_.filter_for_mode = now_.filter_for_mode || vibrates;
    delay();
    return true;
  }
  steps_.emplace_back("  not plausible after refitting in free simulation: discarded");
  back_to(before);
  return false;
}

Hypothesis Selector::with_filter(const Screened& screened) {
  const std::size_t filter = kind_of<ControlFilter>();
  const auto is_one = [&](const Hypothesis& h) {
    return ControlFilter::is_one(h.model.find(filter)->shape.data());
  };
  Hypothesis h;
  h.structure = extended_by(now_.current.structure, filter);
  std::vector<Point> from;
  const std::size_t damping = shapes_before(h.structure, filter) + 1;
  for (const double ratio : {0.5, 1.0, 2.0}) {
    from.push_back(start_of(h.structure, screened));
    from.back().shapes[damping] = ratio;
  }
  // Its coefficients follow from small differences of the motion, which the encoder's noise hides:
  // refined in free simulation, and where that ends at a bound begun there.
  if (search_.fit(h, from)) {
    converge(h);
    if (is_one(h)) return h;
  }
  constexpr std::array kFrequencies_hz{5.0, 12.0, 30.0};
  std::array<std::pair<double, Hypothesis>, kFrequencies_hz.size()> begun;  // RMS left, and it
  in_parallel(begun.size(), [&](std::size_t i) {
    auto& [left, one] = begun[i];
    one = now_.current;
    one.structure = h.structure;
    Effect effect = make_effect<ControlFilter>();
    effect.shape = {kFrequencies_hz[i], 1.0};
    one.model.effects.push_back(effect);
    one.point = point_of(one.model, one.structure);
    search_.polish(one);
    left = servotwin::judge(one.model, search_.training()).rms;
    if (!std::isfinite(left)) left = Hypothesis().cost;  // it runs away
  });
  // The best that does not end at a bound: to go on with all of them takes three times as long.
  std::sort(begun.begin(), begun.end(),
            [](const auto& l, const auto& r) { return l.first < r.first; });
  for (auto& [left, one] : begun) {
    converge(one);
    if (is_one(one)) return one;
  }
  return {};
}

void Selector::converge(Hypothesis& h) {
  constexpr int kMostTimes = 4;
  constexpr double kMaxRmsRatioToGoOn = 0.98;
  double before = servotwin::judge(h.model, search_.training()).rms;
  for (int i = 0; i < kMostTimes; ++i) {
    search_.polish(h);
    const double now = servotwin::judge(h.model, search_.training()).rms;
    if (!(now < kMaxRmsRatioToGoOn * before)) break;
    before = now;
  }
}

bool Selector::filter_does_better(Hypothesis mode) {
  const State before = now_;
  if (!add_filter(kMaxRmsRatioClearlyBetter, kMinScreenGain)) {
    if (now_.current.structure.effects != before.current.structure.effects) back_to(before);
    return false;
  }
  search_.polish(mode);
  search_.judge_polished(mode);  // as the filter is judged
  // A cause claims more, but what has as many parameters or more has to be clearly better.
  if (now_.current.rms() < kMaxRmsRatioClearlyBetter * mode.rms()) {
    now_.filter_for_mode = true;
    return true;
  }
  back_to(before);
  return false;
}

bool Selector::filter_in_place_of_causes() {
  if (!filtered_ || now_.found.empty() || now_.current.has(kind_of<ControlFilter>())) return false;
  Hypothesis h = *filtered_;
  search_.judge_polished(h);
  if (!(h.rms() < now_.current.rms())) return false;
  const State before = now_;
  now_.current = std::move(h);
  now_.found.clear();
  settle();
  if (now_.current.rms() < before.current.rms()) {
    steps_.push_back(text("a filter of the control does better than these causes: %s RMS",
                          size_of(now_.current.rms()).c_str()));
    now_.filter_for_mode =
        before.found.count("compliance") > 0 || before.found.count("backlash") > 0;
    friction_ = 0.0;
    rejected_.clear();
    return true;
  }
  back_to(before);
  return false;
}

void Selector::ask_again_beside_filter() {
  rejected_.clear();
  last_.clear();
  while (remove_unnecessary()) {
  }
}

void Selector::give_filter_to_baseline() {
  const std::size_t filter = kind_of<ControlFilter>();
  if (!now_.current.has(filter)) return;
  if (now_.found.empty()) {
    settled_ = now_.current;
    return;
  }
  Hypothesis h = settled_;
  h.structure.order = now_.current.structure.order;
  h.structure.effects.push_back(filter);
  h.model.loop = now_.current.model.loop;
  h.model.effects.push_back(*now_.current.model.find(filter));
  if (h.structure.order == 3) {
    std::erase(h.structure.effects, kind_of<ConstantForce>());  // not observable
    std::erase_if(h.model.effects,
                  [](const Effect& effect) { return effect.kind == kind_of<ConstantForce>(); });
  }
  h.point = point_of(h.model, h.structure);
  if (!search_.fit(h, {h.point})) {
    steps_.emplace_back("the baseline could not be fitted with the filter");
    return;
  }
  converge(h);
  settled_ = std::move(h);
}

}  // namespace servotwin
