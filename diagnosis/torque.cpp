#include "diagnosis/torque.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <stdexcept>

#include "diagnosis/blocked_regression.h"
#include "diagnosis/bootstrap.h"
#include "diagnosis/chance.h"
#include "diagnosis/search.h"
#include "diagnosis/text.h"
#include "diagnosis/torque_rows.h"

namespace servotwin {

namespace {

constexpr double kWorthIt = 0.98;       // a cause must bring the error below this
constexpr double kOfBaseline = 0.05;    // and take away this of the baseline's, in quadrature
constexpr double kChance = 0.01;        // false causes of a clean machine
constexpr double kChanceOfLine = 0.05;  // of a line of a cause that is named already
constexpr double kAgrees = 2.0;         // z of the pieces that does not contradict
constexpr double kDecisive = 0.95, kNearlyAsGood = 0.8, kAsGood = 0.9;
constexpr double kBothWays = 0.15;    // of the path, in the rarer direction
constexpr double kUneven = 0.1;       // of Coulomb friction: less is every guide's
constexpr double kFundamental = 0.9;  // share of what the double period explains
constexpr double kStraight = 0.02;    // of the travel: a position that is a line over time
constexpr int kMostCauses = 6, kMostHarmonic = 8;
constexpr std::size_t kMostLines = 6, kLinesTried = 4;  // of cogging

double root_mean(const std::vector<double>& pieces) {
  double sum = 0.0;
  for (const double piece : pieces) sum += piece;
  return std::sqrt(sum / std::max<double>(1.0, static_cast<double>(pieces.size())));
}

/// A cause under way: its columns over all rows.
struct Part {
  std::string id;
  std::vector<TorqueTerm> terms;
  TorqueCause cause;
  /// Causes that would have explained nearly as much, and the share of resamples that this one
  /// beats them in.
  std::vector<std::pair<std::string, double>> rivals;
};

class TorqueSearch {
 public:
  TorqueSearch(const SegmentedAxis& axis, const DiagnoseOptions& options, bool commanded)
      : options_(options), rows_(axis, options.identify.training_share, commanded) {
    out_.axis = axis.axis;
    out_.unit = axis.torque_unit;
    out_.rotary = axis.rotary;
    out_.commanded = commanded;
    out_.training_to_s = rows_.training_to_s();
    unit_ = key_of_unit(axis.torque_unit);
  }

  TorqueDiagnosis run() {
    baseline();
    play();
    while (static_cast<int>(parts_.size()) < kMostCauses && add_one()) take_out_the_needless();
    for (std::size_t i = 0; i < parts_.size(); ++i) conclude(i);
    finish();
    return std::move(out_);
  }

 private:
  [[nodiscard]] bool wanted(std::string_view id) const {
    return std::find(options_.leave_out.begin(), options_.leave_out.end(), id) ==
           options_.leave_out.end();
  }
  [[nodiscard]] bool named(std::string_view id) const {
    return std::any_of(parts_.begin(), parts_.end(), [&](const Part& p) { return p.id == id; });
  }
  [[nodiscard]] BlockedRegression training() const {
    return {rows_.training(rows_.torque()), rows_.training(rows_.time())};
  }
  /// The columns of the baseline and of all parts but one, over all rows.
  [[nodiscard]] Eigen::MatrixXd columns(std::size_t but = kNoEffect) const {
    Eigen::MatrixXd out = base_;
    for (std::size_t i = 0; i < parts_.size(); ++i) {
      if (i == but) continue;
      for (const TorqueTerm& term : parts_[i].terms) append(out, rows_.columns(term));
    }
    return out;
  }
  static void append(Eigen::MatrixXd& to, const Eigen::MatrixXd& columns) {
    to.conservativeResize(columns.rows(), to.cols() + columns.cols());
    to.rightCols(columns.cols()) = columns;
  }

  /// Mass, Coulomb and viscous friction, none of them negative; and which way the torque counts.
  void baseline() {
    const BlockedRegression data = training();
    const Eigen::VectorXd velocity = rows_.training(rows_.velocity());
    const double forward = velocity.cwiseMax(0.0).sum() / velocity.cwiseAbs().sum();
    both_ways_ = std::min(forward, 1.0 - forward) > kBothWays;
    Eigen::MatrixXd line(velocity.size(), 2);
    line << Eigen::VectorXd::Ones(velocity.size()), rows_.training(rows_.time());
    const Eigen::VectorXd x = rows_.training(rows_.position());
    one_speed_ =
        rms_of(x - line * line.colPivHouseholderQr().solve(x)) < kStraight * rows_.travel();
    // The velocity at which friction has its direction, beside a constant where there may be one.
    double least = 1e300;
    for (double limit = 2e-5; limit < 2.1e-2; limit *= 1.78) {
      Eigen::MatrixXd trial = rows_.body(limit);
      if (both_ways_) append(trial, Eigen::MatrixXd::Ones(trial.rows(), 1));
      const Eigen::MatrixXd shown = rows_.training(trial);
      const double left = (rows_.training(rows_.torque()) - shown * data.fit(shown)).squaredNorm();
      if (left < least) least = left, velocity_limit_ = limit, base_ = trial;
    }
    const Eigen::MatrixXd shown = rows_.training(base_);
    const Eigen::VectorXd theta = data.fit(shown);
    if (both_ways_) {
      // What moves a body works on it: mass and friction are positive, or the sign is the other.
      const double work =
          (theta.head(3).array() * shown.leftCols(3).colwise().norm().transpose().array()).sum();
      out_.opposite = work < 0.0;
    }
    if (out_.opposite) rows_.turn_torque();
    base_ = rows_.body(velocity_limit_);
    // A mass or a friction that would be negative is not seen by this motion.
    const BlockedRegression turned = training();
    std::vector<int> kept{0, 1, 2};
    for (bool again = true; again && !kept.empty();) {
      Eigen::MatrixXd c(base_.rows(), 0);
      for (const int i : kept) append(c, base_.col(i));
      if (both_ways_) append(c, Eigen::MatrixXd::Ones(c.rows(), 1));
      const Eigen::VectorXd all = turned.fit(rows_.training(c));
      again = false;
      for (std::size_t i = 0; i < kept.size(); ++i) {
        (kept[i] == 0   ? out_.mass
         : kept[i] == 1 ? out_.coulomb
                        : out_.viscous) = std::max(0.0, all(static_cast<Eigen::Index>(i)));
        if (all(static_cast<Eigen::Index>(i)) >= 0.0) continue;
        kept.erase(kept.begin() + static_cast<std::ptrdiff_t>(i));
        again = true;
        break;
      }
    }
    Eigen::MatrixXd c(base_.rows(), 0);
    for (const int i : kept) append(c, base_.col(i));
    base_ = c;
    baseline_ = root_mean(training().predicted(rows_.training(base_)));
    out_.steps.push_back(text("baseline %.4g %s: mass %.4g, coulomb %.4g, viscous %.4g%s",
                              baseline_, out_.unit.c_str(), out_.mass, out_.coulomb, out_.viscous,
                              out_.opposite ? "; the torque counts against the position" : ""));
  }

  struct Judgement {
    double z = 0.0, p = 1.0, rms = 0.0;
    std::vector<double> pieces;
    bool earned = false;
  };
  [[nodiscard]] Judgement judged(const Eigen::MatrixXd& base, const Eigen::MatrixXd& added,
                                 std::size_t candidates, std::size_t points,
                                 double chance = kChance) const {
    const BlockedRegression data = training();
    const Eigen::MatrixXd before = rows_.training(base), more = rows_.training(added);
    const std::vector<double> pieces = data.predicted(before);
    Judgement out;
    out.pieces = data.predicted(before, more);
    out.z = paired_z(pieces, out.pieces);
    out.p = chance_beyond(out.z);
    if (out.z > kAgrees) {
      out.p = std::min(out.p, std::min(1.0, static_cast<double>(points) *
                                                chance_beyond(data.wald(before, more))));
    }
    out.rms = root_mean(out.pieces);
    const double rms = root_mean(pieces);
    const double taken = std::sqrt(std::max(0.0, rms * rms - out.rms * out.rms));
    out.earned = out.rms < kWorthIt * rms && taken > kOfBaseline * baseline_ &&
                 out.p < chance / static_cast<double>(candidates);
    return out;
  }

  /// Play first, since all that has memory looks different beside it.
  void play() {
    if (!wanted("backlash")) return;
    out_.plateau = plateau_of(rows_.stretches(out_.mass));
    const Plateau& plateau = out_.plateau;
    if (plateau.reversals.size() < 2) return;
    out_.steps.push_back(text("plateau after reversals: %zu, width %.4g +- %.2g, z %.1f%s",
                              plateau.reversals.size(), plateau.width, plateau.deviation,
                              plateau.statistic, plateau.found() ? "" : ": none"));
    if (!plateau.found()) return;
    // The same spring without the gap is friction that gives, and no play.
    const BlockedRegression data = training();
    const BlockedRegression::Beside beside(data, rows_.training(base_));
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
    Eigen::MatrixXd without = base_;
    append(without, rows_.columns(elastic));
    const Judgement judgement = judged(without, rows_.columns(gap), 1, points);
    out_.steps.push_back(text("  with a gap %.4g, z %.1f", judgement.rms, judgement.z));
    if (!judgement.earned) return;
    Part part;
    part.id = "backlash";
    part.terms = {elastic, gap};
    part.cause.evidence = {
        {"force plateau over the travel after reversals", plateau.statistic,
         chance_beyond(plateau.statistic)},
        {"torque residual, blocked cross-validation against the same spring without a gap",
         judgement.z, judgement.p}};
    part.cause.confidence = 1.0 - std::max(judgement.p, chance_beyond(plateau.statistic));
    const std::string key = out_.rotary ? "width_rad" : "width_m";
    part.cause.parameters = {{key, plateau.width}, {"deviation", plateau.deviation}};
    if (plateau.forward > 0.0) part.cause.parameters.emplace_back("width_forward", plateau.forward);
    if (plateau.backward > 0.0)
      part.cause.parameters.emplace_back("width_backward", plateau.backward);
    part.cause.parameters.emplace_back("reversals", static_cast<double>(plateau.reversals.size()));
    parts_.push_back(std::move(part));
  }

  [[nodiscard]] std::vector<std::size_t> candidates() const {
    static const std::vector<std::size_t> kActOnTheBody{
        kind_of<ConstantForce>(),   kind_of<AsymmetricFriction>(),
        kind_of<FallingFriction>(), kind_of<Presliding>(),
        kind_of<Cogging>(),         kind_of<PositionDependentFriction>(),
        kind_of<AddedFriction>(),   kind_of<InertiaChange>(),
        kind_of<ViscousDrift>(),    kind_of<PeriodicDisturbance>(),
        kind_of<DwellStiction>()};
    std::vector<std::size_t> out;
    for (const std::size_t kind : kActOnTheBody) {
      const std::string_view id = identity_of(kind).cause;
      if (!wanted(id) || named(id)) continue;
      const bool unlike = kind == kind_of<ConstantForce>() || kind == kind_of<AsymmetricFriction>();
      // In one direction a constant force is Coulomb friction, at one speed a place is a time.
      if (unlike && (!both_ways_ || named("gravity_offset") || named("asymmetric_friction")))
        continue;
      const bool by_speed = kind == kind_of<FallingFriction>() || kind == kind_of<ViscousDrift>() ||
                            kind == kind_of<PeriodicDisturbance>();
      if (one_speed_ && by_speed) continue;
      const bool by_reversals =
          kind == kind_of<PositionDependentFriction>() || kind == kind_of<Presliding>();
      if (by_reversals && !both_ways_) continue;
      if (kind == kind_of<DwellStiction>() && !out_.commanded) continue;
      out.push_back(kind);
    }
    return out;
  }

  /// The best shapes on the grid of a kind, refined about it; none where nothing fits.
  struct Looked {
    std::size_t kind = 0, points = 0;
    double explained = 0.0;
    TorqueTerm term;
  };
  [[nodiscard]] Looked looked(std::size_t kind, const BlockedRegression::Beside& beside) const {
    Looked out{kind, 0, 0.0, {}};
    const auto try_out = [&](const std::vector<double>& shapes) {
      // The body has its viscous friction already.
      const TorqueTerm term{kind, shapes, kind == kind_of<Presliding>() ? 1 : 0};
      const double explained = beside.explained(rows_.training(rows_.columns(term)));
      ++out.points;
      if (explained > out.explained) out.explained = explained, out.term = term;
    };
    const std::vector<std::vector<double>> grid = rows_.grid(kind, velocity_limit_);
    if (kind == kind_of<Cogging>() || kind == kind_of<PeriodicDisturbance>()) {
      // Waves by their columns without filters, the best ones with them.
      std::vector<std::pair<double, std::vector<double>>> rough;
      for (const std::vector<double>& shapes : grid)
        rough.emplace_back(-beside.explained(rows_.training(rows_.rough_waves(kind, shapes[0]))),
                           shapes);
      out.points = grid.size();
      std::sort(rough.begin(), rough.end());
      for (std::size_t i = 0; i < std::min<std::size_t>(6, rough.size()); ++i)
        try_out(rough[i].second);
    } else {
      for (const std::vector<double>& shapes : grid) try_out(shapes);
    }
    if (out.explained <= 0.0 || shapes_of(kind).empty()) return out;
    const bool whole_orders = out_.rotary && kind == kind_of<Cogging>();
    if (!whole_orders) refine(out, try_out);
    while (kind == kind_of<Cogging>()) {
      std::vector<double> half = out.term.shapes;
      half[0] *= 0.5;
      if (half[0] < shapes_of(kind)[0].lower) break;
      const TorqueTerm term{kind, half, 0};
      const double explained = beside.explained(rows_.training(rows_.columns(term)));
      if (explained < kFundamental * out.explained) break;
      out.explained = explained, out.term = term;
      if (!whole_orders) refine(out, try_out);
    }
    return out;
  }
  template <class TryOut>
  void refine(const Looked& best, const TryOut& try_out) const {
    const Parameter& p = shapes_of(best.kind)[0];
    // A period is known to a part of a turn over the travel, a scale to a part of itself.
    double step = 0.3;
    if (p.scan == Scan::kPeriod) step = std::min(0.2, 0.25 * best.term.shapes[0] / rows_.travel());
    if (p.scan == Scan::kFrequency || p.scan == Scan::kTime) step = 0.01;
    for (int round = 0; round < 4; ++round, step *= 0.35) {
      const std::vector<double> centre = best.term.shapes;
      for (const int i : {-2, -1, 1, 2}) {
        std::vector<double> shapes = centre;
        shapes[0] *= std::exp(step * i);
        if (shapes[0] > p.lower && shapes[0] < p.upper) try_out(shapes);
      }
    }
  }

  bool add_one() {
    const std::vector<std::size_t> kinds = candidates();
    if (kinds.empty()) return false;
    const BlockedRegression data = training();
    const Eigen::MatrixXd base = columns();
    const BlockedRegression::Beside beside(data, rows_.training(base));
    const double rms = root_mean(data.predicted(rows_.training(base)));
    std::vector<std::pair<Judgement, Looked>> tried;
    for (const std::size_t kind : kinds) {
      Looked best = looked(kind, beside);
      if (best.explained <= 0.0) continue;
      const Judgement judgement = judged(base, rows_.columns(best.term), kinds.size(), best.points);
      out_.steps.push_back(text("  %.4g with %s %.4g, z %.1f, p %.1g%s", rms,
                                std::string(identity_of(kind).id).c_str(), judgement.rms,
                                judgement.z, judgement.p, judgement.earned ? "" : ": no"));
      if (judgement.earned && possible(best.term, base)) tried.emplace_back(judgement, best);
    }
    // What is still to be explained beside the cause before is no rival of it.
    if (!parts_.empty()) {
      std::erase_if(parts_.back().rivals, [&](const auto& rival) {
        return std::any_of(tried.begin(), tried.end(), [&](const auto& one) {
          return identity_of(one.second.kind).cause == rival.first;
        });
      });
    }
    if (tried.empty()) return false;
    std::sort(tried.begin(), tried.end(),
              [](const auto& l, const auto& r) { return l.first.rms < r.first.rms; });
    auto chosen = tried.begin();
    // Of two that the pieces cannot tell apart, the one that needs less.
    for (auto rival = chosen + 1; rival != tried.end(); ++rival) {
      if (columns_of(rival->second) < columns_of(chosen->second) &&
          rms - rival->first.rms > kAsGood * (rms - chosen->first.rms) &&
          beaten(chosen->first, rival->first) < kDecisive)
        chosen = rival;
    }
    const auto& [judgement, best] = *chosen;
    Part part;
    part.id = identity_of(best.kind).cause;
    part.terms = {best.term};
    part.cause.evidence = {{"torque residual, blocked cross-validation, paired over 0.25 s",
                            judgement.z, judgement.p}};
    part.cause.confidence = 1.0 - judgement.p;
    for (const auto& [rival, of_rival] : tried) {
      if (of_rival.kind != best.kind && rms - rival.rms > kNearlyAsGood * (rms - judgement.rms))
        part.rivals.emplace_back(identity_of(of_rival.kind).cause, beaten(judgement, rival));
    }
    if (best.kind == kind_of<Cogging>() && one_speed_)
      part.cause.ambiguous_with.emplace_back("periodic_disturbance");
    out_.steps.push_back(part.id + ": added");
    parts_.push_back(std::move(part));
    if (best.kind == kind_of<Cogging>()) lines();
    return true;
  }

  static Eigen::Index columns_of(const Looked& one) {
    return static_cast<Eigen::Index>(coefficients_of(one.kind).size() + shapes_of(one.kind).size());
  }
  static double beaten(const Judgement& best, const Judgement& rival) {
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

  /// Friction that would push, or that is unlike by less than that of every guide, is none.
  [[nodiscard]] bool possible(const TorqueTerm& term, const Eigen::MatrixXd& base) const {
    Eigen::MatrixXd all = base;
    const Eigen::MatrixXd own = rows_.columns(term);
    append(all, own);
    const Eigen::VectorXd theta = training().fit(rows_.training(all));
    const Eigen::VectorXd of_own = theta.tail(own.cols());
    if (term.kind == kind_of<AsymmetricFriction>()) return std::abs(of_own(0)) < out_.coulomb;
    if (term.kind == kind_of<AddedFriction>()) {
      const double fastest = rows_.velocity().cwiseAbs().maxCoeff();
      return of_own(0) * (of_own(0) + of_own(1) * fastest) > 0.0;
    }
    if (term.kind == kind_of<PositionDependentFriction>())
      return unevenness(term, of_own) > kUneven * out_.coulomb;
    for (Eigen::Index i = 0; i < own.cols(); ++i) {
      if (coefficients_of(term.kind)[static_cast<std::size_t>(i)].lower == 0.0 && of_own(i) < 0.0)
        return false;
    }
    return true;
  }
  /// Half of what the level of friction varies over the travel.
  [[nodiscard]] double unevenness(const TorqueTerm& term, const Eigen::VectorXd& c) const {
    double low = 1e300, high = -1e300;
    for (const double x : rows_.position()) {
      const double angle = 2.0 * std::numbers::pi * x / term.shapes[0];
      const double level =
          c(0) * x + c(1) * x * x + c(2) * std::sin(angle) + c(3) * std::cos(angle);
      low = std::min(low, level);
      high = std::max(high, level);
    }
    return 0.5 * (high - low);
  }

  /// What repeats beside the cogging that was added last, line by line: its harmonics, and other
  /// periods, since a motor has slots beside its poles.
  void lines() {
    const double period = parts_.back().terms.front().shapes[0];
    std::vector<double> periods;
    for (int n = 3; n <= kMostHarmonic && !out_.rotary; ++n) periods.push_back(period / n);
    for (const auto& shapes : rows_.grid(kind_of<Cogging>(), velocity_limit_))
      periods.push_back(shapes[0]);
    while (parts_.back().terms.size() < kMostLines) {
      const BlockedRegression data = training();
      const Eigen::MatrixXd base = columns();
      const BlockedRegression::Beside beside(data, rows_.training(base));
      std::vector<std::pair<double, double>> rough;
      for (const double one : periods) {
        rough.emplace_back(
            -beside.explained(rows_.training(rows_.rough_waves(kind_of<Cogging>(), one))), one);
      }
      std::sort(rough.begin(), rough.end());
      Judgement best;
      TorqueTerm line;
      for (std::size_t i = 0; i < std::min(kLinesTried, rough.size()); ++i) {
        const TorqueTerm term{kind_of<Cogging>(), {rough[i].second}, 2};
        Judgement judgement =
            judged(base, rows_.columns(term), kLinesTried, periods.size(), kChanceOfLine);
        out_.steps.push_back(text("  line of period %.4g: %.4g, z %.1f, p %.1g%s", term.shapes[0],
                                  judgement.rms, judgement.z, judgement.p,
                                  judgement.earned ? "" : ": no"));
        if (!judgement.earned || (best.earned && best.rms <= judgement.rms)) continue;
        best = std::move(judgement);
        line = term;
      }
      if (!best.earned) return;
      parts_.back().terms.push_back(line);
    }
  }

  /// A cause that another has made needless goes.
  void take_out_the_needless() {
    const BlockedRegression data = training();
    const std::vector<double> with = data.predicted(rows_.training(columns()));
    for (std::size_t i = 0; i + 1 < parts_.size(); ++i) {
      if (parts_[i].id == "backlash") continue;
      const std::vector<double> without = data.predicted(rows_.training(columns(i)));
      if (root_mean(with) < kWorthIt * root_mean(without)) continue;
      out_.steps.push_back(parts_[i].id + ": needless");
      parts_.erase(parts_.begin() + static_cast<std::ptrdiff_t>(i));
      return;
    }
  }

  /// What a model leaves of the hold-out, its coefficients from the training data.
  [[nodiscard]] Eigen::VectorXd left_by(const Eigen::MatrixXd& given) const {
    return rows_.holdout(rows_.torque()) -
           rows_.holdout(given) * training().fit(rows_.training(given));
  }
  static double rms_of(const Eigen::VectorXd& left) {
    return std::sqrt(left.squaredNorm() / std::max<double>(1.0, static_cast<double>(left.size())));
  }
  [[nodiscard]] std::vector<double> pieces_of(const Eigen::VectorXd& left) const {
    const Eigen::VectorXd time = rows_.holdout(rows_.time());
    // Quarter seconds, or ten where the hold-out is shorter.
    const double piece_s = std::min(0.25, 0.1 * static_cast<double>(left.size()) * rows_.step_s());
    std::vector<double> out;
    for (Eigen::Index k = 0; k < left.size();) {
      Eigen::Index end = k;
      while (end < left.size() && std::floor(time(end) / piece_s) == std::floor(time(k) / piece_s))
        ++end;
      out.push_back(left.segment(k, end - k).squaredNorm() / static_cast<double>(end - k));
      k = end;
    }
    return out;
  }

  /// Parameters and gain of one cause, everything else as it is.
  void conclude(std::size_t i) {
    Part& part = parts_[i];
    for (const auto& [rival, share] : part.rivals) {
      if (named(rival)) continue;
      part.cause.confidence = std::min(part.cause.confidence, share);
      if (share < kDecisive) part.cause.ambiguous_with.push_back(rival);
    }
    const Eigen::VectorXd theta = training().fit(rows_.training(columns()));
    Eigen::Index at = base_.cols();
    for (std::size_t j = 0; j < i; ++j) {
      for (const TorqueTerm& term : parts_[j].terms) at += rows_.columns(term).cols();
    }
    if (part.id != "backlash") parameters(part, theta.segment(at, theta.size() - at), theta);
    Eigen::MatrixXd without = columns(i);
    if (part.id == "backlash") append(without, rows_.columns(part.terms.front()));
    const Eigen::VectorXd before = left_by(without), after = left_by(columns());
    Gain& gain = part.cause.gain;
    if (before.size() > 0) gain.before = rms_of(before), gain.after = rms_of(after);
    const std::vector<double> was = pieces_of(before), is = pieces_of(after);
    if (was.size() < 4) return;
    const auto mean_of = [](const std::vector<double>& of, const std::vector<std::size_t>& places) {
      double sum = 0.0;
      for (const std::size_t p : places) sum += of[p];
      return std::sqrt(sum / static_cast<double>(places.size()));
    };
    const auto differences = bootstrap(was.size(), [&](const std::vector<std::size_t>& places) {
      return mean_of(was, places) - mean_of(is, places);
    });
    gain.low = differences[static_cast<std::size_t>(0.025 * kResamples)];
    gain.high = differences[static_cast<std::size_t>(0.975 * kResamples)];
  }

  void parameters(Part& part, const Eigen::VectorXd& c, const Eigen::VectorXd& all) {
    const TorqueTerm& term = part.terms.front();
    const double sign = out_.opposite ? -1.0 : 1.0;
    auto& out = part.cause.parameters;
    const auto shape = [&](std::string_view name) {
      std::size_t i = 0;
      for (const Parameter& p : shapes_of(term.kind)) {
        if (p.name == name) return term.shapes[i];
        ++i;
      }
      return kAbsent;
    };
    if (part.id == "gravity_offset") {
      out = {{"offset_" + unit_, sign * c(0)},
             {"over_coulomb", out_.coulomb > 0.0 ? std::abs(c(0)) / out_.coulomb : kAbsent}};
    } else if (part.id == "asymmetric_friction") {
      const double level = out_.coulomb > 0.0 ? all(level_column()) : 0.0,
                   viscous = viscous_column() >= 0 ? all(viscous_column()) : 0.0;
      out = {{"ratio", (level + c(0)) / (level - c(0))},
             {"coulomb_plus_" + unit_, level + c(0)},
             {"coulomb_minus_" + unit_, level - c(0)},
             {"viscous_plus", viscous + c(1)},
             {"viscous_minus", viscous - c(1)}};
    } else if (part.id == "stribeck") {
      out = {{"drop_" + unit_, c(0)}, {"stribeck_velocity", shape("stribeck_velocity")}};
    } else if (part.id == "presliding") {
      out = {{"breakaway_" + unit_, c(0)},
             {"breakaway_displacement", shape("breakaway_displacement")},
             {"shape_factor", shape("shape_factor")}};
    } else if (part.id == "cogging") {
      cogging(part, c);
    } else if (part.id == "position_dependent_friction") {
      out = {{"amplitude_" + unit_, unevenness(term, c.head(4))}};
    } else if (part.id == "added_friction") {
      out = {{"time_s", shape("time_s")}, {"coulomb_" + unit_, c(0)}, {"viscous", c(1)}};
    } else if (part.id == "inertia_change") {
      out = {{"time_s", shape("time_s")},
             {"ratio", out_.mass > 0.0 ? 1.0 + c(0) / all(0) : kAbsent}};
    } else if (part.id == "viscous_drift") {
      out = {{"time_constant_s", shape("time_constant_s")}, {"cold", c(0)}};
    } else if (part.id == "periodic_disturbance") {
      out = {{"frequency_hz", shape("frequency_hz")},
             {"amplitude_" + unit_, std::hypot(c(0), c(1))}};
    } else if (part.id == "dwell_stiction") {
      out = {{"growth_" + unit_, c(0)}, {"length", shape("length")}};
    }
  }
  [[nodiscard]] Eigen::Index level_column() const { return out_.mass > 0.0 ? 1 : 0; }
  [[nodiscard]] Eigen::Index viscous_column() const {
    if (!(out_.viscous > 0.0)) return -1;
    return (out_.mass > 0.0 ? 1 : 0) + (out_.coulomb > 0.0 ? 1 : 0);
  }

  void cogging(Part& part, const Eigen::VectorXd& c) const {
    const double period = part.terms.front().shapes[0];
    const auto line = [&](double of, double sine, double cosine) {
      part.cause.harmonics.push_back({of, std::hypot(sine, cosine), kAbsent});
    };
    line(period, c(0), c(1));
    line(0.5 * period, c(2), c(3));
    for (std::size_t t = 1; t < part.terms.size(); ++t) {
      const auto at = static_cast<Eigen::Index>(2 + 2 * t);
      line(part.terms[t].shapes[0], c(at), c(at + 1));
    }
    std::vector<double> periods;
    for (const Harmonic& harmonic : part.cause.harmonics) periods.push_back(harmonic.period);
    const std::vector<double> through = rows_.tracking_error_at(periods);
    for (std::size_t i = 0; i < through.size(); ++i)
      part.cause.harmonics[i].tracking_error = through[i];
    part.cause.parameters = {{out_.rotary ? "period_rad" : "period_m", period},
                             {"amplitude_" + unit_, part.cause.harmonics[0].amplitude},
                             {"amplitude_2_" + unit_, part.cause.harmonics[1].amplitude}};
    if (out_.rotary)
      part.cause.parameters.emplace_back("order_per_rev", 2.0 * std::numbers::pi / period);
  }

  void finish() {
    const double sign = out_.opposite ? -1.0 : 1.0;
    out_.time = rows_.holdout(rows_.time());
    out_.torque = sign * rows_.holdout(rows_.torque());
    out_.left_before = sign * left_by(base_);
    out_.left_after = sign * left_by(columns());
    out_.baseline_rms = rms_of(out_.left_before);
    out_.extended_rms = rms_of(out_.left_after);
    std::stable_sort(parts_.begin(), parts_.end(), [](const Part& l, const Part& r) {
      const auto worth = [](const Gain& g) {
        return std::isfinite(g.before) ? g.before * g.before - g.after * g.after : 0.0;
      };
      return worth(l.cause.gain) > worth(r.cause.gain);
    });
    for (Part& part : parts_) {
      part.cause.id = part.id;
      out_.causes.push_back(std::move(part.cause));
    }
  }

  const DiagnoseOptions& options_;
  TorqueRows rows_;
  TorqueDiagnosis out_;
  std::string unit_;
  Eigen::MatrixXd base_;
  std::vector<Part> parts_;
  double velocity_limit_ = 1e-3, baseline_ = 0.0;
  bool both_ways_ = false, one_speed_ = false;
};

}  // namespace

bool without_command(Recording& recording, std::string_view name) {
  const auto known = [](const std::vector<double>& values) {
    return std::any_of(values.begin(), values.end(), [](double v) { return std::isfinite(v); });
  };
  for (AxisRecord& axis : recording.axes) {
    if (axis.name != name || known(axis.command)) continue;
    if (!known(axis.actual) || !known(axis.torque)) continue;
    axis.command = axis.actual;
    return true;
  }
  return false;
}

bool has_torque(const SegmentedAxis& axis) {
  return std::any_of(axis.segments.begin(), axis.segments.end(),
                     [](const Segment& s) { return s.torque.size() > 0; });
}

std::string key_of_unit(const std::string& unit) {
  if (unit == "N") return "n";
  if (unit == "Nm") return "nm";
  if (unit == "A") return "a";
  if (unit == "V") return "v";
  return "percent";
}

TorqueDiagnosis diagnose_torque(const SegmentedAxis& axis, const DiagnoseOptions& options,
                                bool commanded) {
  if (!has_torque(axis)) throw std::runtime_error(axis.axis + ": there is no torque");
  return TorqueSearch(axis, options, commanded).run();
}

}  // namespace servotwin
