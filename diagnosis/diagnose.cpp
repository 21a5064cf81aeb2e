#include "diagnosis/diagnose.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <map>
#include <random>

#include "identification/chart.h"
#include "identification/joint.h"
#include "identification/noise_floor.h"
#include "identification/output_error.h"
#include "twin/twin.h"

namespace servotwin {

namespace {

constexpr int kBlocks = 4;
constexpr double kPiece_s = 0.25;   // of the paired test and of the bootstrap
constexpr double kSettle_s = 0.25;  // of every stretch; does not count
constexpr double kWorthIt = 0.98;   // a cause must bring the error below this
constexpr double kChance = 0.01;    // false causes of a clean machine
constexpr double kAgrees = 1.64;    // z of the pieces that does not contradict
constexpr int kMostCauses = 6;
constexpr int kJudged = 4;  // candidates of a round that are cross-validated
constexpr int kResamples = 500;
constexpr double kNearlyAsGood = 0.8;  // share of the gain that makes a rival
constexpr double kStructured = 2.0;    // of the noise floor: more is not chance

/// A structure with where its search begins or ended, and how well it predicts.
struct Hypothesis {
  Structure structure;
  Point point;
  Model model;
  double cost = 1e300;         // on all of the training data
  std::vector<double> pieces;  // squared errors of the cross-validation, piece by piece
  std::size_t added = kEffectKinds;

  [[nodiscard]] double rms() const {
    double sum = 0.0;
    for (const double piece : pieces) sum += piece;
    return std::sqrt(sum / std::max<double>(1.0, static_cast<double>(pieces.size())));
  }
};

std::string cause_of(std::size_t kind) {
  if (kind == kind_of<FallingFriction>()) return "stribeck";
  return std::string(identity_of(kind).id);
}

Point point_of(const Model& model, const Structure& structure) {
  Point point{model.loop.denominator, {}};
  for (const std::size_t kind : structure.effects) {
    const Effect* effect = model.find(kind);
    for (std::size_t p = 0; p < shapes_of(kind).size(); ++p)
      point.shapes.push_back(effect != nullptr ? effect->shape[p] : shapes_of(kind)[p].start);
  }
  return point;
}

/// The mean square of what a model leaves, piece by piece.
std::vector<double> left_by(const Model& model, const std::vector<Segment>& segments) {
  std::vector<double> out;
  for (const Segment& s : segments) {
    const Eigen::ArrayXd left = s.command - s.actual - simulate(model, s);
    const auto piece = static_cast<Eigen::Index>(std::lround(kPiece_s / s.sample_time_s));
    const auto skip = static_cast<Eigen::Index>(std::lround(kSettle_s / s.sample_time_s));
    for (Eigen::Index at = skip; at + piece <= left.size(); at += piece)
      out.push_back(left.segment(at, piece).square().mean());
  }
  return out;
}

/// z of the mean of paired differences.
double paired_z(const std::vector<double>& before, const std::vector<double>& after) {
  const auto n = static_cast<Eigen::Index>(std::min(before.size(), after.size()));
  if (n < 4) return 0.0;
  const Eigen::ArrayXd d = Eigen::Map<const Eigen::ArrayXd>(before.data(), n) -
                           Eigen::Map<const Eigen::ArrayXd>(after.data(), n);
  const double sd = std::sqrt((d - d.mean()).square().sum() / static_cast<double>(n - 1));
  return sd > 0.0 ? d.mean() / (sd / std::sqrt(static_cast<double>(n))) : 0.0;
}

/// Resamples pieces; `value` of each sample of their places, sorted.
template <class Value>
std::vector<double> bootstrap(std::size_t pieces, const Value& value) {
  std::mt19937_64 random(1);
  std::uniform_int_distribution<std::size_t> any(0, std::max<std::size_t>(pieces, 1) - 1);
  std::vector<double> out;
  std::vector<std::size_t> places(pieces);
  for (int i = 0; i < kResamples; ++i) {
    for (std::size_t& place : places) place = any(random);
    out.push_back(value(places));
  }
  std::sort(out.begin(), out.end());
  return out;
}

class Search {
 public:
  Search(std::vector<Segment> training, const PoleBounds& bounds)
      : training_(std::move(training)), bounds_(bounds) {
    double from = training_.front().start_s, total = 0.0;
    for (const Segment& s : training_) total += s.end_s() - s.start_s;
    // Blocks of equal time of the recording; a gap costs its block.
    const double to = training_.back().end_s();
    for (int b = 0; b < kBlocks; ++b) {
      const double begin = from + (to - from) * b / kBlocks,
                   end = from + (to - from) * (b + 1) / kBlocks;
      held_.push_back(cut(training_, begin, end - 1e-9));
      std::vector<Segment> rest = cut(training_, -1e300, begin - 1e-9);
      for (Segment& s : cut(training_, end, 1e300)) rest.push_back(std::move(s));
      rest_.push_back(std::move(rest));
    }
  }

  [[nodiscard]] Projection data(const std::vector<Segment>& segments,
                                const Structure& structure) const {
    std::vector<Signals> signals;
    for (const Segment& s : segments) signals.push_back(signals_of(s));
    return {std::move(signals), structure};
  }

  /// Refines from these points on all of the training data.
  bool fit(Hypothesis& h, const std::vector<Point>& starts) {
    const Projection all = data(training_, h.structure);
    PoleSearchOptions options;
    options.bounds = bounds_;
    options.tolerance = 1e-7;
    h.cost = 1e300;
    for (const Point& start : starts) {
      options.from = {start};
      const auto found = pole_search(all, options);
      ++fits;
      if (!found || found->solution.cost >= h.cost) continue;
      Model model = all.model_of(found->point, found->solution.linear);
      if (!why_invalid(model).empty()) continue;
      h.cost = found->solution.cost;
      h.point = found->point;
      h.model = std::move(model);
    }
    if (!(h.cost < 1e300)) return false;
    if (h.added < kEffectKinds) {
      const auto first = h.point.shapes.begin() + static_cast<std::ptrdiff_t>(shapes_before(h));
      known_[h.added] = {first, first + static_cast<std::ptrdiff_t>(shapes_of(h.added).size())};
    }
    return true;
  }

  /// Cross-validates: every block is predicted by the coefficients that the others say. Poles and
  /// shapes are those of all blocks; to search them in a part of the data would judge the search.
  void judge(Hypothesis& h) const {
    h.pieces.clear();
    for (std::size_t b = 0; b < held_.size(); ++b) {
      if (held_[b].empty() || rest_[b].empty()) continue;
      const Projection rest = data(rest_[b], h.structure);
      Model model = rest.model_of(h.point, rest.solve(h.point).linear);
      if (!why_invalid(model).empty()) model = h.model;
      const std::vector<double> left = left_by(model, held_[b]);
      h.pieces.insert(h.pieces.end(), left.begin(), left.end());
    }
  }

  /// Where to begin with the shapes of what was added: the best of a grid, the rest held.
  std::vector<Point> starts(const Hypothesis& base, const Hypothesis& h) {
    Point at = point_of(base.model, h.structure);
    const std::size_t offset = shapes_before(h);
    const auto shapes = shapes_of(h.added);
    if (shapes.empty()) return {at};
    // What an earlier round has found is where this one begins; a period may be another one now.
    if (const auto known = known_.find(h.added); known != known_.end() && !shapes.front().scanned) {
      std::copy(known->second.begin(), known->second.end(),
                at.shapes.begin() + static_cast<std::ptrdiff_t>(offset));
      return {at};
    }
    const Projection coarse = thinned(data(training_, h.structure), 2e-3);
    std::vector<std::pair<double, Point>> ranked;
    for (const double value : values_of(shapes.front())) {
      Point trial = at;
      trial.shapes[offset] = value;
      ranked.emplace_back(coarse.solve(trial).cost, trial);
    }
    std::sort(ranked.begin(), ranked.end(),
              [](const auto& l, const auto& r) { return l.first < r.first; });
    std::vector<Point> out;
    for (std::size_t i = 0; i < std::min<std::size_t>(2, ranked.size()); ++i)
      out.push_back(ranked[i].second);
    return out;
  }

  /// The chance of coefficients as large as those of what was added if it is not there (Wald's
  /// test with a covariance that knows of correlated residuals), times the number of places that
  /// were looked at.
  [[nodiscard]] double wald_p(const Hypothesis& h) const {
    const Projection all = data(training_, h.structure);
    PoleFit fit;
    fit.point = h.point;
    fit.solution = all.solve(h.point);
    const Eigen::MatrixXd cov = covariance(all, fit);
    Eigen::Index first = h.structure.order;
    for (const std::size_t kind : h.structure.effects) {
      Eigen::Index count = 0;
      for (const Parameter& p : coefficients_of(kind)) count += p.with_free_loop ? 1 : 0;
      if (kind == h.added) {
        const Eigen::VectorXd c = fit.solution.linear.segment(first, count);
        const double w = c.dot(cov.block(first, first, count, count).ldlt().solve(c));
        // Wilson and Hilferty 1931: the cube root of chi squared is nearly normal.
        const auto k = static_cast<double>(count);
        const double z = (std::cbrt(w / k) - (1.0 - 2.0 / (9.0 * k))) / std::sqrt(2.0 / (9.0 * k));
        const double places = shapes_of(kind).empty()
                                  ? 1.0
                                  : static_cast<double>(values_of(shapes_of(kind).front()).size());
        return std::min(1.0, places * 0.5 * std::erfc(z / std::sqrt(2.0)));
      }
      first += count;
    }
    return 1.0;
  }

  [[nodiscard]] const std::vector<Segment>& training() const { return training_; }
  int fits = 0;

 private:
  /// Where the shapes of what was added begin.
  [[nodiscard]] static std::size_t shapes_before(const Hypothesis& h) {
    std::size_t offset = 0;
    for (const std::size_t kind : h.structure.effects) {
      if (kind == h.added) break;
      offset += shapes_of(kind).size();
    }
    return offset;
  }
  [[nodiscard]] std::vector<double> values_of(const Parameter& p) const {
    std::vector<double> out;
    if (!p.scanned) {
      for (const double factor : {0.1, 0.3, 1.0, 3.0, 10.0})
        out.push_back(std::clamp(factor * p.start, p.lower, p.upper));
      return out;
    }
    // Periods of the travel: neighbours that differ by a quarter of a turn over all of it.
    double low = 1e300, high = -1e300;
    for (const Segment& s : training_) {
      low = std::min(low, s.actual.minCoeff());
      high = std::max(high, s.actual.maxCoeff());
    }
    const double travel = high - low;
    for (double turns = 2.0; turns < 250.0; turns += 0.25) {
      const double period = travel / turns;
      if (period > p.lower && period < p.upper) out.push_back(period);
    }
    return out.empty() ? std::vector{p.start} : out;
  }

  std::vector<Segment> training_;
  PoleBounds bounds_;
  std::vector<std::vector<Segment>> held_, rest_;
  std::map<std::size_t, std::vector<double>> known_;  // shapes of every kind that was tried
};

/// Every extension of a structure by one effect.
std::vector<Hypothesis> extensions(const Hypothesis& base) {
  std::vector<Hypothesis> out;
  const auto has = [&](std::size_t kind) {
    const auto& e = base.structure.effects;
    return std::find(e.begin(), e.end(), kind) != e.end();
  };
  const auto add = [&](std::size_t kind, std::size_t replaced) {
    if (has(kind) || identity_of(kind).acts != Acts::kForce) return;
    Hypothesis h;
    h.structure = base.structure;
    h.added = kind;
    auto& effects = h.structure.effects;
    const auto at = std::find(effects.begin(), effects.end(), replaced);
    if (at != effects.end()) {
      *at = kind;
    } else {
      effects.push_back(kind);
    }
    out.push_back(std::move(h));
  };
  if (has(kind_of<CoulombFriction>())) add(kind_of<Presliding>(), kind_of<CoulombFriction>());
  add(kind_of<FallingFriction>(), kEffectKinds);
  // Its Coulomb part and a constant force are one class: nothing but rest tells them apart.
  add(kind_of<AsymmetricFriction>(), kind_of<ConstantForce>());
  if (base.structure.order == 2 && !has(kind_of<AsymmetricFriction>()))
    add(kind_of<ConstantForce>(), kEffectKinds);
  add(kind_of<Cogging>(), kEffectKinds);
  add(kind_of<PositionDependentFriction>(), kEffectKinds);
  return out;
}

bool earns_its_place(const Hypothesis& before, const Hypothesis& after, std::size_t candidates,
                     double wald_p, double& z, double& p) {
  z = paired_z(before.pieces, after.pieces);
  p = 0.5 * std::erfc(z / std::sqrt(2.0));
  // Either by what the pieces say, or by the coefficients themselves, if the pieces agree.
  if (z > kAgrees) p = std::min(p, wald_p);
  return after.rms() < kWorthIt * before.rms() && p < kChance / static_cast<double>(candidates);
}

double share_beaten(const Hypothesis& best, const Hypothesis& rival) {
  const std::size_t n = std::min(best.pieces.size(), rival.pieces.size());
  const auto differences = bootstrap(n, [&](const std::vector<std::size_t>& places) {
    double sum = 0.0;
    for (const std::size_t i : places) sum += rival.pieces[i] - best.pieces[i];
    return sum;
  });
  return static_cast<double>(std::count_if(differences.begin(), differences.end(),
                                           [](double d) { return d > 0.0; })) /
         static_cast<double>(differences.size());
}

double root_mean(const std::vector<double>& pieces, const std::vector<std::size_t>& places) {
  double sum = 0.0;
  for (const std::size_t i : places) sum += pieces[i];
  return std::sqrt(sum / static_cast<double>(places.size()));
}

Gain gain_of(const Model& without, const Model& with, const std::vector<Segment>& holdout) {
  const std::vector<double> before = left_by(without, holdout), after = left_by(with, holdout);
  Gain gain;
  gain.before = judge(without, holdout).rms;
  gain.after = judge(with, holdout).rms;
  if (before.size() < 4) return gain;
  const auto differences = bootstrap(before.size(), [&](const std::vector<std::size_t>& places) {
    return root_mean(before, places) - root_mean(after, places);
  });
  gain.low = differences[static_cast<std::size_t>(0.025 * kResamples)];
  gain.high = differences[static_cast<std::size_t>(0.975 * kResamples)];
  return gain;
}

}  // namespace

std::string_view name_of(Verdict verdict) {
  switch (verdict) {
    case Verdict::kExplained:
      return "explained";
    case Verdict::kNothingSignificant:
      return "nothing_significant";
    case Verdict::kUnexplained:
      return "unexplained";
  }
  return "";
}

Diagnosis diagnose(const SegmentedAxis& axis, const IdentifyOptions& options) {
  Diagnosis out;
  const Identified identified = identify(axis, options);
  if (!identified.refusals.empty())
    throw std::runtime_error(axis.axis + ": " + identified.refusals.front());
  out.baseline = identified.record;
  const std::vector<Segment> training = cut(axis.segments, -1e300, out.baseline.training_to_s);
  const std::vector<Segment> holdout =
      cut(axis.segments, out.baseline.training_to_s + 0.5 * axis.sample_time_s, 1e300);

  Search search(training, options.bounds);
  Hypothesis current;
  current.structure.order = out.baseline.model.loop.order;
  current.structure.matched_feedforward = out.baseline.model.find(kind_of<TimeDelay>()) != nullptr;
  for (const Effect& effect : out.baseline.model.effects)
    current.structure.effects.push_back(effect.kind);
  current.model = out.baseline.model;
  if (!search.fit(current, {point_of(current.model, current.structure)}))
    throw std::runtime_error(axis.axis + ": the baseline model could not be fitted again");
  search.judge(current);
  const Hypothesis baseline = current;

  std::map<std::size_t, Cause> found;  // by kind
  while (found.size() < kMostCauses) {
    std::vector<Hypothesis> candidates = extensions(current);
    std::erase_if(candidates,
                  [&](Hypothesis& h) { return !search.fit(h, search.starts(current, h)); });
    std::sort(candidates.begin(), candidates.end(),
              [](const auto& l, const auto& r) { return l.cost < r.cost; });
    const std::size_t tried = candidates.size();
    if (candidates.size() > kJudged) candidates.resize(kJudged);
    for (Hypothesis& h : candidates) search.judge(h);
    const auto best =
        std::min_element(candidates.begin(), candidates.end(),
                         [](const auto& l, const auto& r) { return l.rms() < r.rms(); });
    Cause cause;
    if (best == candidates.end() ||
        !earns_its_place(current, *best, tried,
                         best->added == kind_of<Presliding>() ? 1.0 : search.wald_p(*best),
                         cause.statistic, cause.p))
      break;
    cause.confidence = 1.0 - cause.p;
    for (const Hypothesis& rival : candidates) {
      if (&rival == &*best) continue;
      const double beaten = share_beaten(*best, rival);
      cause.confidence = std::min(cause.confidence, beaten);
      const double gained = current.rms() - best->rms();
      if (beaten < 0.95 && current.rms() - rival.rms() > kNearlyAsGood * gained)
        cause.ambiguous_with.push_back(cause_of(rival.added));
    }
    const std::size_t added = best->added;
    current = *best;
    found[added] = cause;
    // What another one has made needless goes.
    for (std::size_t i = 0; i < current.structure.effects.size(); ++i) {
      const std::size_t kind = current.structure.effects[i];
      if (kind == added || found.find(kind) == found.end()) continue;
      Hypothesis less;
      less.structure = current.structure;
      less.structure.effects.erase(less.structure.effects.begin() + static_cast<std::ptrdiff_t>(i));
      if (!search.fit(less, {point_of(current.model, less.structure)})) continue;
      search.judge(less);
      double z = 0.0, p = 0.0;
      if (earns_its_place(less, current, tried,
                          search.wald_p({current.structure, current.point, {}, 0.0, {}, kind}), z,
                          p))
        continue;
      current = less;
      found.erase(kind);
      break;
    }
  }

  // All of them together, the free simulation driving the friction.
  const NoiseFloor floor = noise_floor(axis.segments);
  Model extended = found.empty() ? out.baseline.model : current.model;
  Eigen::MatrixXd covariance;
  if (!found.empty()) {
    if (const auto polished =
            output_error(training, current.structure, extended, {floor.encoder_step});
        polished && judge(polished->model, training).rms < judge(extended, training).rms) {
      extended = polished->model;
    }
  }
  out.extended = out.baseline;
  out.extended.model = extended;
  out.extended.method = found.empty() ? out.baseline.method : "diagnosis";
  out.extended.effect_deviations.assign(extended.effects.size(), {});
  out.extended.training = judge(extended, training);
  out.extended.holdout = judge(extended, holdout);

  // What each is worth: everything else as it is, fitted again without it.
  for (std::size_t i = 0; i < current.structure.effects.size(); ++i) {
    const std::size_t kind = current.structure.effects[i];
    const bool named = found.find(kind) != found.end();
    if (!named && (kind == kind_of<CoulombFriction>())) continue;
    Cause cause = named ? found[kind] : Cause{};
    cause.id = cause_of(kind);
    cause.place = i;
    Hypothesis without;
    without.structure = current.structure;
    auto& effects = without.structure.effects;
    if (kind == kind_of<Presliding>()) {
      effects[i] = kind_of<CoulombFriction>();
    } else {
      effects.erase(effects.begin() + static_cast<std::ptrdiff_t>(i));
    }
    if (kind == kind_of<TimeDelay>()) {
      // A loop that is fitted again would imitate it.
      Model at_once = extended;
      at_once.effects[i].shape[0] = 0.0;
      cause.gain = gain_of(at_once, extended, holdout);
      cause.statistic = paired_z(left_by(at_once, training), left_by(extended, training));
      cause.p = 0.5 * std::erfc(cause.statistic / std::sqrt(2.0));
      cause.confidence = 1.0 - cause.p;
    } else if (search.fit(without, {point_of(current.model, without.structure)})) {
      cause.gain = gain_of(without.model, extended, holdout);
      if (!named) {
        search.judge(without);
        cause.statistic = paired_z(without.pieces, current.pieces);
        cause.p = 0.5 * std::erfc(cause.statistic / std::sqrt(2.0));
        cause.confidence = 1.0 - cause.p;
      }
    }
    out.causes.push_back(std::move(cause));
  }
  std::sort(out.causes.begin(), out.causes.end(), [](const Cause& l, const Cause& r) {
    const auto worth = [](const Gain& g) { return g.before * g.before - g.after * g.after; };
    return worth(l.gain) > worth(r.gain);
  });

  std::vector<Stretch> stretches;
  for (const Segment& s : holdout)
    stretches.push_back({s.command, s.command - s.actual - simulate(extended, s), s.sample_time_s});
  out.regimes = by_regime(stretches);
  const double noise = std::isfinite(floor.rms) ? floor.rms * floor.rms : 0.0;
  const double all = out.baseline.holdout.rms * out.baseline.holdout.rms - noise;
  const double left = out.extended.holdout.rms * out.extended.holdout.rms - noise;
  out.unexplained_share = all > 0.0 ? std::clamp(left / all, 0.0, 1.0) : 0.0;
  out.fits = search.fits;
  const bool structured =
      std::isfinite(floor.rms) && out.extended.holdout.rms > kStructured * floor.rms;
  out.verdict = !out.causes.empty() ? Verdict::kExplained
                : structured        ? Verdict::kUnexplained
                                    : Verdict::kNothingSignificant;
  return out;
}

}  // namespace servotwin
