#include "diagnosis/comparison.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <optional>

#include "diagnosis/bootstrap.h"
#include "diagnosis/change.h"
#include "diagnosis/cuts.h"
#include "diagnosis/extension.h"
#include "diagnosis/gain.h"
#include "diagnosis/screen.h"
#include "diagnosis/search.h"
#include "diagnosis/text.h"
#include "identification/joint.h"
#include "identification/noise_floor.h"
#include "twin/twin.h"

namespace servotwin {

namespace {

constexpr double kWorthIt = 0.98;     // a change must bring the error below this
constexpr double kOwn = 0.5;          // of the earlier model's error: less is not the machine's
constexpr double kIsRight = 0.02;     // of the error: less is what a change is not modelled to
constexpr double kAgrees = 1.64;      // z of the pieces that does not contradict
constexpr double kChance = 0.01;      // false changes of a machine that did not change
constexpr double kPromising = 0.05;   // p of a change that is worth fitting
constexpr double kLeastGain = 0.004;  // of squared error, likewise
constexpr std::size_t kTried = 4;     // changes of a round that are fitted
constexpr std::size_t kMostChanges = 6;
constexpr double kDecisive = 0.95;     // share of resamples in which a rival is beaten
constexpr double kNearlyAsGood = 0.9;  // share of the gain that makes a rival
constexpr double kSettle_s = 0.25;     // of every stretch
constexpr double kCoarse_s = 2e-3;     // step of the data that changes are screened on
constexpr double kPiece_s = 0.25;      // that errors are summed over
constexpr int kRounds = 12;            // of a fit
constexpr double kEnough = 1e-4;       // relative decrease that ends it

/// The earlier model with changes, and their values.
struct Varied {
  std::vector<Change> changes;
  Eigen::VectorXd values;
  double cost = 1e300;  ///< mean square on the training data
  std::vector<double> pieces;

  void add(const Change& change) {
    const Eigen::Index n = values.size(),
                       more = static_cast<Eigen::Index>(change.quantities.size());
    values.conservativeResize(n + more);
    for (Eigen::Index i = 0; i < more; ++i)
      values(n + i) = change.quantities[static_cast<std::size_t>(i)].start;
    changes.push_back(change);
  }
  /// Without the changes for which this holds.
  template <class Which>
  [[nodiscard]] Varied without(const Which& which) const {
    Varied out;
    Eigen::Index at = 0;
    for (const Change& change : changes) {
      const auto count = static_cast<Eigen::Index>(change.quantities.size());
      if (!which(change)) {
        out.add(change);
        out.values.tail(count) = values.segment(at, count);
      }
      at += count;
    }
    return out;
  }
  /// Without the change at this place.
  [[nodiscard]] Varied without(std::size_t place) const {
    return without([&](const Change& change) { return &change == &changes[place]; });
  }
  [[nodiscard]] Model model(const Model& earlier, const Eigen::VectorXd& at) const {
    Model out = earlier;
    Eigen::Index i = 0;
    for (const Change& change : changes) {
      const std::size_t count = change.quantities.size();
      change.apply(out, {at.data() + i, count});
      i += static_cast<Eigen::Index>(count);
    }
    return out;
  }
  [[nodiscard]] Model model(const Model& earlier) const { return model(earlier, values); }
  [[nodiscard]] double step(Eigen::Index i) const {
    for (const Change& change : changes) {
      const auto count = static_cast<Eigen::Index>(change.quantities.size());
      if (i < count) return change.quantities[static_cast<std::size_t>(i)].step;
      i -= count;
    }
    return 0.0;
  }
};

class Comparison {
 public:
  Comparison(const Model& earlier, std::vector<Segment> training, const NoiseFloor& floor)
      : earlier_(earlier), training_(std::move(training)), floor_(floor) {}

  /// Levenberg-Marquardt in free simulation.
  [[nodiscard]] bool fit(Varied& v) const {
    std::optional<Eigen::VectorXd> r = left(v.model(earlier_));
    if (!r) return false;
    v.cost = r->squaredNorm();
    double damping = 1e-6;
    for (int round = 0; round < kRounds && v.values.size() > 0; ++round) {
      const std::optional<Eigen::MatrixXd> j = jacobian(v, *r);
      if (!j) return false;
      const Eigen::MatrixXd gram = j->transpose() * *j;
      const Eigen::VectorXd gradient = j->transpose() * *r;
      double gained = 0.0;
      for (int attempt = 0; attempt < 6; ++attempt, damping *= 30.0) {
        Eigen::MatrixXd damped = gram;
        damped.diagonal() += damping * gram.diagonal().cwiseMax(1e-300);
        const Eigen::VectorXd trial = v.values - damped.ldlt().solve(gradient);
        const std::optional<Eigen::VectorXd> there = left(v.model(earlier_, trial));
        if (!there || there->squaredNorm() >= v.cost) continue;
        gained = 1.0 - there->squaredNorm() / v.cost;
        v.values = trial, v.cost = there->squaredNorm(), r = there;
        damping = std::max(1e-9, damping * 0.1);
        break;
      }
      if (gained < kEnough) break;
    }
    v.pieces = left_by(v.model(earlier_), training_);
    return true;
  }

  /// Standard deviations of the values, robust against correlated residuals (sums over pieces).
  [[nodiscard]] Eigen::VectorXd deviations(const Varied& v) const {
    const Eigen::Index n = v.values.size();
    const std::optional<Eigen::VectorXd> r = left(v.model(earlier_));
    const std::optional<Eigen::MatrixXd> j = r ? jacobian(v, *r) : std::nullopt;
    if (!j) return Eigen::VectorXd::Constant(n, kAbsent);
    const auto piece =
        static_cast<Eigen::Index>(std::lround(kPiece_s / training_.front().sample_time_s));
    Eigen::MatrixXd scores = Eigen::MatrixXd::Zero(n, n);
    for (Eigen::Index k = 0; k < r->size(); k += piece) {
      const Eigen::Index count = std::min(piece, r->size() - k);
      const Eigen::VectorXd s = j->middleRows(k, count).transpose() * r->segment(k, count);
      scores += s * s.transpose();
    }
    const Eigen::MatrixXd inverse =
        (j->transpose() * *j).ldlt().solve(Eigen::MatrixXd::Identity(n, n));
    return (inverse * scores * inverse).diagonal().cwiseMax(0.0).cwiseSqrt();
  }

  /// What could be added to this, the best first.
  [[nodiscard]] std::vector<std::pair<Change, Screened>> promising(
      const Varied& v, const std::vector<std::string>& leave_out) const {
    const Model model = v.model(earlier_);
    const int every = std::max(
        1, static_cast<int>(std::floor(kCoarse_s / training_.front().sample_time_s + 1e-9)));
    std::vector<Signals> signals;
    for (const Segment& s : training_) {
      Signals all = signals_of(s);
      Model loop = model;
      std::erase_if(loop.effects,
                    [](const Effect& e) { return identity_of(e.kind).acts == Acts::kReading; });
      all.loop_position = s.command - simulate(loop, s);
      signals.push_back(decimated(all, every));
    }
    const std::optional<Eigen::VectorXd> fine = left(model, 0.0);
    if (!fine) return {};
    const Eigen::VectorXd coarse = thinned(*fine, every);
    const std::optional<Eigen::MatrixXd> derivatives = jacobian(v, *fine, 0.0);
    if (!derivatives) return {};
    Eigen::MatrixXd tangent(coarse.size(), v.values.size());
    // What is simulated grows as what is left falls.
    for (Eigen::Index c = 0; c < tangent.cols(); ++c)
      tangent.col(c) = -thinned(derivatives->col(c), every);
    const Screen screen(signals, model, coarse, std::move(tangent));

    const auto left_out = [&](const std::string& cause) {
      return std::find(leave_out.begin(), leave_out.end(), cause) != leave_out.end();
    };
    const auto known = [&](const Change& change) {
      return std::any_of(v.changes.begin(), v.changes.end(), [&](const Change& other) {
        return other.cause == change.cause &&
               other.quantities.front().name == change.quantities.front().name;
      });
    };
    std::vector<std::pair<Change, Screened>> out;
    for (const Change& change : changes_of(earlier_)) {
      if (known(change) || left_out(change.cause)) continue;
      Varied more = v;
      more.add(change);
      const std::optional<Eigen::VectorXd> there = left(more.model(earlier_), 0.0);
      if (!there) continue;
      const Eigen::Index added = static_cast<Eigen::Index>(change.quantities.size());
      const std::optional<Eigen::MatrixXd> columns = jacobian(more, *there, 0.0, v.values.size());
      if (!columns) continue;
      Eigen::MatrixXd c(coarse.size(), added);
      for (Eigen::Index i = 0; i < added; ++i) c.col(i) = -thinned(columns->col(i), every);
      out.emplace_back(change, screen.look(c));
    }
    const Channels channels(training_);
    Structure structure;
    structure.order = model.loop.order;
    for (const Effect& effect : model.effects) structure.effects.push_back(effect.kind);
    for (const std::size_t kind : candidates_of(structure, {}, leave_out, channels)) {
      // There all the time, they are changes of the loop and the forces.
      if (kind == kind_of<ConstantForce>() || identity_of(kind).acts == Acts::kCommandDelay)
        continue;
      const Screened screened = screen.look(kind);
      if (!screened.shapes.empty() || shapes_of(kind).empty())
        out.emplace_back(addition_to(model, kind, screened.shapes), screened);
    }
    std::erase_if(out, [](const auto& one) {
      return one.second.p > kPromising || one.second.gain < kLeastGain;
    });
    std::sort(out.begin(), out.end(),
              [](const auto& l, const auto& r) { return l.second.gain > r.second.gain; });
    return out;
  }

  /// Viscous friction that holds against the peak speed more than a few times the rest of the
  /// friction is a servo loop that has changed.
  [[nodiscard]] bool plausible(const Varied& v) const {
    constexpr double kMost = 3.0, kLittle_mps2 = 0.5;
    double speed = 0.0;
    for (const Segment& s : training_) {
      const Eigen::Index n = s.size() - 1;
      speed = std::max(speed,
                       (s.command.tail(n) - s.command.head(n)).abs().maxCoeff() / s.sample_time_s);
    }
    double level = 0.0;
    const Model model = v.model(earlier_);
    for (const std::size_t kind : friction_kinds()) {
      if (const Effect* effect = model.find(kind); effect != nullptr)
        level = std::max(level, std::abs(effect->coefficient[0]));
    }
    Eigen::Index at = 0;
    for (const Change& change : v.changes) {
      for (const Quantity& quantity : change.quantities) {
        const double value = v.values(at++);
        if (quantity.unit == "1/s" && change.cause != "gain_change" &&
            std::abs(value) * speed > kMost * level + kLittle_mps2)
          return false;
      }
    }
    return true;
  }

  [[nodiscard]] const std::vector<Segment>& training() const { return training_; }
  [[nodiscard]] const Model& earlier() const { return earlier_; }

 private:
  static Eigen::VectorXd thinned(const Eigen::VectorXd& all, int every) {
    const Eigen::Index n = (all.size() + every - 1) / every;
    Eigen::VectorXd out(n);
    for (Eigen::Index k = 0; k < n; ++k) out(k) = all(k * every);
    return out;
  }

  /// Measured minus simulated, one value per sample; 0 for the settling of every segment.
  [[nodiscard]] std::optional<Eigen::VectorXd> left(const Model& model,
                                                    double settle_s = kSettle_s) const {
    if (!why_invalid(model).empty()) return std::nullopt;
    Eigen::Index rows = 0, row = 0;
    for (const Segment& s : training_) rows += s.size();
    Eigen::VectorXd out = Eigen::VectorXd::Zero(rows);
    for (const Segment& s : training_) {
      const auto settle = std::min<Eigen::Index>(
          s.size(),
          std::max(s.lead, static_cast<Eigen::Index>(std::lround(settle_s / s.sample_time_s))));
      const Eigen::Index n = s.size() - settle;
      out.segment(row + settle, n) = (s.command - s.actual - simulate(model, s)).tail(n).matrix();
      row += s.size();
    }
    if (!out.allFinite()) return std::nullopt;
    return out;
  }

  [[nodiscard]] std::optional<Eigen::MatrixXd> jacobian(const Varied& v, const Eigen::VectorXd& r,
                                                        double settle_s = kSettle_s,
                                                        Eigen::Index first = 0) const {
    Eigen::MatrixXd out(r.size(), v.values.size() - first);
    for (Eigen::Index i = first; i < v.values.size(); ++i) {
      Eigen::VectorXd moved = v.values;
      moved(i) += v.step(i);
      std::optional<Eigen::VectorXd> there = left(v.model(earlier_, moved), settle_s);
      if (!there) {
        moved(i) -= 2.0 * v.step(i);
        there = left(v.model(earlier_, moved), settle_s);
      }
      if (!there) return std::nullopt;
      out.col(i - first) = (*there - r) / (moved(i) - v.values(i));
    }
    return out;
  }

  const Model& earlier_;
  std::vector<Segment> training_;
  NoiseFloor floor_;
};

double rms(const std::vector<double>& pieces) {
  double sum = 0.0;
  for (const double piece : pieces) sum += piece;
  return std::sqrt(sum / std::max<double>(1.0, static_cast<double>(pieces.size())));
}

/// The error that a change takes away, in quadrature.
double taken(const std::vector<double>& before, const std::vector<double>& after) {
  return std::sqrt(std::max(0.0, rms(before) * rms(before) - rms(after) * rms(after)));
}

/// `own`: the error [m | rad] that the earlier model makes of itself.
double share_beaten(const Varied& best, const Varied& rival, double own) {
  const auto differences =
      bootstrap(best.pieces.size(), [&](const std::vector<std::size_t>& places) {
        double sum = 0.0;
        for (const std::size_t i : places) sum += rival.pieces[i] - best.pieces[i];
        return sum / static_cast<double>(places.size()) - own * own;
      });
  return static_cast<double>(std::count_if(differences.begin(), differences.end(),
                                           [](double d) { return d > 0.0; })) /
         static_cast<double>(differences.size());
}

}  // namespace

Diagnosis compare(const SegmentedAxis& axis, const ModelRecord& earlier,
                  const DiagnoseOptions& options) {
  if (earlier.axis != axis.axis)
    throw std::runtime_error("the model is of axis " + earlier.axis + ", the recording of axis " +
                             axis.axis + "; a comparison needs a model of the same axis");
  if (earlier.rotary != axis.rotary)
    throw std::runtime_error(axis.axis + ": the model is of a " +
                             (earlier.rotary ? "rotary" : "linear") + " axis, the recording of a " +
                             (axis.rotary ? "rotary" : "linear") + " one");
  Diagnosis out;
  out.against_earlier = true;
  out.baseline = earlier;
  out.earlier_rms = earlier.holdout.rms;
  const NoiseFloor floor = noise_floor(axis.segments);
  out.baseline.noise_floor_rms = floor.rms;
  out.baseline.model.sample_time_s = axis.sample_time_s;
  std::vector<Segment> segments = axis.segments;
  std::vector<Eigen::ArrayXd> residuals;
  for (const Segment& s : segments)
    residuals.emplace_back(s.command - s.actual - simulate(out.baseline.model, s));
  find_cuts(segments, residuals);
  const auto [training, holdout] = split(segments, options.identify.training_share);
  if (training.empty() || holdout.empty())
    throw std::runtime_error(axis.axis + ": too short to fit a part and to judge by the rest");
  out.baseline.from_s = segments.front().start_s;
  out.baseline.to_s = segments.back().end_s();
  out.baseline.training_to_s = training.back().end_s();
  const Comparison comparison(out.baseline.model, training, floor);
  out.baseline.holdout = judge(out.baseline.model, holdout);

  Varied current;
  if (!comparison.fit(current))
    throw std::runtime_error(axis.axis + ": the earlier model cannot be simulated at " +
                             text("%g s", axis.sample_time_s));
  struct Evidence {
    double z = 0.0, p = 1.0, confidence = 1.0;
    std::vector<std::string> ambiguous_with;
  };
  std::vector<Evidence> evidence;
  // What the earlier model was wrong by where it was identified is no change, nor does it tell two
  // changes apart.
  const double own = std::isfinite(out.earlier_rms) ? kOwn * out.earlier_rms : 0.0;
  const double least = std::max(own, kIsRight * rms(current.pieces));
  while (current.changes.size() < kMostChanges) {
    auto promising = comparison.promising(current, options.leave_out);
    const std::size_t candidates = changes_of(comparison.earlier()).size() + kEffectKinds;
    if (promising.size() > kTried) promising.resize(kTried);
    std::string step = text("%.4g um, promising:", 1e6 * rms(current.pieces));
    for (const auto& [change, s] : promising)
      step += text(" %s/%s (%.1f %%, p %.1g)", change.cause.c_str(),
                   change.quantities.front().name.c_str(), 100.0 * s.gain, s.p);
    out.steps.push_back(promising.empty() ? step + " nothing" : step);
    struct Tried {
      Varied varied;
      Evidence evidence;
    };
    std::vector<Tried> tried;
    for (const auto& [change, screened] : promising) {
      Tried one{current, {}};
      one.varied.add(change);
      ++out.fits;
      if (!comparison.fit(one.varied)) continue;
      one.evidence.z = paired_z(current.pieces, one.varied.pieces);
      one.evidence.p = 0.5 * std::erfc(one.evidence.z / std::sqrt(2.0));
      // By what the pieces say, or by the coefficients themselves, if the pieces agree.
      if (one.evidence.z > kAgrees) one.evidence.p = std::min(one.evidence.p, screened.p);
      out.steps.push_back(text("  with %s %.4g um, z %.1f", change.cause.c_str(),
                               1e6 * rms(one.varied.pieces), one.evidence.z));
      if (rms(one.varied.pieces) < kWorthIt * rms(current.pieces) &&
          taken(current.pieces, one.varied.pieces) > least && comparison.plausible(one.varied) &&
          one.evidence.p < kChance / static_cast<double>(candidates))
        tried.push_back(std::move(one));
    }
    if (tried.empty()) break;
    std::sort(tried.begin(), tried.end(),
              [](const Tried& l, const Tried& r) { return l.varied.cost < r.varied.cost; });
    // Of two that the pieces cannot tell apart, the one that needs less.
    std::size_t best = 0;
    for (std::size_t i = 1; i < tried.size(); ++i) {
      if (tried[i].varied.values.size() < tried[best].varied.values.size() &&
          share_beaten(tried[best].varied, tried[i].varied, own) < kDecisive)
        best = i;
    }
    const double before = rms(current.pieces);
    Tried chosen = tried[best];
    for (std::size_t i = 0; i < tried.size(); ++i) {
      if (i == best) continue;
      const double beaten = share_beaten(chosen.varied, tried[i].varied, own);
      const std::string& rival = tried[i].varied.changes.back().cause;
      if (rival == chosen.varied.changes.back().cause) continue;
      chosen.evidence.confidence = std::min(chosen.evidence.confidence, beaten);
      if (beaten < kDecisive && before - rms(tried[i].varied.pieces) >
                                    kNearlyAsGood * (before - rms(chosen.varied.pieces)))
        chosen.evidence.ambiguous_with.push_back(rival);
    }
    chosen.evidence.confidence = std::min(chosen.evidence.confidence, 1.0 - chosen.evidence.p);
    out.steps.push_back("  " + chosen.varied.changes.back().cause + ": added");
    current = std::move(chosen.varied);
    evidence.push_back(std::move(chosen.evidence));
    // What the new one made needless goes.
    for (std::size_t i = 0; i + 1 < current.changes.size();) {
      Varied less = current.without(i);
      ++out.fits;
      if (!comparison.fit(less) || rms(current.pieces) < kWorthIt * rms(less.pieces)) {
        ++i;
        continue;
      }
      out.steps.push_back("  " + current.changes[i].cause + ": needless");
      current = std::move(less);
      evidence.erase(evidence.begin() + static_cast<std::ptrdiff_t>(i));
    }
  }

  out.extended = out.baseline;
  if (!current.changes.empty()) {
    out.extended.model = current.model(comparison.earlier());
    out.extended.method = "comparison";
    out.extended.training = judge(out.extended.model, comparison.training());
    out.extended.holdout = judge(out.extended.model, holdout);
    out.extended.effect_deviations.assign(out.extended.model.effects.size(), {});
    out.extended.denominator_deviation.fill(kAbsent);
    out.extended.numerator_deviation.fill(kAbsent);
    out.extended.pole_deviation = {kAbsent, kAbsent, kAbsent};
  }
  const Eigen::VectorXd deviations = comparison.deviations(current);
  for (std::size_t i = 0, at = 0; i < current.changes.size(); ++i) {
    const Change& change = current.changes[i];
    auto cause = std::find_if(out.causes.begin(), out.causes.end(),
                              [&](const Cause& c) { return c.id == change.cause; });
    if (cause == out.causes.end()) {
      cause = out.causes.insert(cause, Cause{});
      cause->id = change.cause;
      cause->place = kNoEffect;
      cause->statistic = evidence[i].z;
      cause->p = evidence[i].p;
      cause->confidence = evidence[i].confidence;
      cause->ambiguous_with = evidence[i].ambiguous_with;
    }
    const std::size_t count = change.quantities.size();
    if (change.kind < kEffectKinds) {
      auto& effects = out.extended.model.effects;
      cause->place = static_cast<std::size_t>(
          std::find_if(effects.begin(), effects.end(),
                       [&](const Effect& e) { return e.kind == change.kind; }) -
          effects.begin());
      EffectDeviations& of_effect = out.extended.effect_deviations[cause->place];
      const std::size_t coefficients = coefficients_of(change.kind).size();
      for (std::size_t q = 0; q < count; ++q)
        (q < coefficients ? of_effect.coefficient[q] : of_effect.shape[q - coefficients]) =
            deviations(static_cast<Eigen::Index>(at + q));
    } else {
      const Quantity& quantity = change.quantities.front();
      const auto first = static_cast<Eigen::Index>(at);
      const double before = quantity.relative ? 1.0 : 0.0;
      cause->moved.push_back({quantity.name, quantity.unit, before, before + current.values(first),
                              deviations(first)});
    }
    at += count;
  }
  for (Cause& cause : out.causes) {
    const auto same = [&](const Change& change) { return change.cause == cause.id; };
    Varied less = current.without(same);
    if (comparison.fit(less))
      cause.gain = gain_of(less.model(comparison.earlier()), out.extended.model, holdout);
    cause.gain.tracking_now = tracking_rms(out.extended.model, holdout);
    cause.gain.tracking_repaired =
        tracking_rms(current.without(same).model(comparison.earlier()), holdout);
  }
  conclude(out, holdout, floor);
  return out;
}

}  // namespace servotwin
