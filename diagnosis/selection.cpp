#include "diagnosis/selection.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <complex>
#include <functional>
#include <optional>
#include <set>
#include <stdexcept>
#include <string_view>

#include "diagnosis/judgement.h"
#include "diagnosis/text.h"
#include "diagnosis/thresholds.h"
#include "identification/least_squares/parallel.h"
#include "identification/loop/two_mass_fit.h"
#include "twin/shown_units.h"
#include "twin/two_mass_axis.h"

namespace servotwin {

namespace {

// RMS with a new cause over RMS before, both refitted in free simulation: with a smaller
// improvement the cause is discarded, since better values of the other parameters did as much.
constexpr double kMaxRmsRatioAfterRefit = 0.99;
// RMS over noise floor above which a law of friction with a free virgin curve is tried.
constexpr double kMinRmsOverFloorForFreeLaw = 2.0;
// The same above which an axis of two masses is tried.
constexpr double kMinRmsOverFloorForTwoMasses = 1.5;
// RMS over RMS of the current model below which a model is clearly better; demanded of a law of
// friction that implies more than is known.
constexpr double kMaxRmsRatioClearlyBetter = 0.8;
// Share of the squared error that the screen must forecast for a force that grows at rest, for it
// to be tried beside other laws of friction.
constexpr double kMinScreenGainBesideLaw = 0.1;
constexpr std::size_t kMaxFitsPerRound = 3;  // candidates
// RMS of a rigid axis with a loop of the other order over that with this one, above which two
// masses are not tried in it.
constexpr double kMaxRmsRatioOfOtherOrder = 3.0;
// RMS with a delay over RMS with a mode below which the delay replaces the mode.
constexpr double kMaxRmsRatioDelayOverMode = 0.9;

/// Adds causes one by one, as long as each improves the model enough.
class Selection {
 public:
  Selection(Search& search, Hypothesis baseline, const DiagnoseOptions& options)
      : search_(search), now_{std::move(baseline), {}, {}, {}}, options_(options) {}

  void run() {
    settle();
    settled_ = now_.current.model;
    delay();
    baseline_ = now_.current.rms();
    integrator();
    add_causes();
    if (free_law()) add_causes();
    if (part_masses()) add_causes();
    if (law_beside_rests()) add_causes();
    replace_misfit_by_law();
  }
  [[nodiscard]] const Hypothesis& current() const { return now_.current; }
  [[nodiscard]] const Model& settled() const { return settled_; }
  [[nodiscard]] const std::optional<Hypothesis>& undelayed() const { return undelayed_; }
  [[nodiscard]] const std::map<std::string, Found>& found() const { return now_.found; }
  [[nodiscard]] const std::vector<std::string>& steps() const { return steps_; }

 private:
  /// Everything that an attempt changes; restored if the attempt improves nothing.
  struct State {
    Hypothesis current;  ///< the present model, refitted in free simulation
    Hypothesis fitted;   ///< the same structure fitted by projection, to compare candidates with
    Hypothesis as_is;    ///< `current` with its error on all blocks, its coefficients fixed
    std::map<std::string, Found> found;
  };
  void back_to(const State& before) {
    now_ = before;
    search_.follow(now_.current);
  }

  void add_causes() {
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
      // Discard a cause if better values of the other parameters lower the error as much.
      const bool stays_it = !now_.current.has(added) ||
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

  /// An error as the steps show it.
  [[nodiscard]] std::string size_of(double rms) const { return micro_text(rms, search_.rotary()); }

  [[nodiscard]] bool is_left_out(std::string_view cause) const {
    const auto& all = options_.leave_out;
    return std::find(all.begin(), all.end(), cause) != all.end();
  }

  /// Throws where the diagnosis was asked to stop.
  void check_stop() const {
    if (options_.stop.stop_requested()) throw std::runtime_error("stopped before it was finished");
  }

  /// Refits the present structure as well as possible, before candidates are added to it.
  void settle() {
    check_stop();
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

  /// Removes the delay if a loop with free numerator fits as well without it: unmodelled friction
  /// can look like a delay.
  void delay() {
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
    for (const std::vector<Point>& from :
         {std::vector<Point>{point_of(now_.current.model, h.structure)}, std::vector<Point>{}}) {
      if (!search_.fit(h, from)) continue;
      search_.polish(h);
      search_.judge(h);
      needed =
          !tiny && !lag &&
          (now_.current.rms() < kMaxRmsRatioToAdd * h.rms() || delay_in_disguise(h.model.loop));
      if (!needed) break;
    }
    if (needed) return;
    steps_.push_back(text("delay of %.3g ms: not needed", 1e3 * delay_s));
    now_.current = std::move(h);
    settle();
    undelayed_ = now_.current;
  }

  /// Adds a delay to a loop with a velocity error; the structures of the baseline do not combine
  /// the two. False where it does not improve the model enough.
  bool add_delay() {
    if (now_.current.has(kind_of<TimeDelay>()) || options_.identify.delay_max_s <= 0.0 ||
        is_left_out("time_delay"))
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
    const bool small_gain = best.rms() >= kMaxErrorRatioOfLargeGain * now_.fitted.rms() &&
                            removed_rms(now_.fitted, best) < kLawMisfitShare * friction_;
    if (best.rms() >= kMaxRmsRatioToAdd * now_.fitted.rms() || small_gain ||
        paired_z(now_.fitted.pieces, best.pieces) < kMinBlockZ)
      return false;
    steps_.push_back(
        text("with a delay of %.3g ms: %s RMS", 1e3 * delay_s, size_of(best.rms()).c_str()));
    const State before = now_;
    now_.current = std::move(best);
    settle();
    if (now_.current.rms() < kMaxRmsRatioToAdd * before.current.rms()) return true;
    back_to(before);
    return false;
  }

  /// Replaces a mode by a delay where that fits better: the poles and zeros of a mode can imitate a
  /// delay, which needs one parameter instead of four.
  bool delay_does_better(Hypothesis mode) {
    const State before = now_;
    if (!add_delay()) return false;
    search_.polish(mode);
    search_.judge(mode);
    if (now_.current.rms() < kMaxRmsRatioDelayOverMode * mode.rms()) return true;
    back_to(before);
    return false;
  }

  /// Where to search the poles of a loop of the other order, with the present shape parameters:
  /// with a slow pole more, or without one of the real ones.
  [[nodiscard]] std::vector<Point> starts_in_other_order(const Structure& structure) const {
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

  /// Tries a loop with an integrator where the model has none. An integrator is not a cause but
  /// part of the loop beside which causes are searched; a missing cause may have hidden it.
  void integrator() {
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
    steps_.push_back(
        text("integrator: %s, %s RMS", better ? "yes" : "no", size_of(h.rms()).c_str()));
    if (!better) return;
    const State before = now_;
    now_.current = std::move(h);
    // With an integrator in the loop a constant force is not observable.
    std::erase_if(now_.found, [&](const auto& one) { return !now_.current.has(one.second.kind); });
    settle();
    if (now_.as_is.rms() < kMaxRmsRatioToAdd * before.as_is.rms()) return;
    back_to(before);
  }

  bool add_one() {
    if (!now_.current.has(kind_of<CuttingForce>())) search_.detect_cuts(now_.current.model);
    std::vector<std::string> known;
    for (const auto& [id, one] : now_.found) known.push_back(id);
    Channels channels(search_.recorded(), options_.encoder_in_loop);
    channels.rotary = search_.rotary();
    std::vector<std::size_t> kinds =
        candidates_of(now_.current.structure, known, options_.leave_out, channels);
    std::erase_if(kinds, [&](std::size_t kind) { return rejected_.count(kind) > 0; });
    std::vector<Screened> promising = search_.screen(now_.current, kinds);
    std::erase_if(promising,
                  [](const Screened& s) { return s.p > kMaxScreenP || s.gain < kMinScreenGain; });
    if (promising.size() > 2 * kMaxFitsPerRound) promising.resize(2 * kMaxFitsPerRound);
    std::string step = text("%s RMS, promising candidates:", size_of(now_.current.rms()).c_str());
    for (const Screened& s : promising)
      step += text(" %s (%.1f %%, p %.1g)", identity_of(s.kind).id.data(), 100.0 * s.gain, s.p);
    steps_.push_back(promising.empty() ? step + " none" : step);
    std::vector<Tried> tried, doubted;
    std::vector<Candidate> candidates;
    for (std::size_t at = 0; at < promising.size(); ++at) {
      if (tried.size() == kMaxFitsPerRound) break;
      check_stop();
      if (at == candidates.size()) fit_some(promising, kMaxFitsPerRound - tried.size(), candidates);
      const Screened& s = promising[at];
      auto& [h, beside, fits, varies] = candidates[at];
      if (!fits && !varies) continue;
      // A candidate that explains much of the training data is kept for a second judgement, in case
      // the left-out blocks disagree.
      if (fits && h.cost < kMaxErrorRatioOfLargeGain * now_.fitted.cost)
        doubted.push_back({h, &now_.as_is, s});
      const bool is_beside =
          varies && (!fits || beside.rms() * now_.fitted.rms() < h.rms() * now_.as_is.rms());
      tried.push_back({is_beside ? std::move(beside) : std::move(h),
                       is_beside ? &now_.as_is : &now_.fitted, s});
      steps_.push_back(text("  with %s: %s RMS%s, z %.1f", identity_of(s.kind).id.data(),
                            size_of(tried.back().model.rms()).c_str(),
                            is_beside ? " with the loop fixed" : "",
                            paired_z(tried.back().before->pieces, tried.back().model.pieces)));
      // A candidate that explains nothing does not count towards kMaxFitsPerRound.
      if (!(tried.back().left() < 1.0)) tried.pop_back();
    }
    std::sort(tried.begin(), tried.end(),
              [](const Tried& l, const Tried& r) { return l.left() < r.left(); });
    polish_rivals(tried);
    const Bar bar{baseline_, friction_, kinds.size()};
    const auto judgement_of = [&](const Tried& one) { return judged(one, bar); };
    auto chosen = std::find_if(tried.begin(), tried.end(),
                               [&](const Tried& one) { return judgement_of(one).earned; });
    if (chosen == tried.end()) {
      for (Tried& one : doubted) {
        check_stop();
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
      std::sort(tried.begin(), tried.end(),
                [](const Tried& l, const Tried& r) { return l.left() < r.left(); });
      chosen = std::find_if(tried.begin(), tried.end(),
                            [&](const Tried& one) { return judgement_of(one).earned; });
    }
    if (chosen == tried.end()) {
      if (!tried.empty()) steps_.emplace_back("  no candidate improves the model significantly");
      return false;
    }
    // Of two candidates that the blocks do not distinguish, prefer the one with fewer parameters.
    for (auto rival = chosen + 1; rival != tried.end(); ++rival) {
      if (parameters_of(rival->screened.kind) < parameters_of(chosen->screened.kind) &&
          judgement_of(*rival).earned && share_won(*chosen, *rival) < kMinShareToExcludeRival &&
          1.0 - rival->left() > kMinGainShareOfSimpler * (1.0 - chosen->left()))
        chosen = rival;
    }
    if (chosen->screened.kind == kind_of<Compliance>() && delay_does_better(chosen->model))
      return add_one();
    const Judgement judgement = judgement_of(*chosen);
    const Screened& screened = chosen->screened;
    steps_.push_back(text("  %s: added", identity_of(screened.kind).id.data()));
    Cause cause;
    cause.statistic = judgement.z;
    cause.p = judgement.p;
    cause.wins = 1.0 - judgement.p;
    for (const Tried& rival : tried) {
      // Two laws of the same cause are not rivals.
      if (cause_of(rival.screened.kind) == cause_of(screened.kind) ||
          rival.screened.p > kFalseAlarmRate)
        continue;
      const double wins = share_won(*chosen, rival);
      cause.wins = std::min(cause.wins, wins);
      if (wins < kMinShareToExcludeRival &&
          1.0 - rival.left() > kMinGainShareOfRival * (1.0 - chosen->left()))
        cause.ambiguous_with.push_back(cause_of(rival.screened.kind));
    }
    cause.id = cause_of(screened.kind);
    now_.found[cause.id] = {cause, screened.kind};
    last_ = cause.id;
    now_.current = Hypothesis(chosen->model);
    return true;
  }

  /// A candidate fitted together with the loop, which may have absorbed a part of the effect; and
  /// with the loop fixed, which is better where the measured motion is less accurate than the
  /// simulated.
  struct Candidate {
    Hypothesis h, beside;
    bool fits = false, varies = false;
  };
  /// Fits the next `count` of these, as far as there are so many.
  void fit_some(const std::vector<Screened>& promising, std::size_t count,
                std::vector<Candidate>& candidates) {
    const std::size_t first = candidates.size();
    candidates.resize(std::min(first + count, promising.size()));
    in_parallel(candidates.size() - first, [&](std::size_t i) {
      check_stop();
      const Screened& s = promising[first + i];
      auto& [h, beside, fits, varies] = candidates[first + i];
      h.structure = beside.structure = extended_by(now_.current.structure, s.kind);
      const Point from = start_of(h.structure, s);
      fits =
          s.kind == kind_of<Presliding>() ? search_.fit_friction(h, from) : search_.fit(h, {from});
      if (fits) search_.judge(h);
      varies = search_.vary(beside, now_.current.model, s.kind, s.shapes);
    });
  }

  /// Refits the two best candidates in free simulation where they explain nearly the same, so that
  /// the better one is chosen by its best fit. So does a limit beside pushes at free moments: the
  /// loop that was fitted without the limit stands for a part of it.
  void polish_rivals(std::vector<Tried>& tried) {
    if (tried.size() < 2) return;
    const bool moments =
        is_intermittent(tried[0].screened.kind) && is_intermittent(tried[1].screened.kind);
    if (!moments && 1.0 - tried[1].left() < kMinGainShareOfRival * (1.0 - tried[0].left())) return;
    for (std::size_t i = 0; i < 2; ++i) {
      check_stop();
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
    std::sort(tried.begin(), tried.end(),
              [](const Tried& l, const Tried& r) { return l.left() < r.left(); });
  }

  /// The time at which an effect sets in; nothing where it acts all the time.
  [[nodiscard]] static std::optional<double> moment_of(const Hypothesis& h, std::size_t kind) {
    const auto shapes = shapes_of(kind);
    if (shapes.empty() || shapes.front().scan != Scan::kTime) return {};
    return h.point.shapes[shapes_before(h.structure, kind)];
  }

  [[nodiscard]] static std::size_t shapes_before(const Structure& structure, std::size_t kind) {
    std::size_t count = 0;
    for (const std::size_t one : structure.effects) {
      if (one == kind) break;
      count += shapes_of(one).size();
    }
    return count;
  }

  [[nodiscard]] Point start_of(const Structure& structure, const Screened& s) const {
    Point at = point_of(now_.current.model, structure);
    std::copy(s.shapes.begin(), s.shapes.end(),
              at.shapes.begin() + static_cast<std::ptrdiff_t>(shapes_before(structure, s.kind)));
    return at;
  }

  /// Replaces presliding and falling friction, two effects, by one law of friction where that
  /// predicts better.
  void one_law_of_friction() {
    if (last_ != "presliding" && last_ != "stribeck") return;
    if (is_left_out("presliding") || is_left_out("stribeck")) return;  // the law contains both
    const Found friction = now_.found.at(last_);
    const bool both = now_.found.count("presliding") > 0 && now_.found.count("stribeck") > 0;
    if (std::find(kLaws.begin(), kLaws.end(), friction.kind) != kLaws.end()) return;
    Hypothesis best = now_.current;
    std::size_t law = kEffectKinds;
    for (const std::size_t kind : {kind_of<LuGre>(), kind_of<PreslidingStribeck>()}) {
      check_stop();
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

  /// Where the residual stays large with a law of friction, the law itself may be wrong: tries one
  /// whose virgin curve is free. True where that is clearly better and was accepted.
  bool free_law() {
    const auto friction = now_.found.find("presliding");
    if (friction == now_.found.end() ||
        !(now_.current.rms() > kMinRmsOverFloorForFreeLaw * search_.floor().rms))
      return false;
    if (is_left_out("stribeck")) return false;  // the law also falls with speed
    check_stop();
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

  /// A law whose breakaway force is high and falls at once stands for one that grows at rest: tries
  /// that beside every law of friction. True where it is clearly better.
  bool law_beside_rests() {
    const std::size_t dwell = kind_of<DwellStiction>();
    if (now_.found.count("presliding") + now_.found.count("stribeck") == 0 ||
        now_.current.has(dwell) || has_two_masses(now_.current.structure) ||
        is_left_out(cause_of(dwell)) ||
        !(now_.current.rms() > kMinRmsOverFloorForTwoMasses * search_.floor().rms))
      return false;
    const Screened screened = search_.screen(now_.current, {dwell}).front();
    if (screened.p > kMaxScreenP || screened.gain < kMinScreenGainBesideLaw) return false;
    std::vector<Hypothesis> all;
    for (const std::size_t law : kLawsOnLoad) {
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
    check_stop();
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
    Cause cause;
    cause.id = last_ = cause_of(dwell);
    cause.statistic = paired_z(before.current.pieces, now_.current.pieces);
    cause.p = 0.5 * std::erfc(cause.statistic / std::sqrt(2.0));
    cause.wins = 1.0 - cause.p;
    now_.found.erase("stribeck");
    now_.found[cause.id] = {cause, dwell};
    named_by(law, cause);
    steps_.push_back(text("  %s: added", cause.id.c_str()));
    rejected_.clear();
    return true;
  }

  /// Where much stays unexplained, or a mode or a gap beside a rigid axis was found, the axis may
  /// not be rigid: tries one of two masses, beside its law of friction alone, beside all causes
  /// found so far, and in a loop of the other order, since a rigid loop takes over a part of the
  /// vibration. True where one is clearly better: the causes that stood for it are forgotten.
  bool part_masses() {
    if (!(now_.current.rms() > kMinRmsOverFloorForTwoMasses * search_.floor().rms)) return false;
    // As for a single cause: what is left may be the misfit of the law of friction.
    const double misfit =
        std::max(kMinRemovedShareOfCause * baseline_, kLawMisfitShare * friction_);
    const auto is_found = [&](const char* id) { return now_.found.count(id) > 0; };
    if (!(now_.current.rms() > misfit) && !is_found("compliance") && !is_found("backlash"))
      return false;
    const bool reading = Channels(search_.recorded(), options_.encoder_in_loop).reading;
    std::vector<std::size_t> kinds;
    for (std::size_t kind = 0; kind < kEffectKinds; ++kind) {
      // Play in front of an encoder outside the loop is an effect on its reading.
      const bool asked =
          kind != kind_of<PlayOutside>() && (reading || kind != kind_of<TwoMassOutside>());
      if (acts_on_axis(kind) && asked && !is_left_out(cause_of(kind))) kinds.push_back(kind);
    }
    if (kinds.empty()) return false;
    const State before = now_;
    const auto bare = [&](int order) {
      Hypothesis h;
      h.structure = now_.current.structure;
      h.structure.order = order;
      std::erase_if(h.structure.effects, [](std::size_t kind) {
        return !is_friction_law(kind) && kind != kind_of<ConstantForce>() &&
               kind != kind_of<TimeDelay>();
      });
      const bool same = order == now_.current.structure.order;
      const std::vector<Point> from = same ? std::vector{point_of(now_.current.model, h.structure)}
                                           : starts_in_other_order(h.structure);
      if (!search_.fit(h, from)) return Hypothesis();
      search_.polish(h);
      return h;
    };
    const auto full = [&] {
      Hypothesis h = now_.current;
      std::erase_if(h.structure.effects, [](std::size_t kind) {
        return cause_of(kind) == "compliance" || cause_of(kind) == "backlash";
      });
      std::erase_if(h.model.effects, [](const Effect& effect) {
        return cause_of(effect.kind) == "compliance" || cause_of(effect.kind) == "backlash";
      });
      h.point = point_of(h.model, h.structure);
      return h;
    };
    std::vector<std::size_t> laws;
    for (const std::size_t law : kLawsOnLoad) {
      const bool falls = law != kind_of<Presliding>();
      if (!is_left_out("presliding") && !(falls && is_left_out("stribeck"))) laws.push_back(law);
    }
    const auto left_by = [&](const Hypothesis& h) {  // in the training data
      return h.structure.effects.empty() ? kAbsent
                                         : servotwin::judge(h.model, search_.training()).rms;
    };
    const double left = left_by(now_.current);
    Hypothesis best;
    double least = kMaxRmsRatioClearlyBetter * now_.current.rms();
    const auto take = [&](const Hypothesis& rigid) {
      check_stop();
      Hypothesis h;
      if (rigid.structure.effects.empty() || !search_.part_masses(h, rigid, kinds, laws, left))
        return;
      // The cross-validation takes as long as four fits.
      if (!(left_by(h) < kMaxRmsRatioClearlyBetter * left)) return;
      search_.judge(h);
      steps_.push_back(text("as two masses (%s) beside %zu effects, order %d: %s RMS",
                            identity_of(two_mass_of(h.model)->kind).id.data(),
                            rigid.structure.effects.size(), h.structure.order,
                            size_of(h.rms()).c_str()));
      if (h.rms() < least) least = h.rms(), best = std::move(h);
    };
    const int order = now_.current.structure.order;
    const Hypothesis law_alone = bare(order);
    take(law_alone);
    if (best.structure.effects.empty() &&
        law_alone.structure.effects.size() < now_.current.structure.effects.size())
      take(full());
    if (options_.identify.order == 0 &&
        !(least < kMinRmsOverFloorForTwoMasses * search_.floor().rms)) {
      const Hypothesis other = bare(order == 2 ? 3 : 2);
      if (!(left_by(other) > kMaxRmsRatioOfOtherOrder * left_by(law_alone))) take(other);
    }
    if (best.structure.effects.empty()) return false;
    now_.current = std::move(best);
    settle();
    if (!(now_.current.rms() < kMaxRmsRatioClearlyBetter * before.current.rms()) ||
        !search_.is_plausible(now_.current.model)) {
      back_to(before);
      return false;
    }
    std::erase_if(now_.found, [&](const auto& one) { return !now_.current.has(one.second.kind); });
    const std::size_t kind = two_mass_of(now_.current.model)->kind;
    Cause cause;
    cause.id = last_ = cause_of(kind);
    cause.statistic = paired_z(before.current.pieces, now_.current.pieces);
    cause.p = 0.5 * std::erfc(cause.statistic / std::sqrt(2.0));
    cause.wins = 1.0 - cause.p;
    now_.found[cause.id] = {cause, kind};
    const auto& effects = now_.current.structure.effects;
    const auto law = std::find_if(effects.begin(), effects.end(), is_friction_law);
    if (law != effects.end() && *law != kind_of<CoulombFriction>()) named_by(*law, cause);
    steps_.push_back(text("  %s: added", cause.id.c_str()));
    rejected_.clear();
    return true;
  }

  /// The misfit of a wrong law of friction can look like backlash, a mode or dwell stiction:
  /// removes such a cause where another law of friction fits as well without it.
  void replace_misfit_by_law() {
    for (const auto& [id, one] : std::map<std::string, Found>(now_.found)) {
      if (id == "presliding" || id == "stribeck" || !like_friction(one.kind)) continue;
      Hypothesis best;
      double least = now_.current.rms() / kMaxRmsRatioToAdd;
      for (const std::size_t law :
           {kind_of<Presliding>(), kind_of<LuGre>(), kind_of<PreslidingStribeck>()}) {
        const bool falls = law != kind_of<Presliding>();
        if (is_left_out("presliding") || (falls && is_left_out("stribeck"))) continue;
        check_stop();
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

  /// Names the causes contained in a law of friction: presliding always, stribeck if it was named
  /// before or if the friction of the law changes enough with speed.
  void named_by(std::size_t law, const Cause& evidence) {
    const double ratio = shape_of(now_.current.model, law, "breakaway_ratio");
    for (const char* id : {"presliding", "stribeck"}) {
      if (is_left_out(id)) continue;
      const bool falls = id == std::string("stribeck");
      if (falls && !std::isfinite(ratio)) {
        now_.found.erase(id);
        continue;
      }
      if (falls && now_.found.count(id) == 0 && std::abs(ratio - 1.0) <= kMinStribeckShare)
        continue;
      Found found{now_.found.count(id) > 0 ? now_.found.at(id).cause : evidence, law};
      found.cause.id = id;
      now_.found[id] = found;
    }
  }

  /// Removes a cause that a later one has made unnecessary.
  void remove_unnecessary() {
    if (now_.found.size() < 2) return;
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
      if (std::min(now_.fitted.rms(), now_.current.rms()) < kMaxRmsRatioToAdd * less.rms())
        continue;
      steps_.push_back(text("  %s: no longer needed, removed", id.c_str()));
      now_.current = std::move(less);
      now_.found.erase(id);
      // A law that contained both causes has become the effect of the one that stays.
      for (auto& [other, kept] : now_.found) {
        if (now_.current.has(kept.kind)) continue;
        kept.kind = other == "stribeck" ? kind_of<FallingFriction>() : kind_of<Presliding>();
      }
      settle();
      return;
    }
  }

  Search& search_;
  State now_;
  const DiagnoseOptions& options_;
  Model settled_;
  std::optional<Hypothesis> undelayed_;
  std::set<std::size_t> rejected_;
  double baseline_ = 0.0;  // RMS before any cause [m | rad]
  double friction_ = 0.0;  // RMS that laws of friction have removed
  std::string last_;       // the cause added last
  std::vector<std::string> steps_;
};

}  // namespace

Selected select_causes(Search& search, Hypothesis baseline, const DiagnoseOptions& options) {
  Selection selection(search, std::move(baseline), options);
  selection.run();
  return {selection.settled(), selection.current(), selection.undelayed(), selection.found(),
          selection.steps()};
}

}  // namespace servotwin
