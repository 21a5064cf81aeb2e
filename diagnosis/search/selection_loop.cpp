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
    // Zeros imitate a delay less well than it follows itself: where they leave clearly less, it is
    // none. A load on a spring comes late as well.
    const bool real =
        disguised ? !(h.rms() < kMaxRmsRatioDelayOverRival * now_.current.rms())
                  : search_.ratio_beyond_noise(now_.current, h) < kMaxRmsRatioDelayOverRival;
    needed = !tiny && !lag && real;
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
  if (now_.current.structure.order != 2 || options_.identify.order != 0) return;
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

void Selector::anti_windup() {
  const auto found = now_.found.find("torque_saturation");
  if (now_.current.structure.order != 3 || found == now_.found.end()) return;
  const Effect* limit = motor_limit_of(now_.current.model);
  if (limit == nullptr || limit->kind != kMotorLimits.front()) return;  // a form was chosen before
  Hypothesis best = now_.as_is;
  for (const std::size_t kind : kMotorLimits) {
    if (kind == limit->kind) continue;
    Hypothesis h = now_.as_is;
    std::replace(h.structure.effects.begin(), h.structure.effects.end(), limit->kind, kind);
    for (Effect& effect : h.model.effects) {
      if (!limits_motor(effect.kind)) continue;
      const bool same = shapes_of(kind)[1].name == shapes_of(effect.kind)[1].name;
      effect.kind = kind;
      if (!same) effect.shape[1] = shapes_of(kind)[1].start;
    }
    options_.begin(identity_of(kind).id);
    search_.polish(h);
    search_.judge_as_is(h);
    if (h.rms() < kMaxRmsRatioToAdd * best.rms() && search_.is_plausible(h.model))
      best = std::move(h);
  }
  const std::size_t kind = motor_limit_of(best.model)->kind;
  if (kind == limit->kind) return;
  steps_.push_back(text("  %s: %s RMS", identity_of(kind).id.data(), size_of(best.rms()).c_str()));
  now_.current = std::move(best);
  found->second.kind = kind;
  settle();
}

}  // namespace servotwin
