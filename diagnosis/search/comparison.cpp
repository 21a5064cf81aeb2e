#include "diagnosis/search/comparison.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <optional>

#include "diagnosis/evidence/cuts.h"
#include "diagnosis/search/change.h"
#include "diagnosis/search/conclusion.h"
#include "diagnosis/search/extension.h"
#include "diagnosis/search/gain.h"
#include "diagnosis/search/screen.h"
#include "diagnosis/search/search.h"
#include "diagnosis/search/variation.h"
#include "diagnosis/statistics/bootstrap.h"
#include "diagnosis/statistics/pieces.h"
#include "diagnosis/statistics/text.h"
#include "diagnosis/statistics/thresholds.h"
#include "identification/loop/joint.h"
#include "identification/recording/noise_floor.h"
#include "twin/shown_units.h"
#include "twin/twin.h"

namespace servotwin {

namespace {

// Share of the RMS that the earlier model had on its own data: a change that removes less may be
// its misfit and not a change of the machine.
constexpr double kEarlierMisfitShare = 0.5;
// Share of the RMS on this recording: changes are not modelled more accurately than this.
constexpr double kMinRemovedShareOfChange = 0.02;
constexpr std::size_t kMaxChangeFitsPerRound = 4;
constexpr std::size_t kMaxChanges = 6;
// Share of the best gain above which a change counts as a rival.
constexpr double kMinGainShareOfRivalChange = 0.9;

/// Every n-th sample of every segment (n = `every`).
Eigen::VectorXd thinned(const Eigen::VectorXd& all, const std::vector<Segment>& segments,
                        int every) {
  std::vector<double> out;
  Eigen::Index row = 0;
  for (const Segment& s : segments) {
    for (Eigen::Index k = 0; k < s.size(); k += every) out.push_back(all(row + k));
    row += s.size();
  }
  return Eigen::Map<Eigen::VectorXd>(out.data(), static_cast<Eigen::Index>(out.size()));
}

/// The changes that are worth fitting in addition to those in `v`, the best first.
std::vector<std::pair<Change, Screened>> promising_changes(const Variation& variation,
                                                           const Varied& v,
                                                           const DiagnoseOptions& options,
                                                           bool rotary) {
  const std::vector<std::string>& leave_out = options.leave_out;
  const std::vector<Segment>& training = variation.training();
  const Model model = v.of(variation.base());
  const int every = std::max(
      1, static_cast<int>(std::floor(kScreenStep_s / training.front().sample_time_s + 1e-9)));
  std::vector<Signals> signals;
  for (const Segment& s : training) {
    Signals all = signals_of(s);
    Model loop = model;
    std::erase_if(loop.effects,
                  [](const Effect& e) { return identity_of(e.kind).acts == Acts::kReading; });
    all.loop_position = s.command - simulate(loop, s);
    add_drive(model, all);
    signals.push_back(decimated(all, every));
  }
  const std::optional<Eigen::VectorXd> fine = variation.left(model, 0.0);
  const std::optional<Eigen::MatrixXd> derivatives = variation.derivatives(v, 0.0);
  if (!fine || !derivatives) return {};
  const Eigen::VectorXd coarse = thinned(*fine, training, every);
  Eigen::MatrixXd tangent(coarse.size(), v.values.size());
  // Derivatives of the simulated error: those of the residual with the opposite sign.
  for (Eigen::Index c = 0; c < tangent.cols(); ++c)
    tangent.col(c) = -thinned(derivatives->col(c), training, every);
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
  for (const Change& change : changes_of(variation.base())) {
    if (known(change) || left_out(change.cause)) continue;
    Varied more = v;
    more.add(change);
    const auto columns = variation.derivatives(more, 0.0, v.values.size());
    if (!columns) continue;
    Eigen::MatrixXd c(coarse.size(), columns->cols());
    for (Eigen::Index i = 0; i < c.cols(); ++i)
      c.col(i) = -thinned(columns->col(i), training, every);
    out.emplace_back(change, screen.look(c));
  }
  Channels channels(training, options.encoder_in_loop);
  channels.rotary = rotary;
  Structure structure;
  structure.order = model.loop.order;
  for (const Effect& effect : model.effects) structure.effects.push_back(effect.kind);
  for (const std::size_t kind : candidates_of(structure, {}, leave_out, channels)) {
    // A constant force and a delay are among the changes of the loop and the forces already.
    if (kind == kind_of<ConstantForce>() || !acts_along_motion(identity_of(kind).acts)) continue;
    const Screened screened = screen.look(kind);
    if (!screened.shapes.empty() || shapes_of(kind).empty())
      out.emplace_back(addition_to(model, kind, screened.shapes), screened);
  }
  std::erase_if(out, [](const auto& one) {
    return one.second.p > kMaxScreenP || one.second.gain < kMinScreenGain;
  });
  std::sort(out.begin(), out.end(),
            [](const auto& l, const auto& r) { return l.second.gain > r.second.gain; });
  return out;
}

/// Whether the changes are physically plausible. A viscous friction force of more than a few times
/// the other friction at peak speed indicates a changed servo loop instead.
bool plausible(const Variation& variation, const Varied& v) {
  // Limit of the viscous force at peak speed: this multiple of the other friction plus an offset.
  constexpr double kMaxOverFriction = 3.0, kOffset_mps2 = 0.5;
  double speed = 0.0;
  for (const Segment& s : variation.training()) {
    const Eigen::Index n = s.size() - 1;
    speed =
        std::max(speed, (s.command.tail(n) - s.command.head(n)).abs().maxCoeff() / s.sample_time_s);
  }
  double level = 0.0;
  const Model model = v.of(variation.base());
  for (const std::size_t kind : friction_kinds()) {
    if (const Effect* effect = model.find(kind); effect != nullptr)
      level = std::max(level, std::abs(level_of(*effect)));
  }
  Eigen::Index at = 0;
  for (const Change& change : v.changes) {
    for (const ChangedQuantity& quantity : change.quantities) {
      const double value = v.values(at++);
      if (quantity.unit == "1/s" && change.cause != "gain_change" &&
          std::abs(value) * speed > kMaxOverFriction * level + kOffset_mps2)
        return false;
    }
  }
  return true;
}

/// Share of bootstrap resamples in which the squared error of `rival` exceeds that of `best` by
/// more than `own`^2. `own`: misfit [m | rad] that the earlier model already had on its own data.
double share_won(const Varied& best, const Varied& rival, double own) {
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

/// How sure a change is.
struct EvidenceOfChange {
  double z = 0.0, p = 1.0, wins = 1.0;
  std::vector<std::string> ambiguous_with;
};

/// The changes accepted so far and one more.
struct TriedChange {
  Varied varied;
  EvidenceOfChange evidence;
};

/// Adds changes to an earlier model one by one, as long as each lowers the error enough.
class ChangeSelection {
 public:
  /// `variation` must outlive it. `own`: misfit [m | rad] that the earlier model already had on its
  /// own data, which is neither a change nor evidence for one.
  ChangeSelection(const Variation& variation, Varied unchanged, double own, bool rotary,
                  const DiagnoseOptions& options)
      : variation_(variation),
        current_(std::move(unchanged)),
        own_(own),
        least_(std::max(own, kMinRemovedShareOfChange * rms_of(current_.pieces))),
        rotary_(rotary),
        options_(options) {}

  void run() {
    for (std::size_t round = 0; round < kMaxChanges; ++round) {
      options_.begin("what has changed");
      std::vector<TriedChange> tried = tried_changes();
      if (tried.empty()) return;
      TriedChange chosen = chosen_of(tried);
      steps.push_back("  " + chosen.varied.changes.back().cause + ": added");
      current_ = std::move(chosen.varied);
      evidence.push_back(std::move(chosen.evidence));
      remove_unnecessary();
    }
  }
  [[nodiscard]] const Varied& current() const { return current_; }

  std::vector<EvidenceOfChange> evidence;  ///< of every change
  std::vector<std::string> steps;          ///< as text
  int fits = 0;

 private:
  /// The error as the steps show it.
  [[nodiscard]] std::string size_of(const Varied& v) const {
    return micro_text(rms_of(v.pieces), rotary_);
  }

  /// The most promising changes that pass, each fitted beside the present ones.
  [[nodiscard]] std::vector<TriedChange> tried_changes() {
    auto promising = promising_changes(variation_, current_, options_, rotary_);
    const std::size_t candidates = changes_of(variation_.base()).size() + kEffectKinds;
    if (promising.size() > kMaxChangeFitsPerRound) promising.resize(kMaxChangeFitsPerRound);
    std::string step = text("%s RMS, promising candidates:", size_of(current_).c_str());
    for (const auto& [change, s] : promising)
      step += text(" %s/%s (%.1f %%, p %.1g)", change.cause.c_str(),
                   change.quantities.front().name.c_str(), 100.0 * s.gain, s.p);
    steps.push_back(promising.empty() ? step + " none" : step);
    std::vector<TriedChange> tried;
    for (const auto& [change, screened] : promising) {
      TriedChange one{current_, {}};
      one.varied.add(change);
      ++fits;
      if (!variation_.fit(one.varied)) continue;
      one.evidence.z = paired_z(current_.pieces, one.varied.pieces);
      one.evidence.p = 0.5 * std::erfc(one.evidence.z / std::sqrt(2.0));
      // Passes the paired block test, or the score test if the blocks do not contradict it.
      if (one.evidence.z > kMinBlockZ) one.evidence.p = std::min(one.evidence.p, screened.p);
      steps.push_back(text("  with %s: %s RMS, z %.1f", change.cause.c_str(),
                           size_of(one.varied).c_str(), one.evidence.z));
      if (rms_of(one.varied.pieces) < kMaxRmsRatioToAdd * rms_of(current_.pieces) &&
          removed_rms(current_.pieces, one.varied.pieces) > least_ &&
          plausible(variation_, one.varied) &&
          one.evidence.p < kFalseAlarmRate / static_cast<double>(candidates))
        tried.push_back(std::move(one));
    }
    return tried;
  }

  /// The best of them, with its rivals.
  [[nodiscard]] TriedChange chosen_of(std::vector<TriedChange>& tried) const {
    std::sort(tried.begin(), tried.end(), [](const TriedChange& l, const TriedChange& r) {
      return l.varied.cost < r.varied.cost;
    });
    // Of two changes that the blocks do not distinguish, prefer the one with fewer parameters.
    std::size_t best = 0;
    for (std::size_t i = 1; i < tried.size(); ++i) {
      if (tried[i].varied.values.size() < tried[best].varied.values.size() &&
          share_won(tried[best].varied, tried[i].varied, own_) < kMinShareToExcludeRival)
        best = i;
    }
    const double before = rms_of(current_.pieces);
    TriedChange chosen = tried[best];
    EvidenceOfChange& evidence_of = chosen.evidence;
    for (std::size_t i = 0; i < tried.size(); ++i) {
      if (i == best) continue;
      const double wins = share_won(chosen.varied, tried[i].varied, own_);
      const std::string& rival = tried[i].varied.changes.back().cause;
      if (rival == chosen.varied.changes.back().cause) continue;
      const bool as_good = before - rms_of(tried[i].varied.pieces) >
                           kMinGainShareOfRivalChange * (before - rms_of(chosen.varied.pieces));
      auto& rivals = evidence_of.ambiguous_with;
      if (wins < kMinShareToExcludeRival && as_good) {
        if (std::find(rivals.begin(), rivals.end(), rival) == rivals.end()) rivals.push_back(rival);
      } else {
        evidence_of.wins = std::min(evidence_of.wins, wins);
      }
    }
    // With n ambiguous rivals each of the n + 1 changes is equally likely.
    evidence_of.wins = std::min(
        evidence_of.wins, 1.0 / (1.0 + static_cast<double>(evidence_of.ambiguous_with.size())));
    evidence_of.wins = std::min(evidence_of.wins, 1.0 - evidence_of.p);
    return chosen;
  }

  /// Removes earlier changes that the newest one has made unnecessary.
  void remove_unnecessary() {
    for (std::size_t i = 0; i + 1 < current_.changes.size();) {
      Varied less =
          current_.without([&](const Change& change) { return &change == &current_.changes[i]; });
      ++fits;
      if (!variation_.fit(less) ||
          rms_of(current_.pieces) < kMaxRmsRatioToAdd * rms_of(less.pieces)) {
        ++i;
        continue;
      }
      steps.push_back("  " + current_.changes[i].cause + ": no longer needed, removed");
      current_ = std::move(less);
      evidence.erase(evidence.begin() + static_cast<std::ptrdiff_t>(i));
    }
  }

  const Variation& variation_;
  Varied current_;
  double own_, least_;  // least_: error that a change must remove [m | rad]
  bool rotary_;
  const DiagnoseOptions& options_;
};

/// Throws where model and recording are not of the same axis.
void check(const SegmentedAxis& axis, const ModelRecord& earlier) {
  if (earlier.axis != axis.axis)
    throw std::runtime_error("the model is of axis " + earlier.axis + ", the recording of axis " +
                             axis.axis + "; a comparison needs a model of the same axis");
  if (earlier.rotary != axis.rotary)
    throw std::runtime_error(axis.axis + ": the model is of a " +
                             (earlier.rotary ? "rotary" : "linear") + " axis, the recording of a " +
                             (axis.rotary ? "rotary" : "linear") + " one");
}

/// Places the change of an effect in the extended model, with the deviations of its values.
void place_effect(const Change& change, const Eigen::Ref<const Eigen::VectorXd>& deviations,
                  ModelRecord& extended, Cause& cause) {
  auto& effects = extended.model.effects;
  cause.place = static_cast<std::size_t>(
      std::find_if(effects.begin(), effects.end(),
                   [&](const Effect& e) { return e.kind == change.kind; }) -
      effects.begin());
  EffectDeviations& of_effect = extended.effect_deviations[cause.place];
  const auto note = [&](const auto& parameters, auto& into, std::size_t q) {
    for (std::size_t k = 0; k < parameters.size(); ++k) {
      if (parameters[k].name == change.quantities[q].name)
        into[k] = deviations(static_cast<Eigen::Index>(q));
    }
  };
  for (std::size_t q = 0; q < change.quantities.size(); ++q) {
    note(coefficients_of(change.kind), of_effect.coefficient, q);
    note(shapes_of(change.kind), of_effect.shape, q);
  }
}

/// The causes that the changes are evidence for; fills in the deviations of `extended`.
std::vector<Cause> causes_of(const Varied& changed, const std::vector<EvidenceOfChange>& evidence,
                             const Eigen::VectorXd& deviations, ModelRecord& extended) {
  std::vector<Cause> out;
  Eigen::Index at = 0;
  for (std::size_t i = 0; i < changed.changes.size(); ++i) {
    const Change& change = changed.changes[i];
    auto cause =
        std::find_if(out.begin(), out.end(), [&](const Cause& c) { return c.id == change.cause; });
    if (cause == out.end()) {
      cause = out.insert(cause, Cause{});
      cause->id = change.cause;
      cause->place = kNoEffect;
      cause->statistic = evidence[i].z;
      cause->p = evidence[i].p;
      cause->wins = evidence[i].wins;
      cause->ambiguous_with = evidence[i].ambiguous_with;
    }
    const auto count = static_cast<Eigen::Index>(change.quantities.size());
    if (change.kind < kEffectKinds) {
      place_effect(change, deviations.segment(at, count), extended, *cause);
    } else {
      const ChangedQuantity& quantity = change.quantities.front();
      const double before = quantity.relative ? 1.0 : 0.0;
      cause->moved.push_back(
          {quantity.name, quantity.unit, before, before + changed.values(at), deviations(at)});
    }
    at += count;
  }
  return out;
}

}  // namespace

Diagnosis compare(const SegmentedAxis& axis, const ModelRecord& earlier,
                  const DiagnoseOptions& options) {
  require_encoder(axis);
  check(axis, earlier);
  ModelRecord discretised = earlier;
  discretised.model.sample_time_s = axis.sample_time_s;
  if (const std::string why = why_invalid(discretised.model); !why.empty())
    throw std::runtime_error(axis.axis + ": the earlier model cannot be used: " + why);
  Diagnosis out;
  out.against_earlier = true;
  out.baseline = discretised;
  out.earlier_rms = earlier.holdout.rms;
  const NoiseFloor floor = noise_floor(axis.segments);
  out.baseline.noise_floor = floor;
  std::vector<Segment> segments = axis.segments;
  std::vector<Eigen::ArrayXd> residuals;
  for (const Segment& s : segments)
    residuals.emplace_back(s.command - s.actual - simulate(out.baseline.model, s));
  find_cuts(segments, residuals);
  const auto [training, rest] =
      split(segments, options.identify.training_share.value_or(training_share_of(segments)));
  if (training.empty() || rest.empty())
    throw std::runtime_error(
        axis.axis + ": the recording is too short to divide into training data and hold-out");
  out.baseline.motion = motion_range(segments);
  out.baseline.from_s = segments.front().start_s;
  out.baseline.to_s = segments.back().end_s();
  out.baseline.training_to_s = training.back().end_s();
  const Variation variation(out.baseline.model, training);
  const std::vector<Segment> holdout = with_lead_in(rest, segments);
  out.baseline.holdout = judge(out.baseline.model, holdout);

  Varied unchanged;
  if (!variation.fit(unchanged))
    throw std::runtime_error(axis.axis + ": the earlier model cannot be simulated at " +
                             text("%g s", axis.sample_time_s));
  const double own = std::isfinite(out.earlier_rms) ? kEarlierMisfitShare * out.earlier_rms : 0.0;
  ChangeSelection selection(variation, std::move(unchanged), own, axis.rotary, options);
  selection.run();
  out.steps = std::move(selection.steps);
  out.fits = selection.fits;
  Varied current = selection.current();
  if (!(judge(current.of(variation.base()), holdout).rms < out.baseline.holdout.rms)) {
    if (!current.changes.empty())
      out.steps.emplace_back("the changes do not lower the error on held-out data: discarded");
    current = Varied{};
  }
  out.extended = out.baseline;
  if (!current.changes.empty())
    set_extended(out.extended, "comparison", current.of(variation.base()), variation.training(),
                 holdout);
  out.causes = causes_of(current, selection.evidence, variation.deviations(current), out.extended);
  for (Cause& cause : out.causes) {
    const auto same = [&](const Change& change) { return change.cause == cause.id; };
    Varied less = current.without(same);
    if (variation.fit(less)) {
      cause.without = less.of(variation.base());
      cause.gain = gain_of(*cause.without, out.extended.model, holdout);
      cause.worth = worth_of(cause.gain);
    }
    judge_repair(out.extended.model, current.without(same).of(variation.base()), holdout,
                 cause.gain);
  }
  conclude(out, axis, holdout, floor, options);
  return out;
}

}  // namespace servotwin
