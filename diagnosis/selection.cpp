#include "diagnosis/selection.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <set>
#include <stdexcept>
#include <string_view>

#include "diagnosis/judgement.h"
#include "diagnosis/text.h"
#include "diagnosis/thresholds.h"
#include "identification/least_squares/parallel.h"
#include "twin/shown_units.h"

namespace servotwin {

namespace {

// RMS with a new cause over RMS before, both refitted in free simulation: with a smaller
// improvement the cause is discarded, since better values of the other parameters did as much.
constexpr double kMaxRmsRatioAfterRefit = 0.99;
// RMS over noise floor above which a law of friction with a free virgin curve is tried.
constexpr double kMinRmsOverFloorForFreeLaw = 2.0;
// RMS over RMS of the current model below which a model is clearly better; demanded of a law of
// friction that implies more than is known.
constexpr double kMaxRmsRatioClearlyBetter = 0.8;
constexpr std::size_t kMaxFitsPerRound = 3;  // candidates
// RMS with a delay over RMS with a mode below which the delay replaces the mode.
constexpr double kMaxRmsRatioDelayOverMode = 0.9;

/// Adds causes one by one, as long as each improves the model enough.
class Selection {
 public:
  Selection(Search& search, Hypothesis baseline, const DiagnoseOptions& options)
      : search_(search), current_(std::move(baseline)), options_(options) {}

  void run() {
    settle();
    settled_ = current_.model;
    delay();
    baseline_ = current_.rms();
    integrator();
    add_causes();
    if (free_law()) add_causes();
    replace_misfit_by_law();
  }
  [[nodiscard]] const Hypothesis& current() const { return current_; }
  [[nodiscard]] const Model& settled() const { return settled_; }
  [[nodiscard]] const std::optional<Hypothesis>& undelayed() const { return undelayed_; }
  [[nodiscard]] const std::map<std::string, Found>& found() const { return found_; }
  [[nodiscard]] const std::vector<std::string>& steps() const { return steps_; }

 private:
  void add_causes() {
    while (static_cast<int>(found_.size()) < kMaxCauses) {
      const Hypothesis current = current_, fitted = fitted_, as_is = as_is_;
      const auto found = found_;
      if (!add_one()) {
        if (!add_delay()) break;
        continue;
      }
      const std::size_t added = found_.at(last_).kind;
      settle();
      delay();
      one_law_of_friction();
      integrator();
      // Discard a cause if better values of the other parameters lower the error as much.
      const bool stays_it = !current_.has(added) || !search_.is_plausible(current.model) ||
                            search_.is_plausible(current_.model);
      if (current_.rms() >= kMaxRmsRatioAfterRefit * current.rms() || !stays_it) {
        steps_.emplace_back(stays_it
                                ? "  no better after refitting in free simulation: discarded"
                                : "  not plausible after refitting in free simulation: discarded");
        current_ = current, fitted_ = fitted, as_is_ = as_is, found_ = found;
        rejected_.insert(added);
        search_.follow(current_);
        continue;
      }
      if (last_ == "presliding" || last_ == "stribeck")
        friction_ = std::hypot(friction_, removed_rms(current, current_));
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
    search_.polish(current_);
    search_.follow(current_);
    as_is_ = current_;
    search_.judge_as_is(as_is_);
    search_.judge(current_);
    fitted_ = current_;
    // Coefficients estimated along a coarsely measured motion may not suit the simulation.
    if (as_is_.rms() < kMaxErrorRatioOfLargeGain * current_.rms()) {
      Hypothesis polished = current_;
      search_.judge_polished(polished);
      if (polished.rms() < current_.rms()) current_ = std::move(polished);
    }
    if (search_.fit(fitted_, {current_.point})) {
      search_.judge(fitted_);
    } else {
      fitted_ = current_;
    }
  }

  /// Removes the delay if a loop with free numerator fits as well without it: unmodelled friction
  /// can look like a delay.
  void delay() {
    const auto& effects = current_.structure.effects;
    if (std::find(effects.begin(), effects.end(), kind_of<TimeDelay>()) == effects.end()) return;
    const double delay_s = current_.model.command_delay_s();
    Hypothesis h;
    h.structure = current_.structure;
    h.structure.matched_feedforward = false;
    std::erase(h.structure.effects, kind_of<TimeDelay>());
    const bool tiny = delay_s < kMinDelaySamples * current_.model.sample_time_s,
               lag = lag_in_disguise(current_.model);
    // Starting from the present poles and, since the delay may have distorted them, from the grid.
    bool needed = true;
    for (const std::vector<Point>& from :
         {std::vector<Point>{point_of(current_.model, h.structure)}, std::vector<Point>{}}) {
      if (!search_.fit(h, from)) continue;
      search_.polish(h);
      search_.judge(h);
      needed = !tiny && !lag &&
               (current_.rms() < kMaxRmsRatioToAdd * h.rms() || delay_in_disguise(h.model.loop));
      if (!needed) break;
    }
    if (needed) return;
    steps_.push_back(text("delay of %.3g ms: not needed", 1e3 * delay_s));
    current_ = std::move(h);
    settle();
    undelayed_ = current_;
  }

  /// Adds a delay to a loop with a velocity error; the structures of the baseline do not combine
  /// the two. False where it does not improve the model enough.
  bool add_delay() {
    if (current_.has(kind_of<TimeDelay>()) || options_.identify.delay_max_s <= 0.0 ||
        is_left_out("time_delay"))
      return false;
    Hypothesis best;
    best.cost = 1e300;
    for (const double cycles : {2.0, 6.0}) {
      Hypothesis h;
      h.structure = current_.structure;
      h.structure.effects.push_back(kind_of<TimeDelay>());
      Point from = point_of(current_.model, h.structure);
      from.shapes.back() = std::min(cycles * current_.model.sample_time_s, 0.01);
      if (search_.fit(h, {from}) && h.cost < best.cost) best = std::move(h);
    }
    if (!(best.cost < 1e300)) return false;
    const double delay_s = best.model.command_delay_s();
    if (delay_s < kMinDelaySamples * best.model.sample_time_s ||
        delay_s > options_.identify.delay_max_s)
      return false;
    search_.judge(best);
    const bool small_gain = best.rms() >= kMaxErrorRatioOfLargeGain * fitted_.rms() &&
                            removed_rms(fitted_, best) < kLawMisfitShare * friction_;
    if (best.rms() >= kMaxRmsRatioToAdd * fitted_.rms() || small_gain ||
        paired_z(fitted_.pieces, best.pieces) < kMinBlockZ)
      return false;
    steps_.push_back(
        text("with a delay of %.3g ms: %s RMS", 1e3 * delay_s, size_of(best.rms()).c_str()));
    const Hypothesis current = current_, fitted = fitted_, as_is = as_is_;
    current_ = std::move(best);
    settle();
    if (current_.rms() < kMaxRmsRatioToAdd * current.rms()) return true;
    current_ = current, fitted_ = fitted, as_is_ = as_is;
    search_.follow(current_);
    return false;
  }

  /// Replaces a mode by a delay where that fits better: the poles and zeros of a mode can imitate a
  /// delay, which needs one parameter instead of four.
  bool delay_does_better(Hypothesis mode) {
    const Hypothesis current = current_, fitted = fitted_, as_is = as_is_;
    if (!add_delay()) return false;
    search_.polish(mode);
    search_.judge(mode);
    if (current_.rms() < kMaxRmsRatioDelayOverMode * mode.rms()) return true;
    current_ = current, fitted_ = fitted, as_is_ = as_is;
    search_.follow(current_);
    return false;
  }

  /// Tries a loop with an integrator where the model has none. An integrator is not a cause but
  /// part of the loop beside which causes are searched; a missing cause may have hidden it.
  void integrator() {
    if (current_.structure.order != 2) return;
    Hypothesis h;
    h.structure = current_.structure;
    h.structure.order = 3;
    std::erase(h.structure.effects, kind_of<ConstantForce>());
    // Without causes the poles are searched from the grid. With causes the search starts from the
    // present model, so that their shape parameters are kept.
    std::vector<Point> from;
    if (!found_.empty()) {
      const std::array<double, kMaxOrder>& a = current_.model.loop.denominator;
      for (const double share : {0.02, 0.1, 0.4}) {
        // (s^2 + a1 s + a2)(s + p)
        const double pole = share * a[1] / a[0];
        Point point = point_of(current_.model, h.structure);
        point.denominator = {a[0] + pole, a[1] + a[0] * pole, a[1] * pole};
        from.push_back(std::move(point));
      }
    }
    if (!search_.fit(h, from)) return;
    search_.judge(h);
    const bool better = h.rms() < kMaxRmsRatioToAdd * fitted_.rms() &&
                        paired_z(fitted_.pieces, h.pieces) > kMinBlockZ;
    steps_.push_back(
        text("integrator: %s, %s RMS", better ? "yes" : "no", size_of(h.rms()).c_str()));
    if (!better) return;
    const Hypothesis current = current_, fitted = fitted_, as_is = as_is_;
    const auto found = found_;
    current_ = std::move(h);
    // With an integrator in the loop a constant force is not observable.
    std::erase_if(found_, [&](const auto& one) { return !current_.has(one.second.kind); });
    settle();
    if (as_is_.rms() < kMaxRmsRatioToAdd * as_is.rms()) return;
    current_ = current, fitted_ = fitted, as_is_ = as_is, found_ = found;
    search_.follow(current_);
  }

  bool add_one() {
    if (!current_.has(kind_of<CuttingForce>())) search_.detect_cuts(current_.model);
    std::vector<std::string> known;
    for (const auto& [id, one] : found_) known.push_back(id);
    std::vector<std::size_t> kinds =
        candidates_of(current_.structure, known, options_.leave_out,
                      Channels(search_.recorded(), options_.encoder_in_loop));
    std::erase_if(kinds, [&](std::size_t kind) { return rejected_.count(kind) > 0; });
    std::vector<Screened> promising = search_.screen(current_, kinds);
    std::erase_if(promising,
                  [](const Screened& s) { return s.p > kMaxScreenP || s.gain < kMinScreenGain; });
    if (promising.size() > 2 * kMaxFitsPerRound) promising.resize(2 * kMaxFitsPerRound);
    std::string step = text("%s RMS, promising candidates:", size_of(current_.rms()).c_str());
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
      if (fits && h.cost < kMaxErrorRatioOfLargeGain * fitted_.cost)
        doubted.push_back({h, &as_is_, s});
      const bool is_beside =
          varies && (!fits || beside.rms() * fitted_.rms() < h.rms() * as_is_.rms());
      tried.push_back(
          {is_beside ? std::move(beside) : std::move(h), is_beside ? &as_is_ : &fitted_, s});
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
          judgement_of(*rival).earned && share_beaten(*chosen, *rival) < kMinShareToExcludeRival &&
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
    cause.beaten = 1.0 - judgement.p;
    for (const Tried& rival : tried) {
      // Two laws of the same cause are not rivals.
      if (cause_of(rival.screened.kind) == cause_of(screened.kind) ||
          rival.screened.p > kFalseAlarmRate)
        continue;
      const double beaten = share_beaten(*chosen, rival);
      cause.beaten = std::min(cause.beaten, beaten);
      if (beaten < kMinShareToExcludeRival &&
          1.0 - rival.left() > kMinGainShareOfRival * (1.0 - chosen->left()))
        cause.ambiguous_with.push_back(cause_of(rival.screened.kind));
    }
    cause.id = cause_of(screened.kind);
    found_[cause.id] = {cause, screened.kind};
    last_ = cause.id;
    current_ = Hypothesis(chosen->model);
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
      h.structure = beside.structure = extended_by(current_.structure, s.kind);
      const Point from = start_of(h.structure, s);
      fits =
          s.kind == kind_of<Presliding>() ? search_.fit_friction(h, from) : search_.fit(h, {from});
      if (fits) search_.judge(h);
      varies = search_.vary(beside, current_.model, s.kind, s.shapes);
    });
  }

  /// Refits the two best candidates in free simulation where they explain nearly the same, so that
  /// the better one is chosen by its best fit.
  void polish_rivals(std::vector<Tried>& tried) {
    if (tried.size() < 2 || 1.0 - tried[1].left() < kMinGainShareOfRival * (1.0 - tried[0].left()))
      return;
    for (std::size_t i = 0; i < 2; ++i) {
      check_stop();
      Tried best{tried[i].model, &fitted_, tried[i].screened};
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
        best.before = &current_;  // refitted in free simulation as well
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
    Point at = point_of(current_.model, structure);
    std::copy(s.shapes.begin(), s.shapes.end(),
              at.shapes.begin() + static_cast<std::ptrdiff_t>(shapes_before(structure, s.kind)));
    return at;
  }

  /// Replaces presliding and falling friction, two effects, by one law of friction where that
  /// predicts better.
  void one_law_of_friction() {
    if (last_ != "presliding" && last_ != "stribeck") return;
    if (is_left_out("presliding") || is_left_out("stribeck")) return;  // the law contains both
    const Found friction = found_.at(last_);
    const bool both = found_.count("presliding") > 0 && found_.count("stribeck") > 0;
    if (std::find(kLaws.begin(), kLaws.end(), friction.kind) != kLaws.end()) return;
    Hypothesis best = current_;
    std::size_t law = kEffectKinds;
    for (const std::size_t kind : {kind_of<LuGre>(), kind_of<PreslidingStribeck>()}) {
      check_stop();
      Hypothesis h;
      h.structure = current_.structure;
      auto& effects = h.structure.effects;
      std::erase(effects, kind_of<FallingFriction>());
      std::replace(effects.begin(), effects.end(), kind_of<Presliding>(), kind);
      std::replace(effects.begin(), effects.end(), kind_of<CoulombFriction>(), kind);
      if (std::find(effects.begin(), effects.end(), kind) == effects.end() ||
          !search_.fit_friction(h, point_of(current_.model, h.structure)))
        continue;
      search_.judge(h);
      steps_.push_back(
          text("  as %s: %s RMS", identity_of(kind).id.data(), size_of(h.rms()).c_str()));
      // Where only one of the two causes was found, the law implies more than is known: it must be
      // clearly better.
      if (!both && h.rms() > kMaxRmsRatioClearlyBetter * current_.rms()) continue;
      if (h.rms() < kMaxRmsRatioToAdd * best.rms()) best = std::move(h), law = kind;
    }
    if (law == kEffectKinds) return;
    current_ = std::move(best);
    settle();
    named_by(law, friction.cause);
  }

  /// Where the residual stays large with a law of friction, the law itself may be wrong: tries one
  /// whose virgin curve is free. True where that is clearly better and was accepted.
  bool free_law() {
    const auto friction = found_.find("presliding");
    if (friction == found_.end() ||
        !(current_.rms() > kMinRmsOverFloorForFreeLaw * search_.floor().rms))
      return false;
    if (is_left_out("stribeck")) return false;  // the law also falls with speed
    check_stop();
    Hypothesis h;
    h.structure = current_.structure;
    auto& effects = h.structure.effects;
    std::erase(effects, kind_of<FallingFriction>());
    std::replace_if(effects.begin(), effects.end(), is_friction_law, kind_of<Gms>());
    if (!search_.fit_friction(h, point_of(current_.model, h.structure))) return false;
    search_.judge(h);
    steps_.push_back(text("  as gms: %s RMS", size_of(h.rms()).c_str()));
    if (!(h.rms() < kMaxRmsRatioClearlyBetter * current_.rms())) return false;
    const Hypothesis current = current_, fitted = fitted_, as_is = as_is_;
    current_ = std::move(h);
    settle();
    if (!(current_.rms() < kMaxRmsRatioClearlyBetter * current.rms())) {
      current_ = current, fitted_ = fitted, as_is_ = as_is;
      search_.follow(current_);
      return false;
    }
    named_by(kind_of<Gms>(), friction->second.cause);
    rejected_.clear();
    return true;
  }

  /// The misfit of a wrong law of friction can look like backlash, a mode or dwell stiction:
  /// removes such a cause where another law of friction fits as well without it.
  void replace_misfit_by_law() {
    for (const auto& [id, one] : std::map<std::string, Found>(found_)) {
      if (id == "presliding" || id == "stribeck" || !like_friction(one.kind)) continue;
      Hypothesis best;
      double least = current_.rms() / kMaxRmsRatioToAdd;
      for (const std::size_t law :
           {kind_of<Presliding>(), kind_of<LuGre>(), kind_of<PreslidingStribeck>()}) {
        const bool falls = law != kind_of<Presliding>();
        if (is_left_out("presliding") || (falls && is_left_out("stribeck"))) continue;
        check_stop();
        Hypothesis h;
        h.structure = without(current_.structure, id, one.kind);
        auto& effects = h.structure.effects;
        std::erase(effects, kind_of<FallingFriction>());
        std::replace_if(effects.begin(), effects.end(), is_friction_law, law);
        if (std::find(effects.begin(), effects.end(), law) == effects.end() ||
            !search_.fit_friction(h, point_of(current_.model, h.structure)))
          continue;
        search_.judge(h);
        if (h.rms() < least) least = h.rms(), best = std::move(h);
      }
      if (best.structure.effects.empty()) continue;
      const Hypothesis current = current_, fitted = fitted_, as_is = as_is_;
      current_ = std::move(best);
      settle();
      if (current_.rms() > current.rms() / kMaxRmsRatioToAdd) {
        current_ = current, fitted_ = fitted, as_is_ = as_is;
        search_.follow(current_);
        continue;
      }
      const auto& effects = current_.structure.effects;
      const auto law = *std::find_if(effects.begin(), effects.end(), is_friction_law);
      steps_.push_back(text("  %s makes %s unnecessary: %s RMS", identity_of(law).id.data(),
                            id.c_str(), size_of(current_.rms()).c_str()));
      Cause cause = one.cause;
      cause.ambiguous_with.clear();
      found_.erase(id);
      named_by(law, cause);
    }
  }

  /// Names the causes contained in a law of friction: presliding always, stribeck if it was named
  /// before or if the friction of the law changes enough with speed.
  void named_by(std::size_t law, const Cause& evidence) {
    const double ratio = shape_of(current_.model, law, "breakaway_ratio");
    for (const char* id : {"presliding", "stribeck"}) {
      if (is_left_out(id)) continue;
      const bool falls = id == std::string("stribeck");
      if (falls && !std::isfinite(ratio)) {
        found_.erase(id);
        continue;
      }
      if (falls && found_.count(id) == 0 && std::abs(ratio - 1.0) <= kMinStribeckShare) continue;
      Found found{found_.count(id) > 0 ? found_.at(id).cause : evidence, law};
      found.cause.id = id;
      found_[id] = found;
    }
  }

  /// Removes a cause that a later one has made unnecessary.
  void remove_unnecessary() {
    if (found_.size() < 2) return;
    for (const auto& [id, one] : std::map<std::string, Found>(found_)) {
      if (id == last_) continue;
      if (!current_.has(one.kind)) {  // another effect has replaced it
        steps_.push_back(text("  %s: no longer needed, removed", id.c_str()));
        found_.erase(id);
        continue;
      }
      Hypothesis less;
      less.structure = without(current_.structure, id, one.kind);
      if (!search_.fit(less, {point_of(current_.model, less.structure)})) continue;
      search_.judge(less);
      if (std::min(fitted_.rms(), current_.rms()) < kMaxRmsRatioToAdd * less.rms()) continue;
      steps_.push_back(text("  %s: no longer needed, removed", id.c_str()));
      current_ = std::move(less);
      found_.erase(id);
      // A law that contained both causes has become the effect of the one that stays.
      for (auto& [other, kept] : found_) {
        if (current_.has(kept.kind)) continue;
        kept.kind = other == "stribeck" ? kind_of<FallingFriction>() : kind_of<Presliding>();
      }
      settle();
      return;
    }
  }

  Search& search_;
  Hypothesis current_;  // the present model, refitted in free simulation
  Hypothesis fitted_;   // the same structure fitted by projection, to compare candidates with
  Hypothesis as_is_;    // current_ with its error on all blocks, its coefficients fixed
  const DiagnoseOptions& options_;
  Model settled_;
  std::optional<Hypothesis> undelayed_;
  std::set<std::size_t> rejected_;
  double baseline_ = 0.0;  // RMS before any cause [m | rad]
  double friction_ = 0.0;  // RMS that laws of friction have removed
  std::map<std::string, Found> found_;
  std::string last_;  // the cause added last
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
