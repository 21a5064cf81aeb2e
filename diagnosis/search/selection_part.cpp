// The loop of the baseline may be a compromise between two machines: the search begins again with
// the loop of a part of the motion that the cause does not reach.
#include <algorithm>
#include <cmath>

#include "diagnosis/search/selector.h"
#include "diagnosis/statistics/thresholds.h"
#include "identification/least_squares/parallel.h"
#include "identification/loop/identify.h"
#include "identification/loop/limit_fit.h"
#include "identification/recording/motion_range.h"
#include "identification/torque/torque_limit.h"

namespace servotwin {

namespace {

// RMS over noise floor above which the loop may be wrong: where the screen forecasts this share of
// the squared error by a limit of the motor; and in any case, before the causes and with them. A
// loop that is wrong enough hides what made it wrong.
constexpr double kMinRmsOverFloorOfLimit = 5.0, kMinGainOfLimit = 0.3;
constexpr double kGrossOverFloor = 50.0, kLeftOverFloor = 10.0;
// Of the largest commanded acceleration: beyond it the motor may be at its limit.
constexpr std::array kHardShares{0.8, 0.6, 0.4};
// After a hard acceleration: the time in which most of what the motor could not give is made good.
constexpr double kLimitSettles_s = 0.1;
constexpr std::array kFirstShares{0.25, 0.5, 0.75};  // of the time
// RMS of the loop of a part over that of the model before, on that part; and of the model with a
// cause beside it over that of the model before.
constexpr double kMaxRmsRatioOfPart = 0.5;
constexpr int kPolishes = 2;  // one does not always get to the end

/// The acceleration of the command over the span of MotionRange, on which its steps do not count.
Eigen::ArrayXd acceleration_of(const Segment& s) {
  const auto span = std::max<Eigen::Index>(1, std::lround(MotionRange::kSpan_s / s.sample_time_s));
  const double span_s = s.sample_time_s * static_cast<double>(span);
  Eigen::ArrayXd out = Eigen::ArrayXd::Zero(s.size());
  for (Eigen::Index k = span; k + span < s.size(); ++k)
    out(k) = (s.command(k + span) - 2.0 * s.command(k) + s.command(k - span)) / (span_s * span_s);
  return out;
}

/// The times in which the command accelerates by more than this.
TorqueLimit hard_moments(const std::vector<Segment>& segments, double acceleration) {
  TorqueLimit out;
  for (const Segment& s : segments) {
    const Eigen::ArrayXd here = acceleration_of(s).abs();
    for (Eigen::Index k = 0; k < s.size(); ++k) {
      if (here(k) < acceleration) continue;
      const double time = s.start_s + s.sample_time_s * static_cast<double>(k);
      if (out.moments.empty() || time > out.moments.back().end_s)
        out.moments.push_back({time, time, kAbsent});
      out.moments.back().end_s = time + kLimitSettles_s;
    }
  }
  return out;
}

/// What sets in at a time in the recording.
std::vector<std::size_t> changes_in_time() {
  std::vector<std::size_t> out;
  for (std::size_t kind = 0; kind < kEffectKinds; ++kind) {
    const auto shapes = shapes_of(kind);
    if (!shapes.empty() && shapes.front().scan == Scan::kTime && !cause_of(kind).empty())
      out.push_back(kind);
  }
  return out;
}

}  // namespace

std::optional<Hypothesis> Selector::loop_of_part(const std::vector<Segment>& part,
                                                 const std::string& name) {
  if (part.empty()) return std::nullopt;
  const double before = servotwin::judge(now_.current.model, part).rms;
  std::optional<Hypothesis> best;
  double least = kMaxRmsRatioOfPart * before;
  for (const int order : {2, 3}) {
    Hypothesis h;
    h.structure.order = order;
    h.structure.effects = {kind_of<CoulombFriction>()};
    if (order == 2 && now_.current.has(kind_of<ConstantForce>()))
      h.structure.effects.push_back(kind_of<ConstantForce>());
    if (!search_.fit_elsewhere(h, part)) continue;
    const double left = servotwin::judge(h.model, part).rms;
    if (left < (best ? kMaxRmsRatioClearlyBetter : 1.0) * least) best = h, least = left;
  }
  if (best)
    steps_.push_back(text("the loop of the motion %s: %s RMS there, %s before", name.c_str(),
                          size_of(least).c_str(), size_of(before).c_str()));
  return best;
}

bool Selector::limit_beside(const Hypothesis& loop) {
  options_.begin(identity_of(kMotorLimits.front()).id);
  const std::size_t forms = loop.structure.order == 3 ? kMotorLimits.size() : 1;
  std::vector<Hypothesis> tried(forms);
  in_parallel(forms, [&](std::size_t i) {
    Hypothesis& h = tried[i];
    LimitFit fit = with_motor_limit(loop.model, kMotorLimits[i], search_.training());
    h.structure = extended_by(loop.structure, kMotorLimits[i]);
    h.model = std::move(fit.model);
    h.cost = fit.rms;
  });
  return best_beside(std::move(tried));
}

bool Selector::change_beside(const Hypothesis& loop) {
  std::vector<std::size_t> kinds = changes_in_time();
  std::erase_if(kinds, [&](std::size_t kind) { return options_.leaves_out(cause_of(kind)); });
  if (kinds.empty()) return false;
  search_.follow(loop);
  const std::vector<Screened> screened = search_.screen(loop, kinds);
  std::vector<Hypothesis> tried(screened.size());
  in_parallel(screened.size(), [&](std::size_t i) {
    const Screened& s = screened[i];
    Hypothesis& h = tried[i];
    options_.begin(identity_of(s.kind).id);
    h.structure = extended_by(loop.structure, s.kind);
    if (!s.shapes.empty() && search_.vary(h, loop.model, s.kind, s.shapes))
      h.cost = servotwin::judge(h.model, search_.training()).rms;
  });
  return best_beside(std::move(tried));
}

bool Selector::best_beside(std::vector<Hypothesis> tried) {
  std::erase_if(tried, [](const Hypothesis& h) { return !(h.cost < Hypothesis().cost); });
  for (Hypothesis& h : tried) {
    for (int round = 0; round < kPolishes; ++round) search_.polish(h);
    h.point = point_of(h.model, h.structure);
    h.cost = servotwin::judge(h.model, search_.training()).rms;
  }
  std::erase_if(tried, [&](const Hypothesis& h) { return !search_.is_plausible(h.model); });
  if (tried.empty()) {
    search_.follow(now_.current);
    return false;
  }
  // Of the forms of one cause the first, unless another one leaves less by more than chance.
  const auto worth = [](const Hypothesis& h) {
    return h.cost /
           (identity_of(h.structure.effects.back()).form_of.empty() ? 1.0 : kMaxRmsRatioToAdd);
  };
  std::sort(tried.begin(), tried.end(),
            [&](const Hypothesis& l, const Hypothesis& r) { return worth(l) < worth(r); });
  const State before = now_;
  const std::size_t kind = tried.front().structure.effects.back();
  now_.current = tried.front();
  settle();
  steps_.push_back(
      text("  with %s: %s RMS", identity_of(kind).id.data(), size_of(now_.current.rms()).c_str()));
  if (!(now_.current.rms() < kMaxRmsRatioOfPart * before.current.rms())) {
    back_to(before);
    return false;
  }
  now_.found.clear();
  rejected_.clear();
  friction_ = 0.0;
  last_ = cause_of(kind);
  Cause cause = cause_by_improvement(last_, before.current);
  for (const Hypothesis& rival : tried) {
    const std::string id = cause_of(rival.structure.effects.back());
    if (id != last_ && kMaxRmsRatioClearlyBetter * rival.cost < tried.front().cost)
      cause.ambiguous_with.push_back(id);
  }
  now_.found[last_] = {std::move(cause), kind};
  return true;
}

bool Selector::begin_with_part() {
  const double over_floor = now_.current.rms() / search_.floor().rms;
  const bool gross =
      baseline_ > kGrossOverFloor * search_.floor().rms && over_floor > kLeftOverFloor;
  const auto limit_promises = [&] {
    if (!(over_floor > kMinRmsOverFloorOfLimit) || options_.leaves_out("torque_saturation") ||
        motor_limit_of(now_.current.model) != nullptr)
      return false;
    const std::vector<Screened> one = search_.screen(now_.current, {kMotorLimits.front()});
    return !one.empty() && one.front().gain > kMinGainOfLimit;
  };
  if (!gross && !limit_promises()) return false;
  const std::vector<Segment>& training = search_.training();
  if (!options_.leaves_out("torque_saturation")) {
    const double peak = motion_range(training).acceleration;
    for (const double share : kHardShares) {
      const auto loop = loop_of_part(away_from(hard_moments(training, share * peak), training),
                                     text("without accelerations beyond %.0f %%", 100.0 * share));
      if (loop && limit_beside(*loop)) return true;
    }
  }
  if (!gross) return false;
  // What sets in changes all that follows: the loop is that of what was before.
  const double begin_s = training.front().start_s, end_s = training.back().end_s();
  std::optional<Hypothesis> best;
  double least = Hypothesis().cost;
  for (const double share : kFirstShares) {
    const std::vector<Segment> part = cut(training, begin_s, begin_s + share * (end_s - begin_s));
    auto loop = loop_of_part(part, text("of the first %.0f %%", 100.0 * share));
    if (!loop) continue;
    if (const double left = servotwin::judge(loop->model, part).rms; left < least)
      least = left, best = std::move(loop);
  }
  return best && change_beside(*best);
}

}  // namespace servotwin
