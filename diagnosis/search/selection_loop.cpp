// The delay, the order and the integrator of the loop beside which causes are searched.
#include <algorithm>
#include <cmath>
#include <complex>

#include "diagnosis/search/selector.h"
#include "diagnosis/statistics/thresholds.h"

namespace servotwin {

namespace {

// RMS with a delay over RMS with a mode, or with a velocity lag beyond the noise, below which the
// delay is kept. While something else is not explained, a few per cent do not tell them apart.
constexpr double kMaxRmsRatioDelayOverRival = 0.9;
// RMS over noise floor above which a filter of the control is tried.
constexpr double kMinRmsOverFloorForFilter = 1.5;
// The same with a filter, below which nothing is left beside it: no cause is explained so by two
// poles.
constexpr double kMaxRmsOverFloorOfAll = 1.2;

}  // namespace

void Selector::delay() {
  const auto& effects = now_.current.structure.effects;
  if (std::find(effects.begin(), effects.end(), kind_of<TimeDelay>()) == effects.end()) return;
  const double delay_s = now_.current.model.command_delay_s();
  Hypothesis h;
  h.structure = now_.current.structure;
  h.structure.matched_feedforward = false;
  std::erase(h.structure.effects, kind_of<TimeDelay>());
  const bool tiny = delay_s < kMinDelaySamples * now_.current.model.sample_time_s,
             lag = lag_in_disguise(now_.current.model);
  // Starting from the present poles and, since the delay may have distorted them, from the grid.
  bool needed = true;
  double least = 1e300;  // RMS without it
  for (const std::vector<Point>& from :
       {std::vector<Point>{point_of(now_.current.model, h.structure)}, std::vector<Point>{}}) {
    if (!search_.fit(h, from)) continue;
    search_.polish(h);
    search_.judge(h);
    const bool disguised = delay_in_disguise(h.model.loop);
    if (h.rms() < least && !disguised) {
      least = h.rms();
      undelayed_ = h;
    }
    needed =
        !tiny && !lag &&
        (disguised || search_.ratio_beyond_noise(now_.current, h) < kMaxRmsRatioDelayOverRival);
    if (!needed) break;
  }
  if (needed) {
    if (least < 1e300)
      steps_.push_back(text("delay of %.3g ms: needed, %s RMS without it", 1e3 * delay_s,
                            size_of(least).c_str()));
    return;
  }
  steps_.push_back(text("delay of %.3g ms: not needed", 1e3 * delay_s));
  now_.current = std::move(h);
  settle();
  undelayed_ = now_.current;
}

bool Selector::add_delay() {
  if (now_.current.has(kind_of<TimeDelay>()) || options_.identify.delay_max_s <= 0.0 ||
      options_.leaves_out("time_delay"))
    return false;
  Hypothesis best;
  best.cost = 1e300;
  for (const double cycles : {2.0, 6.0}) {
    Hypothesis h;
    h.structure = now_.current.structure;
    h.structure.effects.push_back(kind_of<TimeDelay>());
    Point from = point_of(now_.current.model, h.structure);
    from.shapes.back() = std::min(cycles * now_.current.model.sample_time_s, 0.01);
    if (search_.fit(h, {from}) && h.cost < best.cost) best = std::move(h);
  }
  if (!(best.cost < 1e300)) return false;
  const double delay_s = best.model.command_delay_s();
  if (delay_s < kMinDelaySamples * best.model.sample_time_s ||
      delay_s > options_.identify.delay_max_s)
    return false;
  search_.judge(best);
  if (best.rms() >= kMaxRmsRatioToAdd * now_.fitted.rms() ||
      paired_z(now_.fitted.pieces, best.pieces) < kMinBlockZ)
    return false;
  steps_.push_back(
      text("with a delay of %.3g ms: %s RMS", 1e3 * delay_s, size_of(best.rms()).c_str()));
  const State before = now_;
  now_.current = std::move(best);
  settle();
  // It has to explain a large part: beside what is not explained, a delay improves most fits a
  // little.
  const double ratio = search_.ratio_beyond_noise(now_.current, before.current);
  if (now_.current.rms() < kMaxRmsRatioToAdd * before.current.rms() &&
      ratio < kMaxErrorRatioOfLargeGain) {
    undelayed_ = before.current;
    return true;
  }
  back_to(before);
  return false;
}

bool Selector::delay_does_better(Hypothesis mode) {
  const State before = now_;
  if (!add_delay()) return false;
  search_.polish(mode);
  search_.judge(mode);
  if (now_.current.rms() < kMaxRmsRatioDelayOverRival * mode.rms()) return true;
  back_to(before);
  return false;
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

void Selector::ask_again_beside_filter() {
  rejected_.clear();
  last_.clear();
  while (remove_unnecessary()) {
  }
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
    rejected_.clear();
    return true;
  }
  back_to(before);
  return false;
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

bool Selector::filter_does_better(Hypothesis mode) {
  const State before = now_;
  if (!add_filter(kMaxRmsRatioClearlyBetter, kMinScreenGain)) {
    if (now_.current.structure.effects != before.current.structure.effects) back_to(before);
    return false;
  }
  search_.polish(mode);
  search_.judge_polished(mode);  // as the filter is judged
  if (now_.current.rms() < mode.rms()) return true;
  back_to(before);
  return false;
}

std::vector<Point> Selector::starts_in_other_order(const Structure& structure) const {
  std::vector<Point> out;
  const auto add = [&](const std::array<double, kMaxOrder>& denominator) {
    out.push_back(point_of(now_.current.model, structure));
    out.back().denominator = denominator;
  };
  const Loop& loop = now_.current.model.loop;
  const std::array<double, kMaxOrder>& a = loop.denominator;
  if (loop.order == 2) {
    for (const double share : {0.02, 0.1, 0.4}) {
      // (s^2 + a1 s + a2)(s + p)
      const double pole = share * a[1] / a[0];
      add({a[0] + pole, a[1] + a[0] * pole, a[1] * pole});
    }
    return out;
  }
  for (const std::complex<double>& root : roots_of(loop)) {
    // s^3 + a1 s^2 + a2 s + a3 over (s - root)
    if (std::abs(root.imag()) > 1e-9 * std::abs(root)) continue;
    const double first = a[0] + root.real();
    add({first, a[1] + root.real() * first, 0.0});
  }
  return out;
}

void Selector::integrator() {
  if (now_.current.structure.order != 2) return;
  Hypothesis h;
  h.structure = now_.current.structure;
  h.structure.order = 3;
  std::erase(h.structure.effects, kind_of<ConstantForce>());
  // Without causes the poles are searched from the grid. With causes the search starts from the
  // present model, so that their shape parameters are kept.
  std::vector<Point> from;
  if (!now_.found.empty()) from = starts_in_other_order(h.structure);
  if (!search_.fit(h, from)) return;
  search_.judge(h);
  const bool better = h.rms() < kMaxRmsRatioToAdd * now_.fitted.rms() &&
                      paired_z(now_.fitted.pieces, h.pieces) > kMinBlockZ;
  steps_.push_back(text("integrator: %s, %s RMS", better ? "yes" : "no", size_of(h.rms()).c_str()));
  if (!better) return;
  const State before = now_;
  now_.current = std::move(h);
  // With an integrator in the loop a constant force is not observable.
  std::erase_if(now_.found, [&](const auto& one) { return !now_.current.has(one.second.kind); });
  settle();
  if (now_.as_is.rms() < kMaxRmsRatioToAdd * before.as_is.rms()) return;
  back_to(before);
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
  Hypothesis best;
  double least = 1e300;
  for (const double frequency_hz : {5.0, 12.0, 30.0}) {
    Hypothesis one = now_.current;
    one.structure = h.structure;
    Effect effect = make_effect<ControlFilter>();
    effect.shape = {frequency_hz, 1.0};
    one.model.effects.push_back(effect);
    one.point = point_of(one.model, one.structure);
    converge(one);
    const double left = servotwin::judge(one.model, search_.training()).rms;
    if (is_one(one) && left < least) least = left, best = std::move(one);
  }
  return best;
}

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
  now_.current = std::move(h);
  settle();
  if (now_.as_is.rms() < before.as_is.rms() && search_.is_plausible(now_.current.model)) {
    delay();
    return true;
  }
  steps_.emplace_back("  not plausible after refitting in free simulation: discarded");
  back_to(before);
  return false;
}

}  // namespace servotwin
