#include "diagnosis/torque/torque.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <numbers>
#include <stdexcept>

#include "diagnosis/search/extension.h"
#include "diagnosis/search/hypothesis.h"
#include "diagnosis/statistics/bootstrap.h"
#include "diagnosis/statistics/thresholds.h"
#include "diagnosis/torque/torque_band.h"
#include "diagnosis/torque/torque_selection.h"
#include "identification/torque/torque_limit.h"

namespace servotwin {

namespace {

// A rival that loses in a smaller share of the bootstrap resamples is reported as ambiguous.
// Length of the resampled blocks; shorter in a short hold-out, so that there are at least
// kMinBlocks.
constexpr double kBlock_s = 0.25;
constexpr double kMinBlocks = 10.0;

// Share of the causes that are there, of those that leave nothing of the residual, and how much
// lower it is where a cause leaves all of it. Fitted to machines of the development part, to which
// losses of 0.55 to 0.75 fit about as well. Laws of friction, which nearly every axis has, are
// there whatever they leave (docs/measurements.md 10.5).
constexpr double kHitRate = 0.97, kHitRateLoss = 0.6;

double rms_of_rows(const Eigen::VectorXd& left) {
  return std::sqrt(left.squaredNorm() / std::max<double>(1.0, static_cast<double>(left.size())));
}

/// RMS of the white part, from third differences: motion and its friction are much slower, noise
/// that the drive has filtered is underestimated.
double white_part_of(const Eigen::VectorXd& left) {
  const Eigen::Index n = left.size() - 3;
  if (n < 1) return kAbsent;
  const Eigen::VectorXd third =
      left.tail(n) - 3.0 * left.segment(2, n) + 3.0 * left.segment(1, n) - left.head(n);
  return rms_of_rows(third) / std::sqrt(20.0);
}

double hit_rate(const std::string& id, const Gain& gain) {
  if (id == identity_of(kind_of<Presliding>()).cause ||
      id == identity_of(kind_of<FallingFriction>()).cause)
    return kHitRate;
  const double left = std::min(1.0, gain.after / gain.before);  // 1 where it was not measured
  return kHitRate - kHitRateLoss * left * left;
}

class TorqueConclusion {
 public:
  TorqueConclusion(const TorqueRows& rows, const TorqueBody& body, const TorqueSelected& selected,
                   TorqueDiagnosis& out)
      : rows_(rows), body_(body), parts_(selected.parts), training_(training_of(rows)), out_(out) {}

  void run() {
    const double sign = body_.opposite ? -1.0 : 1.0;
    const Eigen::MatrixXd all = columns_of(rows_, body_, parts_);
    theta_ = training_.fit(rows_.training(all));
    out_.time = rows_.holdout(rows_.time());
    out_.position = rows_.holdout(rows_.position());
    out_.torque = sign * rows_.holdout(rows_.torque());
    out_.left_before = sign * left_by(body_.columns);
    out_.left_after = sign * left_by(all);
    if (out_.time.size() > 0) {
      out_.baseline_rms = rms_of_rows(out_.left_before);
      out_.extended_rms = rms_of_rows(out_.left_after);
      out_.noise_rms = white_part_of(out_.left_after);
    }
    Eigen::Index column = body_.columns.cols();
    for (std::size_t i = 0; i < parts_.size(); ++i) {
      const TorquePart& part = parts_[i];
      TorqueCause cause;
      cause.id = part.id;
      cause.evidence = part.evidence;
      rivals(part, cause);
      Eigen::Index count = 0;
      for (const TorqueTerm& term : part.terms) count += rows_.columns(term).cols();
      parameters(part, theta_.segment(column, count), cause);
      column += count;
      cause.gain = gain_of(i);
      cause.confidence *= hit_rate(cause.id, cause.gain);
      out_.causes.push_back(std::move(cause));
    }
    std::stable_sort(out_.causes.begin(), out_.causes.end(), [](const auto& l, const auto& r) {
      const auto worth = [](const Gain& g) {
        return std::isfinite(g.before) ? g.before * g.before - g.after * g.after : 0.0;
      };
      return worth(l.gain) > worth(r.gain);
    });
  }

 private:
  /// Residual of a model on the hold-out, with coefficients fitted to the training data.
  [[nodiscard]] Eigen::VectorXd left_by(const Eigen::MatrixXd& columns) const {
    return rows_.holdout(rows_.torque()) -
           rows_.holdout(columns) * training_.fit(rows_.training(columns));
  }
  /// Mean squares of a residual of the hold-out, block by block.
  [[nodiscard]] std::vector<double> pieces_of(const Eigen::VectorXd& left) const {
    const Eigen::VectorXd time = rows_.holdout(rows_.time());
    const double piece_s =
        std::min(kBlock_s, static_cast<double>(left.size()) * rows_.step_s() / kMinBlocks);
    const auto piece_at = [&](Eigen::Index k) { return std::floor(time(k) / piece_s); };
    std::vector<double> out;
    for (Eigen::Index k = 0; k < left.size();) {
      Eigen::Index end = k;
      while (end < left.size() && piece_at(end) == piece_at(k)) ++end;
      out.push_back(left.segment(k, end - k).squaredNorm() / static_cast<double>(end - k));
      k = end;
    }
    return out;
  }

  /// Gain of one cause on the hold-out, with all other causes in the model.
  [[nodiscard]] Gain gain_of(std::size_t i) const {
    Eigen::MatrixXd without = columns_of(rows_, body_, parts_, i);
    // Backlash is compared with the same spring without a gap.
    if (parts_[i].id == "backlash") append(without, rows_.columns(parts_[i].terms.front()));
    const Eigen::VectorXd before = left_by(without),
                          after = left_by(columns_of(rows_, body_, parts_));
    Gain gain;
    if (before.size() == 0) return gain;
    gain.before = rms_of_rows(before);
    gain.after = rms_of_rows(after);
    const std::vector<double> was = pieces_of(before), is = pieces_of(after);
    if (was.size() < 4) return gain;
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
    return gain;
  }

  void rivals(const TorquePart& part, TorqueCause& cause) const {
    cause.confidence = part.confidence;
    cause.ambiguous_with = part.ambiguous_with;
    for (const auto& [rival, share] : part.rivals) {
      const bool named =
          std::any_of(parts_.begin(), parts_.end(),
                      [&, &id = rival](const auto& other) { return other.id == id; });
      if (named) continue;
      cause.confidence = std::min(cause.confidence, share);
      if (share < kMinShareToExcludeRival) cause.ambiguous_with.push_back(rival);
    }
  }

  /// Fills in the parameters of the cause, by the keys of the contract, from its coefficients `c`.
  void parameters(const TorquePart& part, const Eigen::VectorXd& c, TorqueCause& cause) const {
    const TorqueTerm& term = part.terms.front();
    const std::string unit = key_of_unit(out_.unit);
    auto& out = cause.parameters;
    const auto shape = [&](std::string_view name) {
      std::size_t i = 0;
      for (const Parameter& p : shapes_of(term.kind)) {
        if (p.name == name) return term.shapes[i];
        ++i;
      }
      return kAbsent;
    };
    if (part.id == "backlash") {
      const Plateau& plateau = out_.plateau;
      out = {{out_.rotary ? "width_rad" : "width_m", plateau.width},
             {"deviation", plateau.deviation}};
      if (plateau.forward > 0.0) out.emplace_back("width_forward", plateau.forward);
      if (plateau.backward > 0.0) out.emplace_back("width_backward", plateau.backward);
      out.emplace_back("reversals", static_cast<double>(plateau.reversals.size()));
    } else if (part.id == "gravity_offset") {
      out = {{"offset_" + unit, body_.opposite ? -c(0) : c(0)}};
      if (body_.coulomb > 0.0) out.emplace_back("over_coulomb", std::abs(c(0)) / body_.coulomb);
    } else if (part.id == "asymmetric_friction") {
      const auto own = [&](Eigen::Index column) { return column < 0 ? 0.0 : theta_(column); };
      const double level = own(body_.coulomb_column()), viscous = own(body_.viscous_column());
      out = {{"ratio", (level + c(0)) / (level - c(0))},
             {"coulomb_plus_" + unit, level + c(0)},
             {"coulomb_minus_" + unit, level - c(0)},
             {"viscous_plus", viscous + c(1)},
             {"viscous_minus", viscous - c(1)}};
    } else if (part.id == "stribeck") {
      out = {{"drop_" + unit, c(0)}, {"stribeck_velocity", shape("stribeck_velocity")}};
    } else if (part.id == "presliding") {
      out = {{"breakaway_" + unit, c(0)},
             {"breakaway_displacement", shape("breakaway_displacement")},
             {"shape_factor", shape("shape_factor")}};
    } else if (part.id == "cogging") {
      cogging(part, c, cause);
    } else if (part.id == "position_dependent_friction") {
      out = {{"amplitude_" + unit, unevenness(rows_, term, c)}};
    } else if (part.id == "added_friction") {
      out = {{"time_s", shape("time_s")}, {"coulomb_" + unit, c(0)}, {"viscous", c(1)}};
    } else if (part.id == "inertia_change") {
      out = {{"time_s", shape("time_s")},
             {"ratio", body_.mass > 0.0 ? 1.0 + c(0) / theta_(0) : kAbsent}};
    } else if (part.id == "viscous_drift") {
      out = {{"time_constant_s", shape("time_constant_s")}, {"cold", c(0)}};
    } else if (part.id == "periodic_disturbance") {
      out = {{"frequency_hz", shape("frequency_hz")},
             {"amplitude_" + unit, std::hypot(c(0), c(1))}};
    } else if (part.id == "dwell_stiction") {
      out = {{"growth_" + unit, c(0)}, {"length", shape("length")}};
    }
  }

  void cogging(const TorquePart& part, const Eigen::VectorXd& c, TorqueCause& cause) const {
    const double period = part.terms.front().shapes[0];
    std::vector<double> periods{period, 0.5 * period};
    for (std::size_t t = 1; t < part.terms.size(); ++t) periods.push_back(part.terms[t].shapes[0]);
    const std::vector<double> through = rows_.tracking_error_at(periods);
    for (std::size_t i = 0; i < periods.size(); ++i) {
      const auto at = static_cast<Eigen::Index>(2 * i);
      cause.harmonics.push_back({periods[i], std::hypot(c(at), c(at + 1)), through[i]});
    }
    const std::string unit = key_of_unit(out_.unit);
    cause.parameters = {{out_.rotary ? "period_rad" : "period_m", period},
                        {"amplitude_" + unit, cause.harmonics[0].amplitude},
                        {"amplitude_2_" + unit, cause.harmonics[1].amplitude}};
    if (out_.rotary)
      cause.parameters.emplace_back("order_per_rev", 2.0 * std::numbers::pi / period);
  }

  const TorqueRows& rows_;
  const TorqueBody& body_;
  const std::vector<TorquePart>& parts_;
  BlockedRegression training_;
  TorqueDiagnosis& out_;
  Eigen::VectorXd theta_;  // of all columns
};

/// Whether all parameters are finite and possible: friction does not drive, and a mass is positive.
bool plausible(const TorqueCause& cause) {
  // Of the inertia, or of the friction by direction: no workpiece has three times the mass of its
  // axis, and no axis one direction with a third of the other's friction.
  constexpr double kMaxRatio = 3.0;
  return std::all_of(cause.parameters.begin(), cause.parameters.end(), [](const auto& parameter) {
    const auto& [name, value] = parameter;
    if (name == "ratio") return value > 1.0 / kMaxRatio && value < kMaxRatio;
    const bool friction = name.starts_with("coulomb_plus") || name.starts_with("coulomb_minus");
    return std::isfinite(value) && !(friction && value < 0.0);
  });
}

TorqueDoubt doubt_of(const TorqueCause& cause) {
  // RMS on the hold-out with the cause over that without it. A cause that is worth less is true of
  // every axis to some degree: a joint whose friction differs by 0.1 % between the directions.
  constexpr double kMaxRmsRatio = 0.95;
  if (!plausible(cause)) return TorqueDoubt::kParameters;
  if (!(cause.gain.low > 0.0) || cause.gain.after > kMaxRmsRatio * cause.gain.before)
    return TorqueDoubt::kGain;
  return TorqueDoubt::kNone;
}

/// Fills in the causes that held-out data confirm, and their figures. A cause without a gain there
/// is taken out of the model and becomes suspected, the one with the least gain first: what it
/// imitated may then belong to another cause.
void conclude(const TorqueRows& rows, const TorqueBody& body, TorqueSelected selected,
              TorqueDiagnosis& out) {
  for (;;) {
    out.causes.clear();
    TorqueConclusion(rows, body, selected, out).run();
    TorqueCause* least = nullptr;
    for (TorqueCause& cause : out.causes) {
      cause.doubt = doubt_of(cause);
      if (cause.doubt == TorqueDoubt::kNone) continue;
      if (least == nullptr || !(cause.gain.low >= least->gain.low)) least = &cause;
    }
    if (least == nullptr) return;
    const auto part = std::find_if(selected.parts.begin(), selected.parts.end(),
                                   [&](const TorquePart& one) { return one.id == least->id; });
    selected.parts.erase(part);
    out.suspected.push_back(std::move(*least));
  }
}

/// The motor at its limit, as a cause. `mass` converts acceleration to torque. The gain is that of
/// the moments in the hold-out: the torque that is lacking there, and what is left beside the level
/// of the training data, which is 0 where those do not reach the limit.
TorqueCause cause_of_limit(const TorqueLimit& limit, double trained_level, double mass,
                           double training_to_s, const std::string& unit) {
  // That a torque which is flat while the axis does not follow, or while the control asks for more,
  // is at its limit: chosen, not fitted.
  constexpr double kConfidence = 0.97;
  TorqueCause cause;
  cause.id = "torque_saturation";
  cause.confidence = kConfidence;
  const auto longest = std::max_element(
      limit.moments.begin(), limit.moments.end(),
      [](const auto& l, const auto& r) { return l.end_s - l.begin_s < r.end_s - r.begin_s; });
  cause.parameters = {{"limit_" + unit, limit.level},
                      {"moments", static_cast<double>(limit.moments.size())},
                      {"at_limit_s", limit.duration_s()},
                      {"longest_at_s", longest->begin_s}};
  double beyond = kAbsent;
  for (const TorqueLimit::Moment& moment : limit.moments) beyond = std::fmax(beyond, moment.beyond);
  double most = 0.0, before = 0.0, after = 0.0, held = 0.0;
  for (const TorqueLimit::Piece& piece : limit.pieces) {
    most = std::max(most, piece.lacking);
    if (piece.time_s <= training_to_s) continue;
    before += std::pow(mass * piece.lacking_mps2, 2);
    after += std::pow(piece.beside_level + limit.level - trained_level, 2);
    held += 1.0;
  }
  if (held > 0.0 && mass > 0.0 && trained_level > 0.0) {
    cause.gain.before = std::sqrt(before / held);
    cause.gain.after = std::sqrt(after / held);
  }
  cause.evidence = {
      {"share of the highest torques that are at one level", limit.flat, kAbsent},
      {"largest share of its acceleration that the axis lacks meanwhile", most, kAbsent},
      {"most that the control asks beyond the level, as a share of it", beyond, kAbsent}};
  return cause;
}

/// Of the training data, so that the hold-out judges it too.
TorqueLag lag_of(const SegmentedAxis& axis, double training_share, double bandwidth_hz) {
  const double begin_s = axis.segments.front().start_s, end_s = axis.segments.back().end_s();
  const std::vector<Segment> training =
      cut(axis.segments, begin_s, begin_s + training_share * (end_s - begin_s));
  if (training.empty()) return {};
  return torque_lag(training, bandwidth_hz);
}

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

std::string key_of_unit(const std::string& unit) {
  if (unit == "N") return "n";
  if (unit == "Nm") return "nm";
  if (unit == "A") return "a";
  if (unit == "V") return "v";
  return "percent";
}

TorqueDiagnosis diagnose_torque(const SegmentedAxis& axis, const DiagnoseOptions& options,
                                bool commanded) {
  require_encoder(axis);
  if (!has_torque(axis))
    throw std::runtime_error(axis.axis + ": the recording has no torque of this axis");
  const double share = options.identify.training_share.value_or(training_share_of(axis.segments));
  const double widest_hz = widest_torque_band(axis.sample_time_s);
  TorqueLag lag = lag_of(axis, share, widest_hz);
  SegmentedAxis in_time = axis;
  in_time.segments = without_lag(axis.segments, lag);
  const double bandwidth_hz = torque_band(in_time, share);
  if (bandwidth_hz < widest_hz) {  // noise may have looked like a lag, or hidden one
    lag = lag_of(axis, share, bandwidth_hz);
    in_time.segments = without_lag(axis.segments, lag);
  }
  TorqueRows rows(in_time, share, commanded, bandwidth_hz);
  const TorqueBody body = body_of(rows, axis.rotary);
  const TorqueSelected selected = select_torque_causes(
      rows, body, options, commanded && Channels(axis.segments).rests, axis.rotary);
  TorqueDiagnosis out;
  out.axis = axis.axis;
  out.unit = axis.torque_unit;
  out.rotary = axis.rotary;
  out.commanded = commanded;
  out.bandwidth_hz = bandwidth_hz;
  out.widest_hz = widest_hz;
  out.lag = lag;
  out.opposite = body.opposite;
  out.mass = body.mass;
  out.mass_shown = std::abs(body.mass_z) > kMinMassEvidence;
  out.held_out_turns = body.held_out_turns;
  out.coulomb = body.coulomb;
  out.viscous = body.viscous;
  out.constant = body.opposite ? -body.constant : body.constant;
  out.gravity = body.gravity;
  out.gravity_at_rad = body.gravity_at;
  out.training_to_s = rows.training_to_s();
  out.plateau = selected.plateau;
  out.steps = selected.steps;
  conclude(rows, body, selected, out);
  const auto unsure =
      std::stable_partition(out.causes.begin(), out.causes.end(), [](const TorqueCause& c) {
        // Of causes that do the same here one is there, and they are named together.
        return c.confidence >= kMinConfidenceToName ||
               (!c.ambiguous_with.empty() && hit_rate(c.id, c.gain) >= kMinConfidenceToName);
      });
  for (auto cause = unsure; cause != out.causes.end(); ++cause)
    cause->doubt = TorqueDoubt::kConfidence;
  out.suspected.insert(out.suspected.begin(), unsure, out.causes.end());
  out.causes.erase(unsure, out.causes.end());
  if (options.leaves_out("torque_saturation")) return out;
  const TorqueLimit limit = torque_limit(in_time.segments);
  if (!limit.found()) return out;
  const TorqueLimit trained = torque_limit(cut(in_time.segments, -1e300, out.training_to_s));
  TorqueCause cause =
      cause_of_limit(limit, trained.found() ? trained.level : 0.0, out.mass_shown ? out.mass : 0.0,
                     out.training_to_s, key_of_unit(out.unit));
  const bool worse = cause.gain.after >= cause.gain.before;  // false where it was not measured
  if (worse) cause.doubt = TorqueDoubt::kGain;
  auto& list = worse ? out.suspected : out.causes;
  list.insert(list.begin(), std::move(cause));
  return out;
}

/// The cause that the position names and that does in the torque what this one does; empty: none.
/// An error of the reading does what a ripple of its period does: the control makes the axis follow
/// what it reads, which takes a force.
std::string same_by_position(const TorqueCause& cause, const Diagnosis& diagnosis) {
  const Model& model = diagnosis.extended.model;
  for (const Cause& named : diagnosis.causes) {
    const auto& rivals = cause.ambiguous_with;
    if (std::find(rivals.begin(), rivals.end(), named.id) != rivals.end()) return named.id;
    if ((named.id != "encoder_error" && named.id != "lead_error") ||
        named.place >= model.effects.size())
      continue;
    const double period = shape_of(model, model.effects[named.place].kind, "period");
    for (const Harmonic& line : cause.harmonics) {
      if (std::abs(line.period / period - 1.0) < kSamePeriod) return named.id;
    }
  }
  return {};
}

bool explained(const TorqueDiagnosis& torque) {
  constexpr double kMaxShareLeft = 1.0 / 3.0;  // a ninth of the squared residual
  constexpr double kMaxRmsOverNoise = 1.5;
  // A limit is no part of the model: the torque at it is as the motion needs it.
  if (torque.causes.size() == 1 && torque.causes.front().id == "torque_saturation") return true;
  return !torque.causes.empty() && (torque.extended_rms <= kMaxShareLeft * torque.baseline_rms ||
                                    torque.extended_rms <= kMaxRmsOverNoise * torque.noise_rms);
}

void heed(TorqueDiagnosis& torque, Diagnosis& diagnosis) {
  const auto own_id = [&](const TorqueCause& cause) {
    return std::any_of(diagnosis.causes.begin(), diagnosis.causes.end(),
                       [&](const Cause& named) { return named.id == cause.id; });
  };
  for (TorqueCause& cause : torque.causes) {
    if (!own_id(cause)) cause.same_by_position = same_by_position(cause, diagnosis);
    if (!cause.same_by_position.empty()) cause.doubt = TorqueDoubt::kPosition;
  }
  const auto unsure = std::stable_partition(
      torque.causes.begin(), torque.causes.end(),
      [](const TorqueCause& cause) { return cause.doubt == TorqueDoubt::kNone; });
  torque.suspected.insert(torque.suspected.begin(), std::make_move_iterator(unsure),
                          std::make_move_iterator(torque.causes.end()));
  torque.causes.erase(unsure, torque.causes.end());
  const auto names = [&](const auto& one) {
    return std::any_of(torque.causes.begin(), torque.causes.end(),
                       [&](const TorqueCause& cause) { return cause.id == one.id; });
  };
  std::erase_if(diagnosis.suspected, names);
  std::erase_if(diagnosis.not_observable, names);
}

}  // namespace servotwin
