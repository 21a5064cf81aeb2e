// One round of the search for causes: which candidates are fitted, and which of them is added.
#include <algorithm>
#include <cmath>

#include "diagnosis/search/selector.h"
#include "diagnosis/statistics/thresholds.h"
#include "identification/least_squares/parallel.h"

namespace servotwin {

namespace {

constexpr std::size_t kMaxFitsPerRound = 3;  // candidates

void sort_by_left(std::vector<Tried>& tried) {
  std::sort(tried.begin(), tried.end(),
            [](const Tried& l, const Tried& r) { return l.left() < r.left(); });
}

bool acts_at_moments(std::size_t kind) {
  const auto shapes = shapes_of(kind);
  return !shapes.empty() && shapes.front().scan == Scan::kMoments;
}

/// The cause that the chosen one of these models, with its rivals.
Cause cause_among(const std::vector<Tried>& tried, const Tried& chosen,
                  const Judgement& judgement) {
  Cause cause;
  cause.id = cause_of(chosen.screened.kind);
  cause.statistic = judgement.z;
  cause.p = judgement.p;
  cause.wins = 1.0 - judgement.p;
  for (const Tried& rival : tried) {
    // Two laws of the same cause are not rivals.
    if (cause_of(rival.screened.kind) == cause.id || rival.screened.p > kFalseAlarmRate) continue;
    const double wins = share_won(chosen, rival);
    // Pushes may explain more than a law that is preferred to them.
    if (!acts_at_moments(rival.screened.kind) || acts_at_moments(chosen.screened.kind))
      cause.wins = std::min(cause.wins, wins);
    if (wins < kMinShareToExcludeRival &&
        1.0 - rival.left() > kMinGainShareOfRival * (1.0 - chosen.left()))
      cause.ambiguous_with.push_back(cause_of(rival.screened.kind));
  }
  return cause;
}

}  // namespace

bool Selector::add_one() {
  if (!now_.current.has(kind_of<CuttingForce>())) search_.detect_cuts(now_.current.model);
  const std::vector<std::size_t> kinds = kinds_to_screen();
  auto [tried, doubted] = fitted(promising_of(kinds));
  polish_rivals(tried);
  const Bar bar{baseline_, friction_, kinds.size()};
  const auto earned = [&](const Tried& one) { return judged(one, bar).earned; };
  auto chosen = std::find_if(tried.begin(), tried.end(), earned);
  if (chosen == tried.end()) {
    judge_again(doubted, tried);
    chosen = std::find_if(tried.begin(), tried.end(), earned);
  }
  if (chosen == tried.end()) {
    if (!tried.empty()) steps_.emplace_back("  no candidate improves the model significantly");
    return false;
  }
  // Of two candidates that the blocks do not distinguish, prefer the one with fewer parameters.
  // Pushes at free moments follow whatever happens at a few breakaways. What acts by a law is
  // preferred to them, even where the pushes leave less, and even where what it explains is no more
  // than the misfit of a law of friction may be.
  const Bar beside_pushes{baseline_, 0.0, kinds.size()};
  for (auto rival = chosen + 1; rival != tried.end(); ++rival) {
    const bool before_pushes = acts_at_moments(chosen->screened.kind);
    if (parameters_of(rival->screened.kind) < parameters_of(chosen->screened.kind) &&
        judged(*rival, before_pushes ? beside_pushes : bar).earned &&
        (before_pushes || share_won(*chosen, *rival) < kMinShareToExcludeRival) &&
        1.0 - rival->left() > (before_pushes ? kMinGainShareOfRival : kMinGainShareOfSimpler) *
                                  (1.0 - chosen->left()))
      chosen = rival;
  }
  const auto is_for = [&](std::size_t kind) {
    return identity_of(chosen->screened.kind).cause == identity_of(kind).cause;
  };
  if ((is_for(kind_of<Compliance>()) && delay_does_better(chosen->model)) ||
      ((is_for(kind_of<Compliance>()) || is_for(kind_of<Backlash>())) &&
       filter_does_better(chosen->model)))
    return add_one();
  steps_.push_back(text("  %s: added", identity_of(chosen->screened.kind).id.data()));
  Cause cause = cause_among(tried, *chosen, judged(*chosen, bar));
  last_ = cause.id;
  now_.found[last_] = {std::move(cause), chosen->screened.kind};
  now_.current = Hypothesis(chosen->model);
  return true;
}

std::vector<std::size_t> Selector::kinds_to_screen() const {
  std::vector<std::string> known;
  for (const auto& [id, one] : now_.found) known.push_back(id);
  Channels channels(search_.recorded(), options_.encoder_in_loop);
  channels.rotary = search_.rotary();
  std::vector<std::size_t> kinds =
      candidates_of(now_.current.structure, known, options_.leave_out, channels);
  std::erase_if(kinds, [&](std::size_t kind) { return rejected_.count(kind) > 0; });
  return kinds;
}

std::vector<Screened> Selector::promising_of(const std::vector<std::size_t>& kinds) {
  std::vector<Screened> promising = search_.screen(now_.current, kinds);
  std::erase_if(promising,
                [](const Screened& s) { return s.p > kMaxScreenP || s.gain < kMinScreenGain; });
  if (promising.size() > 2 * kMaxFitsPerRound) promising.resize(2 * kMaxFitsPerRound);
  std::string step = text("%s RMS, promising candidates:", size_of(now_.current.rms()).c_str());
  for (const Screened& s : promising)
    step += text(" %s (%.1f %%, p %.1g)", identity_of(s.kind).id.data(), 100.0 * s.gain, s.p);
  steps_.push_back(promising.empty() ? step + " none" : step);
  return promising;
}

Selector::Fitted Selector::fitted(const std::vector<Screened>& promising) {
  Fitted out;
  auto& [tried, doubted] = out;
  std::vector<Candidate> candidates;
  for (std::size_t at = 0; at < promising.size(); ++at) {
    if (tried.size() == kMaxFitsPerRound) break;
    if (at == candidates.size()) fit_some(promising, kMaxFitsPerRound - tried.size(), candidates);
    const Screened& s = promising[at];
    auto& [h, beside, fits, varies] = candidates[at];
    if (!fits && !varies) continue;
    if (fits && h.cost < kMaxErrorRatioOfLargeGain * now_.fitted.cost)
      doubted.push_back({h, &now_.as_is, s});
    const bool is_beside =
        varies && (!fits || beside.rms() * now_.fitted.rms() < h.rms() * now_.as_is.rms());
    tried.push_back(
        {is_beside ? std::move(beside) : std::move(h), is_beside ? &now_.as_is : &now_.fitted, s});
    steps_.push_back(text("  with %s: %s RMS%s, z %.1f", identity_of(s.kind).id.data(),
                          size_of(tried.back().model.rms()).c_str(),
                          is_beside ? " with the loop fixed" : "",
                          paired_z(tried.back().before->pieces, tried.back().model.pieces)));
    // A candidate that explains nothing does not count towards kMaxFitsPerRound.
    if (!(tried.back().left() < 1.0)) tried.pop_back();
  }
  sort_by_left(tried);
  return out;
}

void Selector::judge_again(std::vector<Tried>& doubted, std::vector<Tried>& tried) {
  for (Tried& one : doubted) {
    options_.begin(identity_of(one.screened.kind).id);
    search_.polish(one.model);
    search_.judge_as_is(one.model);
    if (one.left() > kMaxErrorRatioOfLargeGain) continue;
    search_.judge_polished(one.model);
    steps_.push_back(text("  with %s, refitted in free simulation: %s RMS, z %.1f",
                          identity_of(one.screened.kind).id.data(),
                          size_of(one.model.rms()).c_str(),
                          paired_z(one.before->pieces, one.model.pieces)));
    tried.push_back(std::move(one));
  }
  sort_by_left(tried);
}

void Selector::fit_some(const std::vector<Screened>& promising, std::size_t count,
                        std::vector<Candidate>& candidates) {
  const std::size_t first = candidates.size();
  candidates.resize(std::min(first + count, promising.size()));
  in_parallel(candidates.size() - first, [&](std::size_t i) {
    const Screened& s = promising[first + i];
    options_.begin(identity_of(s.kind).id);
    auto& [h, beside, fits, varies] = candidates[first + i];
    h.structure = beside.structure = extended_by(now_.current.structure, s.kind);
    const Point from = start_of(h.structure, s);
    fits = s.kind == kind_of<Presliding>() ? search_.fit_friction(h, from) : search_.fit(h, {from});
    if (fits) search_.judge(h);
    // A limit that takes more than there is, as it may along a measured motion, runs away.
    fits = fits && std::isfinite(h.rms());
    varies = search_.vary(beside, now_.current.model, s.kind, s.shapes);
  });
}

void Selector::polish_rivals(std::vector<Tried>& tried) {
  if (tried.size() < 2) return;
  const bool moments =
      is_intermittent(tried[0].screened.kind) && is_intermittent(tried[1].screened.kind);
  if (!moments && 1.0 - tried[1].left() < kMinGainShareOfRival * (1.0 - tried[0].left())) return;
  for (std::size_t i = 0; i < 2; ++i) {
    options_.begin(identity_of(tried[i].screened.kind).id);
    Tried best{tried[i].model, &now_.fitted, tried[i].screened};
    if (const auto moment = moment_of(tried[1 - i].model, tried[1 - i].screened.kind);
        moment && moment_of(best.model, best.screened.kind)) {
      // The time at which an effect sets in is not unique between two moves: the fit also starts
      // from the time that the rival found.
      Hypothesis there;
      there.structure = best.model.structure;
      Point from = best.model.point;
      from.shapes[shapes_before(there.structure, best.screened.kind)] = *moment;
      if (search_.fit(there, {from})) {
        search_.judge(there);
        if (there.rms() < best.model.rms()) best.model = std::move(there);
      }
    }
    search_.polish(best.model);
    Hypothesis as_is = best.model;
    search_.judge_as_is(as_is);
    search_.judge(best.model);
    // Coefficients estimated along the measured motion may not suit the simulation.
    if (as_is.rms() < kMaxRmsRatioClearlyBetter * best.model.rms()) {
      search_.judge_polished(best.model);
      best.before = &now_.current;  // refitted in free simulation as well
    }
    steps_.push_back(text("  refitted in free simulation, with %s: %s RMS",
                          identity_of(best.screened.kind).id.data(),
                          size_of(best.model.rms()).c_str()));
    if (best.left() < tried[i].left() && search_.is_plausible(best.model.model))
      tried[i] = std::move(best);
  }
  sort_by_left(tried);
}

std::optional<double> Selector::moment_of(const Hypothesis& h, std::size_t kind) {
  const auto shapes = shapes_of(kind);
  if (shapes.empty() || shapes.front().scan != Scan::kTime) return {};
  return h.point.shapes[shapes_before(h.structure, kind)];
}

std::size_t Selector::shapes_before(const Structure& structure, std::size_t kind) {
  std::size_t count = 0;
  for (const std::size_t one : structure.effects) {
    if (one == kind) break;
    count += shapes_of(one).size();
  }
  return count;
}

Point Selector::start_of(const Structure& structure, const Screened& s) const {
  Point at = point_of(now_.current.model, structure);
  std::copy(s.shapes.begin(), s.shapes.end(),
            at.shapes.begin() + static_cast<std::ptrdiff_t>(shapes_before(structure, s.kind)));
  return at;
}

}  // namespace servotwin
