#include "diagnosis/torque/torque_selection.h"

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "diagnosis/search/extension.h"
#include "diagnosis/search/search.h"
#include "diagnosis/statistics/bootstrap.h"
#include "diagnosis/statistics/chance.h"
#include "diagnosis/statistics/pieces.h"
#include "diagnosis/statistics/text.h"
#include "diagnosis/statistics/thresholds.h"
#include "identification/least_squares/interruption.h"
#include "identification/least_squares/parallel.h"
#include "twin/linear_algebra.h"

namespace servotwin {

namespace {

// Least RMS that a cause must remove, as a share of the RMS of the baseline, ..
constexpr double kMinRemovedShareOfBaseline = 0.05;
// .. and of Coulomb friction: no law of friction is more accurate than that.
constexpr double kMinRemovedShareOfFriction = 0.01;
constexpr double kFalseAlarmRateOfLine = 0.05;  // of a further period of a cause named already
// z of the paired test above which it does not contradict the Wald test.
constexpr double kMinBlockZBesideWald = 2.0;
// Share of the squared velocity that is not explained by the frequency of a disturbance: below it
// the frequency is that of the motion itself.
constexpr double kMinVelocityShareLeft = 0.8;
// Share of Coulomb friction by which friction must vary with position; every guideway varies less.
constexpr double kMinUnevenness = 0.1;
// Of the friction, by which it must change at a moment to be named: temperature alone changes it by
// as much within minutes.
constexpr double kMinChangeOfFriction = 0.05;
// Of the friction, by which it must differ from the mean of both directions: less is nothing that
// anybody could mend.
constexpr double kMinDifference = 0.01, kMinViscousDifference = 0.05;
constexpr int kMaxHarmonic = 8;
constexpr std::size_t kMaxCoggingLines = 6,
                      kLinesTried = 4;  // of cogging: periods in all, per round

class TorqueSelection {
 public:
  TorqueSelection(const TorqueRows& rows, const TorqueBody& body, const DiagnoseOptions& options,
                  bool rests, bool rotary)
      : rows_(rows), body_(body), options_(options), rests_(rests), rotary_(rotary) {}

  TorqueSelected run() {
    baseline_ = rms_of(training_of(rows_).predicted(rows_.training(body_.columns)));
    out_.steps.push_back(text("rigid body: %.4g RMS", baseline_));
    play();
    while (static_cast<int>(out_.parts.size()) < kMaxCauses && add_one()) remove_unnecessary();
    return std::move(out_);
  }

 private:
  [[nodiscard]] bool named(std::string_view id) const {
    return std::any_of(out_.parts.begin(), out_.parts.end(),
                       [&](const TorquePart& part) { return part.id == id; });
  }
  [[nodiscard]] Eigen::MatrixXd all(std::size_t but = kNoEffect) const {
    return columns_of(rows_, body_, out_.parts, but);
  }

  struct Judgement {
    double z = 0.0, p = 1.0, rms = 0.0;
    std::vector<double> pieces;
    bool earned = false;
  };
  [[nodiscard]] Judgement judged(const Eigen::MatrixXd& base, const Eigen::MatrixXd& added,
                                 std::size_t candidates, std::size_t points,
                                 double chance = kFalseAlarmRate) const {
    const BlockedRegression data = training_of(rows_);
    const Eigen::MatrixXd before = rows_.training(base), more = rows_.training(added);
    const std::vector<double> pieces = data.predicted(before);
    Judgement out;
    out.pieces = data.predicted(before, more);
    out.z = paired_z(pieces, out.pieces);
    out.p = chance_beyond(out.z);
    if (out.z > kMinBlockZBesideWald) {
      out.p = std::min(out.p, std::min(1.0, static_cast<double>(points) *
                                                chance_beyond(data.wald(before, more))));
    }
    out.rms = rms_of(out.pieces);
    const double rms = rms_of(pieces);
    const double removed = removed_rms(pieces, out.pieces);
    out.earned = out.rms < kMaxRmsRatioToAdd * rms &&
                 removed > kMinRemovedShareOfBaseline * baseline_ &&
                 removed > kMinRemovedShareOfFriction * body_.coulomb &&
                 out.p < chance / static_cast<double>(candidates);
    return out;
  }

  /// Backlash first, since all effects with memory look different in its presence.
  void play() {
    if (options_.leaves_out("backlash")) return;
    out_.plateau = plateau_of(rows_.stretches(body_.mass));
    const Plateau& plateau = out_.plateau;
    if (plateau.reversals.size() < 2) return;
    out_.steps.push_back(text("force plateau after %zu reversals: width %.4g +- %.2g, z %.1f%s",
                              plateau.reversals.size(), plateau.width, plateau.deviation,
                              plateau.statistic, plateau.found() ? "" : ": no backlash"));
    if (!plateau.found()) return;
    // The same spring without a gap is elastic friction and no backlash.
    const BlockedRegression data = training_of(rows_);
    const BlockedRegression::Beside beside(data, rows_.training(body_.columns));
    TorqueTerm elastic, gap;
    double best_elastic = -1.0, best_gap = -1.0;
    std::size_t points = 0;
    for (double give = 0.05 * plateau.width; give < 20.0 * plateau.width; give *= 1.25) {
      for (const double share : {0.0, 0.7, 0.85, 1.0, 1.2, 1.4}) {
        for (const double start : {-1.0, 0.0, 1.0}) {
          const TorqueTerm term = TorqueTerm::gap(share * plateau.width, give, start);
          const double explained = beside.explained(rows_.training(rows_.columns(term)));
          double& best = share == 0.0 ? best_elastic : best_gap;
          if (explained > best) best = explained, (share == 0.0 ? elastic : gap) = term;
          ++points;
        }
      }
    }
    Eigen::MatrixXd without = body_.columns;
    append(without, rows_.columns(elastic));
    const Judgement judgement = judged(without, rows_.columns(gap), 1, points);
    out_.steps.push_back(text("  with a gap: %.4g RMS, z %.1f", judgement.rms, judgement.z));
    if (!judgement.earned) return;
    TorquePart part;
    part.id = "backlash";
    part.terms = {elastic, gap};
    part.evidence = {
        {"force plateau over the travel after reversals", plateau.statistic,
         chance_beyond(plateau.statistic)},
        {"torque residual, blocked cross-validation against the same spring without a gap",
         judgement.z, judgement.p}};
    part.confidence = 1.0 - std::max(judgement.p, chance_beyond(plateau.statistic));
    out_.parts.push_back(std::move(part));
  }

  [[nodiscard]] std::vector<std::size_t> candidates() const {
    static constexpr std::array kActOnTheBody{
        kind_of<ConstantForce>(),   kind_of<AsymmetricFriction>(),
        kind_of<FallingFriction>(), kind_of<Presliding>(),
        kind_of<Cogging>(),         kind_of<PositionDependentFriction>(),
        kind_of<AddedFriction>(),   kind_of<InertiaChange>(),
        kind_of<ViscousDrift>(),    kind_of<PeriodicDisturbance>(),
        kind_of<DwellStiction>()};
    std::vector<std::size_t> out;
    for (const std::size_t kind : kActOnTheBody) {
      const std::string_view id = identity_of(kind).cause;
      if (options_.leaves_out(id) || named(id)) continue;
      const bool unlike = kind == kind_of<ConstantForce>() || kind == kind_of<AsymmetricFriction>();
      // With motion in one direction only, a constant force looks like Coulomb friction; at
      // constant speed, position and time are not distinguishable.
      if (unlike && (!body_.both_ways || named("gravity_offset") || named("asymmetric_friction")))
        continue;
      const bool by_speed = kind == kind_of<FallingFriction>() || kind == kind_of<ViscousDrift>() ||
                            kind == kind_of<PeriodicDisturbance>();
      if (body_.one_speed && by_speed) continue;
      const bool by_reversals =
          kind == kind_of<PositionDependentFriction>() || kind == kind_of<Presliding>();
      if (by_reversals && !body_.both_ways) continue;
      if (kind == kind_of<DwellStiction>() && !rests_) continue;
      out.push_back(kind);
    }
    return out;
  }

  /// The best shape parameters of a kind, refined from its grid; explained = 0 where nothing fits.
  struct Looked {
    std::size_t kind = 0, points = 0;
    double explained = 0.0;
    TorqueTerm term;
  };
  [[nodiscard]] Looked looked(std::size_t kind, const BlockedRegression::Beside& beside) const {
    Looked out{kind, 0, 0.0, {}};
    const auto try_out = [&](const std::vector<double>& shapes) {
      throw_if_interrupted();
      // For presliding without the viscous column, which the body already has.
      const TorqueTerm term{kind, shapes, kind == kind_of<Presliding>() ? 1 : 0};
      const double explained = beside.explained(rows_.training(rows_.columns(term)));
      ++out.points;
      if (explained > out.explained) out.explained = explained, out.term = term;
    };
    const std::vector<std::vector<double>> grid = rows_.grid(kind, body_.velocity_limit);
    if (kind == kind_of<Cogging>() || kind == kind_of<PeriodicDisturbance>()) {
      // Ripples are first ranked without filters; the best ones are then tried with them.
      std::vector<std::pair<double, std::vector<double>>> rough;
      for (const std::vector<double>& shapes : grid) {
        throw_if_interrupted();
        rough.emplace_back(-beside.explained(rows_.training(rows_.rough_waves(kind, shapes[0]))),
                           shapes);
      }
      out.points = grid.size();
      std::sort(rough.begin(), rough.end());
      for (std::size_t i = 0; i < std::min<std::size_t>(6, rough.size()); ++i)
        try_out(rough[i].second);
    } else {
      for (const std::vector<double>& shapes : grid) try_out(shapes);
    }
    if (out.explained <= 0.0 || shapes_of(kind).empty()) return out;
    const bool whole_orders = rotary_ && kind == kind_of<Cogging>();
    if (!whole_orders) refine(out, try_out);
    if (at_edge(out.term, grid)) out.explained = 0.0;
    while (kind == kind_of<Cogging>()) {
      std::vector<double> half = out.term.shapes;
      half[0] *= 0.5;
      if (half[0] < shapes_of(kind)[0].lower) break;
      const TorqueTerm term{kind, half, 0};
      const double explained = beside.explained(rows_.training(rows_.columns(term)));
      if (explained < kMinShareOfHalfPeriod * out.explained) break;
      out.explained = explained, out.term = term;
      if (!whole_orders) refine(out, try_out);
    }
    return out;
  }
  /// Whether the best moment is the first or the last one that was tried: a beginning that differs
  /// (a start from rest, another path), or an end. A change has its best moment in between.
  [[nodiscard]] static bool at_edge(const TorqueTerm& term,
                                    const std::vector<std::vector<double>>& grid) {
    if (shapes_of(term.kind)[0].scan != Scan::kTime || grid.size() < 2) return false;
    const double step = grid[1][0] - grid[0][0];
    return term.shapes[0] < grid.front()[0] + 0.5 * step ||
           term.shapes[0] > grid.back()[0] - 0.5 * step;
  }
  template <class TryOut>
  void refine(const Looked& best, const TryOut& try_out) const {
    const Parameter& p = shapes_of(best.kind)[0];
    // Relative step: for a period a fraction of one period over the travel, else a fixed one.
    double step = 0.3;
    if (p.scan == Scan::kPeriod) step = std::min(0.2, 0.25 * best.term.shapes[0] / rows_.travel());
    if (p.scan == Scan::kFrequency) step = 0.01;
    // A moment is moved by parts of the training data, whatever its stamp, and stays within the
    // grid: there must be motion before and after it.
    double lower = p.lower, upper = p.upper;
    if (p.scan == Scan::kTime) {
      const std::vector<std::vector<double>> grid = rows_.grid(best.kind, body_.velocity_limit);
      lower = grid.front()[0], upper = grid.back()[0];
      step = 0.01 * (upper - lower);
    }
    for (int round = 0; round < 4; ++round, step *= 0.35) {
      const std::vector<double> centre = best.term.shapes;
      for (const int i : {-2, -1, 1, 2}) {
        std::vector<double> shapes = centre;
        shapes[0] = p.scan == Scan::kTime ? centre[0] + step * i : centre[0] * std::exp(step * i);
        if (shapes[0] > lower && shapes[0] < upper) try_out(shapes);
      }
    }
  }

  bool add_one() {
    const std::vector<std::size_t> kinds = candidates();
    if (kinds.empty()) return false;
    const BlockedRegression data = training_of(rows_);
    const Eigen::MatrixXd base = all();
    const BlockedRegression::Beside beside(data, rows_.training(base));
    const double rms = rms_of(data.predicted(rows_.training(base)));
    std::vector<std::pair<Judgement, Looked>> tried;
    std::vector<Looked> all_looked(kinds.size());
    in_parallel(kinds.size(), [&](std::size_t i) { all_looked[i] = looked(kinds[i], beside); });
    for (std::size_t i = 0; i < kinds.size(); ++i) {
      const std::size_t kind = kinds[i];
      const Looked& best = all_looked[i];
      if (best.explained <= 0.0) continue;
      const Judgement judgement = judged(base, rows_.columns(best.term), kinds.size(), best.points);
      out_.steps.push_back(text("  %.4g RMS, with %s: %.4g RMS, z %.1f, p %.1g%s", rms,
                                std::string(identity_of(kind).id).c_str(), judgement.rms,
                                judgement.z, judgement.p, judgement.earned ? "" : ": not added"));
      if (judgement.earned && possible(best.term, base)) tried.emplace_back(judgement, best);
    }
    // A rival of the previous cause that still improves the model beside it is not a rival but a
    // cause of its own.
    if (!out_.parts.empty()) {
      std::erase_if(out_.parts.back().rivals, [&](const auto& rival) {
        return std::any_of(tried.begin(), tried.end(), [&](const auto& one) {
          return identity_of(one.second.kind).cause == rival.first;
        });
      });
    }
    if (tried.empty()) return false;
    std::sort(tried.begin(), tried.end(),
              [](const auto& l, const auto& r) { return l.first.rms < r.first.rms; });
    auto chosen = tried.begin();
    // Of two candidates that the blocks do not distinguish, prefer the one with fewer parameters.
    for (auto rival = chosen + 1; rival != tried.end(); ++rival) {
      if (parameters_of(rival->second.kind) < parameters_of(chosen->second.kind) &&
          rms - rival->first.rms > kMinGainShareOfSimpler * (rms - chosen->first.rms) &&
          share_won(chosen->first, rival->first) < kMinShareToExcludeRival)
        chosen = rival;
    }
    const auto& [judgement, best] = *chosen;
    TorquePart part;
    part.id = identity_of(best.kind).cause;
    part.terms = {best.term};
    part.evidence = {{"torque residual, blocked cross-validation, paired over 0.25 s", judgement.z,
                      judgement.p}};
    part.confidence = 1.0 - judgement.p;
    for (const auto& [rival, of_rival] : tried) {
      if (of_rival.kind != best.kind &&
          rms - rival.rms > kMinGainShareOfRival * (rms - judgement.rms))
        part.rivals.emplace_back(identity_of(of_rival.kind).cause, share_won(judgement, rival));
    }
    if (best.kind == kind_of<Cogging>() && body_.one_speed) {
      // At constant speed the two are not distinguishable.
      part.ambiguous_with.emplace_back("periodic_disturbance");
      part.confidence = std::min(part.confidence, 0.5);
    }
    out_.steps.push_back(part.id + ": added");
    out_.parts.push_back(std::move(part));
    if (best.kind == kind_of<Cogging>()) lines();
    return true;
  }

  /// Share of bootstrap resamples in which `best` has the smaller error.
  static double share_won(const Judgement& best, const Judgement& rival) {
    const auto differences =
        bootstrap(best.pieces.size(), [&](const std::vector<std::size_t>& places) {
          double sum = 0.0;
          for (const std::size_t i : places) sum += rival.pieces[i] - best.pieces[i];
          return sum;
        });
    return static_cast<double>(std::count_if(differences.begin(), differences.end(),
                                             [](double d) { return d > 0.0; })) /
           static_cast<double>(differences.size());
  }

  /// Whether the fitted coefficients are physically possible and large enough. Friction must not
  /// drive the axis, and must vary by more than that of every guideway does.
  [[nodiscard]] bool possible(const TorqueTerm& term, const Eigen::MatrixXd& base) const {
    Eigen::MatrixXd all = base;
    const Eigen::MatrixXd own = rows_.columns(term);
    append(all, own);
    const Eigen::VectorXd theta = training_of(rows_).fit(rows_.training(all));
    const Eigen::VectorXd of_own = theta.tail(own.cols());
    if (term.kind == kind_of<AsymmetricFriction>())
      return std::abs(of_own(0)) < body_.coulomb &&
             (std::abs(of_own(0)) > kMinDifference * body_.coulomb ||
              (of_own.size() > 1 && std::abs(of_own(1)) > kMinViscousDifference * body_.viscous));
    if (term.kind == kind_of<PeriodicDisturbance>()) {
      // A frequency with which the motion itself repeats is not a disturbance.
      const Eigen::MatrixXd wave = rows_.training(rows_.rough_waves(term.kind, term.shapes[0]));
      const Eigen::VectorXd v = rows_.training(rows_.velocity());
      const Eigen::VectorXd left = v - wave * least_squares(wave, v);
      return left.squaredNorm() > kMinVelocityShareLeft * v.squaredNorm();
    }
    // Falling or rising with speed, the force must oppose the motion at all speeds.
    // Below the velocity at which the friction of the body turns around, it is a matter of how.
    if (term.kind == kind_of<FallingFriction>())
      return term.shapes[0] > body_.velocity_limit &&
             std::abs(of_own(0)) > kMinStribeckShare * body_.coulomb && of_own(0) > -body_.coulomb;
    if (term.kind == kind_of<AddedFriction>()) {
      const double fastest = rows_.velocity().cwiseAbs().maxCoeff();
      return of_own(0) * (of_own(0) + of_own(1) * fastest) > 0.0 &&
             (std::abs(of_own(0)) > kMinChangeOfFriction * body_.coulomb ||
              std::abs(of_own(1)) > kMinChangeOfFriction * body_.viscous);
    }
    if (term.kind == kind_of<PositionDependentFriction>())
      return unevenness(rows_, term, of_own) > kMinUnevenness * body_.coulomb;
    for (Eigen::Index i = 0; i < own.cols(); ++i) {
      if (coefficients_of(term.kind)[static_cast<std::size_t>(i)].lower == 0.0 && of_own(i) < 0.0)
        return false;
    }
    return true;
  }
  /// Adds further periods to the cogging that was added last, one by one: its harmonics and other
  /// periods, since a motor has slots as well as poles.
  void lines() {
    const double period = out_.parts.back().terms.front().shapes[0];
    std::vector<double> periods;
    for (int n = 3; n <= kMaxHarmonic && !rotary_; ++n) periods.push_back(period / n);
    for (const auto& shapes : rows_.grid(kind_of<Cogging>(), body_.velocity_limit))
      periods.push_back(shapes[0]);
    while (out_.parts.back().terms.size() < kMaxCoggingLines) {
      const BlockedRegression data = training_of(rows_);
      const Eigen::MatrixXd base = all();
      const BlockedRegression::Beside beside(data, rows_.training(base));
      std::vector<std::pair<double, double>> rough;
      for (const double one : periods) {
        throw_if_interrupted();
        rough.emplace_back(
            -beside.explained(rows_.training(rows_.rough_waves(kind_of<Cogging>(), one))), one);
      }
      std::sort(rough.begin(), rough.end());
      Judgement best;
      TorqueTerm line;
      for (std::size_t i = 0; i < std::min(kLinesTried, rough.size()); ++i) {
        const TorqueTerm term{kind_of<Cogging>(), {rough[i].second}, 2};
        Judgement judgement =
            judged(base, rows_.columns(term), kLinesTried, periods.size(), kFalseAlarmRateOfLine);
        out_.steps.push_back(text("  further period %.4g: %.4g RMS, z %.1f, p %.1g%s",
                                  term.shapes[0], judgement.rms, judgement.z, judgement.p,
                                  judgement.earned ? "" : ": not added"));
        if (!judgement.earned || (best.earned && best.rms <= judgement.rms)) continue;
        best = std::move(judgement);
        line = term;
      }
      if (!best.earned) return;
      out_.parts.back().terms.push_back(line);
    }
  }

  /// Removes a cause that a later one has made unnecessary.
  void remove_unnecessary() {
    const BlockedRegression data = training_of(rows_);
    const std::vector<double> with = data.predicted(rows_.training(all()));
    for (std::size_t i = 0; i + 1 < out_.parts.size(); ++i) {
      if (out_.parts[i].id == "backlash") continue;
      const std::vector<double> without = data.predicted(rows_.training(all(i)));
      if (rms_of(with) < kMaxRmsRatioToAdd * rms_of(without)) continue;
      out_.steps.push_back(out_.parts[i].id + ": no longer needed, removed");
      out_.parts.erase(out_.parts.begin() + static_cast<std::ptrdiff_t>(i));
      return;
    }
  }

  const TorqueRows& rows_;
  const TorqueBody& body_;
  const DiagnoseOptions& options_;
  bool rests_, rotary_;
  TorqueSelected out_;
  double baseline_ = 0.0;  // RMS
};

}  // namespace

Eigen::MatrixXd columns_of(const TorqueRows& rows, const TorqueBody& body,
                           const std::vector<TorquePart>& parts, std::size_t but) {
  Eigen::MatrixXd out = body.columns;
  for (std::size_t i = 0; i < parts.size(); ++i) {
    if (i == but) continue;
    for (const TorqueTerm& term : parts[i].terms) append(out, rows.columns(term));
  }
  return out;
}

double unevenness(const TorqueRows& rows, const TorqueTerm& term, const Eigen::VectorXd& c) {
  double low = 1e300, high = -1e300;
  for (const double x : rows.position()) {
    const double angle = 2.0 * std::numbers::pi * x / term.shapes[0];
    const double level = c(0) * x + c(1) * x * x + c(2) * std::sin(angle) + c(3) * std::cos(angle);
    low = std::min(low, level);
    high = std::max(high, level);
  }
  return 0.5 * (high - low);
}

TorqueSelected select_torque_causes(const TorqueRows& rows, const TorqueBody& body,
                                    const DiagnoseOptions& options, bool rests, bool rotary) {
  return TorqueSelection(rows, body, options, rests, rotary).run();
}

}  // namespace servotwin
