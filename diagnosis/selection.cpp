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

namespace servotwin {

namespace {

constexpr double kHolds = 0.99;       // of what a polish does without a cause
constexpr double kFar = 2.0;          // times the noise floor
constexpr double kClearly = 0.8;      // of the error: a law that says more than is known
constexpr double kLeastDelay = 0.25;  // of the sampling time: less is how it was recorded
constexpr int kMostCauses = 6;
constexpr std::size_t kTried = 3;      // candidates of a round that are fitted
constexpr double kPromising = 0.05;    // p of a candidate that is worth fitting
constexpr double kLeastGain = 0.004;   // of squared error, likewise
constexpr double kDecisive = 0.95;     // share of resamples in which a rival is beaten
constexpr double kAsGood = 0.9;        // share of the gain that makes the simpler one do
constexpr double kDoesBetter = 0.9;    // of the error with a mode, a delay in its place
constexpr double kNearlyAsGood = 0.8;  // share of the gain that makes a rival
constexpr double kFalls = 0.12;  // share of the level by which friction falls or rises with speed

/// The causes one by one, while they earn their place.
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
    add_while_they_earn_it();
    if (any_law()) add_while_they_earn_it();
    law_in_its_place();
  }
  [[nodiscard]] const Hypothesis& current() const { return current_; }
  [[nodiscard]] const Model& settled() const { return settled_; }
  [[nodiscard]] const std::optional<Hypothesis>& undelayed() const { return undelayed_; }
  [[nodiscard]] const std::map<std::string, Found>& found() const { return found_; }
  [[nodiscard]] const std::vector<std::string>& steps() const { return steps_; }

 private:
  void add_while_they_earn_it() {
    while (static_cast<int>(found_.size()) < kMostCauses) {
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
      // What better values of the parameters would have done as well is no cause.
      const bool stays_it = !current_.has(added) || !search_.is_plausible(current.model) ||
                            search_.is_plausible(current_.model);
      if (current_.rms() >= kHolds * current.rms() || !stays_it) {
        steps_.emplace_back(stays_it ? "  no better after the polish: taken back"
                                     : "  after the polish it is no such thing: taken back");
        current_ = current, fitted_ = fitted, as_is_ = as_is, found_ = found;
        rejected_.insert(added);
        search_.follow(current_);
        continue;
      }
      if (last_ == "presliding" || last_ == "stribeck")
        friction_ = std::hypot(friction_, taken(current, current_));
      take_out_the_needless();
    }
  }

  [[nodiscard]] bool is_left_out(std::string_view cause) const {
    const auto& all = options_.leave_out;
    return std::find(all.begin(), all.end(), cause) != all.end();
  }

  void go_on() const {
    if (options_.stop.stop_requested()) throw std::runtime_error("stopped before it was finished");
  }

  /// The best that this structure can do, before it is asked what it lacks.
  void settle() {
    go_on();
    search_.polish(current_);
    search_.follow(current_);
    as_is_ = current_;
    search_.judge_as_is(as_is_);
    search_.judge(current_);
    fitted_ = current_;
    // The coefficients that a coarse motion says are not those of the simulation.
    if (as_is_.rms() < kMuch * current_.rms()) {
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

  /// A delay that a free loop does without is none: an unmodelled friction looks like one.
  void delay() {
    const auto& effects = current_.structure.effects;
    if (std::find(effects.begin(), effects.end(), kind_of<TimeDelay>()) == effects.end()) return;
    const double delay_s = current_.model.command_delay_s();
    Hypothesis h;
    h.structure = current_.structure;
    h.structure.matched_feedforward = false;
    std::erase(h.structure.effects, kind_of<TimeDelay>());
    const bool tiny = delay_s < kLeastDelay * current_.model.sample_time_s,
               lag = lag_in_disguise(current_.model);
    // From here, or, since the delay may have bent the poles, from anywhere.
    bool needed = true;
    for (const std::vector<Point>& from :
         {std::vector<Point>{point_of(current_.model, h.structure)}, std::vector<Point>{}}) {
      if (!search_.fit(h, from)) continue;
      search_.polish(h);
      search_.judge(h);
      needed =
          !tiny && !lag && (current_.rms() < kWorthIt * h.rms() || delay_in_disguise(h.model.loop));
      if (!needed) break;
    }
    if (needed) return;
    steps_.push_back(text("delay of %.3g ms: not needed", 1e3 * delay_s));
    current_ = std::move(h);
    settle();
    undelayed_ = current_;
  }

  /// A delay beside a velocity error, which the baseline's structures do not have.
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
    if (delay_s < kLeastDelay * best.model.sample_time_s || delay_s > options_.identify.delay_max_s)
      return false;
    search_.judge(best);
    const bool little =
        best.rms() >= kMuch * fitted_.rms() && taken(fitted_, best) < kLawLeaves * friction_;
    if (best.rms() >= kWorthIt * fitted_.rms() || little ||
        paired_z(fitted_.pieces, best.pieces) < kAgrees)
      return false;
    steps_.push_back(text("with a delay of %.3g ms %.4g um", 1e3 * delay_s, 1e6 * best.rms()));
    const Hypothesis current = current_, fitted = fitted_, as_is = as_is_;
    current_ = std::move(best);
    settle();
    if (current_.rms() < kWorthIt * current.rms()) return true;
    current_ = current, fitted_ = fitted, as_is_ = as_is;
    search_.follow(current_);
    return false;
  }

  /// The poles and zeros of a mode imitate a delay, which needs one parameter in place of four.
  bool delay_does_better(Hypothesis mode) {
    const Hypothesis current = current_, fitted = fitted_, as_is = as_is_;
    if (!add_delay()) return false;
    search_.polish(mode);
    search_.judge(mode);
    if (current_.rms() < kDoesBetter * mode.rms()) return true;
    current_ = current, fitted_ = fitted, as_is_ = as_is;
    search_.follow(current_);
    return false;
  }

  /// A loop with an integrator where there is none yet: no cause, but what causes are sought
  /// beside. A cause that is not yet in the model may have hidden it.
  void integrator() {
    if (current_.structure.order != 2) return;
    Hypothesis h;
    h.structure = current_.structure;
    h.structure.order = 3;
    std::erase(h.structure.effects, kind_of<ConstantForce>());
    // From anywhere while there are no shapes that would be lost on the way, and from here.
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
    const bool better =
        h.rms() < kWorthIt * fitted_.rms() && paired_z(fitted_.pieces, h.pieces) > kAgrees;
    steps_.push_back(text("integrator: %s, %.4g um", better ? "yes" : "no", 1e6 * h.rms()));
    if (!better) return;
    const Hypothesis current = current_, fitted = fitted_, as_is = as_is_;
    const auto found = found_;
    current_ = std::move(h);
    // Behind an integrator a constant force is not seen.
    std::erase_if(found_, [&](const auto& one) { return !current_.has(one.second.kind); });
    settle();
    if (as_is_.rms() < kWorthIt * as_is.rms()) return;
    current_ = current, fitted_ = fitted, as_is_ = as_is, found_ = found;
    search_.follow(current_);
  }

  bool add_one() {
    if (!current_.has(kind_of<CuttingForce>())) search_.listen(current_.model);
    std::vector<std::string> known;
    for (const auto& [id, one] : found_) known.push_back(id);
    std::vector<std::size_t> kinds =
        candidates_of(current_.structure, known, options_.leave_out,
                      Channels(search_.recorded(), options_.encoder_in_loop));
    std::erase_if(kinds, [&](std::size_t kind) { return rejected_.count(kind) > 0; });
    std::vector<Screened> promising = search_.screen(current_, kinds);
    std::erase_if(promising,
                  [](const Screened& s) { return s.p > kPromising || s.gain < kLeastGain; });
    if (promising.size() > 2 * kTried) promising.resize(2 * kTried);
    std::string step = text("%.4g um, promising:", 1e6 * current_.rms());
    for (const Screened& s : promising)
      step += text(" %s (%.1f %%, p %.1g)", identity_of(s.kind).id.data(), 100.0 * s.gain, s.p);
    steps_.push_back(promising.empty() ? step + " nothing" : step);
    std::vector<Tried> tried, doubted;
    for (const Screened& s : promising) {
      if (tried.size() == kTried) break;
      // With the loop, which may have taken up a part of it; or beside the loop as it is, where the
      // measured motion says less than the simulated one.
      go_on();
      Hypothesis h, beside;
      h.structure = beside.structure = extended_by(current_.structure, s.kind);
      const Point from = start_of(h.structure, s);
      const bool fits =
          s.kind == kind_of<Presliding>() ? search_.fit_friction(h, from) : search_.fit(h, {from});
      if (fits) search_.judge(h);
      const bool varies = search_.vary(beside, current_.model, s.kind, s.shapes);
      if (!fits && !varies) continue;
      // Fitted it explains much, and blocks that it is not fitted to disagree.
      if (fits && h.cost < kMuch * fitted_.cost) doubted.push_back({h, &as_is_, s});
      const bool is_beside =
          varies && (!fits || beside.rms() * fitted_.rms() < h.rms() * as_is_.rms());
      tried.push_back(
          {is_beside ? std::move(beside) : std::move(h), is_beside ? &as_is_ : &fitted_, s});
      steps_.push_back(text("  with %s %.4g um%s, z %.1f", identity_of(s.kind).id.data(),
                            1e6 * tried.back().model.rms(), is_beside ? " beside the loop" : "",
                            paired_z(tried.back().before->pieces, tried.back().model.pieces)));
      // One that explains nothing takes no other one's place.
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
        go_on();
        search_.polish(one.model);
        search_.judge_as_is(one.model);
        if (one.left() > kMuch) continue;
        search_.judge_polished(one.model);
        steps_.push_back(text("  with %s, polished %.4g um, z %.1f",
                              identity_of(one.screened.kind).id.data(), 1e6 * one.model.rms(),
                              paired_z(one.before->pieces, one.model.pieces)));
        tried.push_back(std::move(one));
      }
      std::sort(tried.begin(), tried.end(),
                [](const Tried& l, const Tried& r) { return l.left() < r.left(); });
      chosen = std::find_if(tried.begin(), tried.end(),
                            [&](const Tried& one) { return judgement_of(one).earned; });
    }
    if (chosen == tried.end()) {
      if (!tried.empty()) steps_.emplace_back("  none earns its place");
      return false;
    }
    // Of two that the pieces cannot tell apart, the one that needs less.
    for (auto rival = chosen + 1; rival != tried.end(); ++rival) {
      if (parameters_of(rival->screened.kind) < parameters_of(chosen->screened.kind) &&
          judgement_of(*rival).earned && share_beaten(*chosen, *rival) < kDecisive &&
          1.0 - rival->left() > kAsGood * (1.0 - chosen->left()))
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
      // Two laws of one cause are no rivals.
      if (cause_of(rival.screened.kind) == cause_of(screened.kind) || rival.screened.p > kChance)
        continue;
      const double beaten = share_beaten(*chosen, rival);
      cause.beaten = std::min(cause.beaten, beaten);
      if (beaten < kDecisive && 1.0 - rival.left() > kNearlyAsGood * (1.0 - chosen->left()))
        cause.ambiguous_with.push_back(cause_of(rival.screened.kind));
    }
    cause.id = cause_of(screened.kind);
    found_[cause.id] = {cause, screened.kind};
    last_ = cause.id;
    current_ = Hypothesis(chosen->model);
    return true;
  }

  /// Of two that explain nearly the same the better one is the one that does at its best.
  void polish_rivals(std::vector<Tried>& tried) {
    if (tried.size() < 2 || 1.0 - tried[1].left() < kNearlyAsGood * (1.0 - tried[0].left())) return;
    for (std::size_t i = 0; i < 2; ++i) {
      go_on();
      Tried best{tried[i].model, &fitted_, tried[i].screened};
      if (const auto moment = moment_of(tried[1 - i].model, tried[1 - i].screened.kind);
          moment && moment_of(best.model, best.screened.kind)) {
        // Between two rests any moment is as good: it is sought where the rival found it, too.
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
      // The coefficients that a measured motion says are not those of the simulation.
      if (as_is.rms() < kClearly * best.model.rms()) {
        search_.judge_polished(best.model);
        best.before = &current_;  // as polished as it is
      }
      steps_.push_back(text("  polished, with %s %.4g um",
                            identity_of(best.screened.kind).id.data(), 1e6 * best.model.rms()));
      if (best.left() < tried[i].left() && search_.is_plausible(best.model.model))
        tried[i] = std::move(best);
    }
    std::sort(tried.begin(), tried.end(),
              [](const Tried& l, const Tried& r) { return l.left() < r.left(); });
  }

  /// When an effect sets in; nothing where it does not.
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

  /// What presliding and falling friction say as two is said by one law, where that predicts
  /// better.
  void one_law_of_friction() {
    if (last_ != "presliding" && last_ != "stribeck") return;
    if (is_left_out("presliding") || is_left_out("stribeck")) return;  // it says both
    const Found friction = found_.at(last_);
    const bool both = found_.count("presliding") > 0 && found_.count("stribeck") > 0;
    if (std::find(kLaws.begin(), kLaws.end(), friction.kind) != kLaws.end()) return;
    Hypothesis best = current_;
    std::size_t law = kEffectKinds;
    for (const std::size_t kind : {kind_of<LuGre>(), kind_of<PreslidingStribeck>()}) {
      go_on();
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
      steps_.push_back(text("  as %s %.4g um", identity_of(kind).id.data(), 1e6 * h.rms()));
      // To say more than is known it must be clearly the better law.
      if (!both && h.rms() > kClearly * current_.rms()) continue;
      if (h.rms() < kWorthIt * best.rms()) best = std::move(h), law = kind;
    }
    if (law == kEffectKinds) return;
    current_ = std::move(best);
    settle();
    named_by(law, friction.cause);
  }

  /// Where a law of friction leaves much it is the law that is wrong: one whose virgin curve can be
  /// any. True where it is clearly the better one.
  bool any_law() {
    const auto friction = found_.find("presliding");
    if (friction == found_.end() || !(current_.rms() > kFar * search_.floor().rms)) return false;
    if (is_left_out("stribeck")) return false;  // it falls with speed as well
    go_on();
    Hypothesis h;
    h.structure = current_.structure;
    auto& effects = h.structure.effects;
    std::erase(effects, kind_of<FallingFriction>());
    std::replace_if(effects.begin(), effects.end(), is_friction_law, kind_of<Gms>());
    if (!search_.fit_friction(h, point_of(current_.model, h.structure))) return false;
    search_.judge(h);
    steps_.push_back(text("  as gms %.4g um", 1e6 * h.rms()));
    if (!(h.rms() < kClearly * current_.rms())) return false;
    const Hypothesis current = current_, fitted = fitted_, as_is = as_is_;
    current_ = std::move(h);
    settle();
    if (!(current_.rms() < kClearly * current.rms())) {
      current_ = current, fitted_ = fitted, as_is_ = as_is;
      search_.follow(current_);
      return false;
    }
    named_by(kind_of<Gms>(), friction->second.cause);
    rejected_.clear();
    return true;
  }

  /// What one law of friction leaves of another looks like play, a mode or rest: where a law does
  /// without it, it goes.
  void law_in_its_place() {
    for (const auto& [id, one] : std::map<std::string, Found>(found_)) {
      if (id == "presliding" || id == "stribeck" || !like_friction(one.kind)) continue;
      Hypothesis best;
      double least = current_.rms() / kWorthIt;
      for (const std::size_t law :
           {kind_of<Presliding>(), kind_of<LuGre>(), kind_of<PreslidingStribeck>()}) {
        const bool falls = law != kind_of<Presliding>();
        if (is_left_out("presliding") || (falls && is_left_out("stribeck"))) continue;
        go_on();
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
      if (current_.rms() > current.rms() / kWorthIt) {
        current_ = current, fitted_ = fitted, as_is_ = as_is;
        search_.follow(current_);
        continue;
      }
      const auto& effects = current_.structure.effects;
      const auto law = *std::find_if(effects.begin(), effects.end(), is_friction_law);
      steps_.push_back(text("  %s does without %s: %.4g um", identity_of(law).id.data(), id.c_str(),
                            1e6 * current_.rms()));
      Cause cause = one.cause;
      cause.ambiguous_with.clear();
      found_.erase(id);
      named_by(law, cause);
    }
  }

  /// Both are in a law that says so: each is named if it was before, or if the law says so.
  void named_by(std::size_t law, const Cause& evidence) {
    const double ratio = shape_of(current_.model, law, "breakaway_ratio");
    for (const char* id : {"presliding", "stribeck"}) {
      if (is_left_out(id)) continue;
      const bool falls = id == std::string("stribeck");
      if (falls && !std::isfinite(ratio)) {
        found_.erase(id);
        continue;
      }
      if (falls && found_.count(id) == 0 && std::abs(ratio - 1.0) <= kFalls) continue;
      Found found{found_.count(id) > 0 ? found_.at(id).cause : evidence, law};
      found.cause.id = id;
      found_[id] = found;
    }
  }

  /// An effect that another one has made needless goes.
  void take_out_the_needless() {
    if (found_.size() < 2) return;
    for (const auto& [id, one] : std::map<std::string, Found>(found_)) {
      if (id == last_) continue;
      if (!current_.has(one.kind)) {  // another one has taken its place
        steps_.push_back(text("  %s: needless", id.c_str()));
        found_.erase(id);
        continue;
      }
      Hypothesis less;
      less.structure = without(current_.structure, id, one.kind);
      if (!search_.fit(less, {point_of(current_.model, less.structure)})) continue;
      search_.judge(less);
      if (std::min(fitted_.rms(), current_.rms()) < kWorthIt * less.rms()) continue;
      steps_.push_back(text("  %s: needless", id.c_str()));
      current_ = std::move(less);
      found_.erase(id);
      // A law that said two causes in one has become the effect of the one that stays.
      for (auto& [other, kept] : found_) {
        if (current_.has(kept.kind)) continue;
        kept.kind = other == "stribeck" ? kind_of<FallingFriction>() : kind_of<Presliding>();
      }
      settle();
      return;
    }
  }

  Search& search_;
  Hypothesis current_;  // polished
  Hypothesis fitted_;   // the same by projection, with which candidates are fitted
  Hypothesis as_is_;    // as polished, with its error on all blocks
  const DiagnoseOptions& options_;
  Model settled_;
  std::optional<Hypothesis> undelayed_;
  std::set<std::size_t> rejected_;
  double baseline_ = 0.0;  // RMS
  double friction_ = 0.0;  // RMS that laws of friction have taken away
  std::map<std::string, Found> found_;
  std::string last_;  // that was added
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
