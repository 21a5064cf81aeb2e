#include "daemon/record/residual_alarm.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace servotwin::daemon {
namespace {

constexpr double kPiece_s = 1.0;
constexpr double kShortest_s = 60.0;
// A piece of no error at all: a picometre, far below any encoder.
constexpr double kLeast = 1e-24;
// What one piece may say at most. Six of them are needed at the default rate.
constexpr double kClip = 3.0;
constexpr double kDrift = 0.5;          // half of a growth of one deviation,
constexpr double kGrowth = 1.2;         // which is at least this one of the RMS
constexpr double kBeyondHoldout = 2.0;  // a hold-out is short; more than this is no chance
constexpr double kUpper = 2.0;          // standard errors: the upper end of 95 %
// Pieces over which they may hang together; a reference that is short has fewer.
constexpr std::size_t kLags = 20;

double log_of(double mean_square) { return std::log(std::max(mean_square, kLeast)); }

}  // namespace

double ResidualAlarm::Sum::rms() const {
  return pieces == 0 ? 0.0 : std::sqrt(mean_square / static_cast<double>(pieces));
}

ResidualAlarm::ResidualAlarm(const AlarmOptions& options, double cycle_s) : options_(options) {
  if (!(cycle_s > 0.0) || !(options.false_alarm_s > 0.0) || !(options.reference_s >= kShortest_s))
    throw std::invalid_argument(
        "a residual alarm needs a cycle, a time between false alarms and a reference of at least "
        "60 s");
  cycles_per_piece_ = static_cast<std::size_t>(std::ceil(kPiece_s / cycle_s * (1.0 - 1e-9)));
  piece_s_ = static_cast<double>(cycles_per_piece_) * cycle_s;
  reference_pieces_ = static_cast<std::size_t>(std::ceil(options.reference_s / piece_s_));
}

std::optional<AlarmChange> ResidualAlarm::add(const LiveResidual& cycle) {
  if (cycle.model_version == 0 || !std::isfinite(cycle.residual)) return std::nullopt;
  if (cycle.model_version != version_) {
    version_ = cycle.model_version;
    sum_ = 0.0;
    cycles_ = 0;
    learning_.clear();
    learning_sum_ = {};
  }
  sum_ += cycle.residual * cycle.residual;
  if (++cycles_ < cycles_per_piece_) return std::nullopt;
  const double mean_square = sum_ / static_cast<double>(cycles_);
  sum_ = 0.0;
  cycles_ = 0;
  return on_piece(mean_square, cycle.holdout_rms);
}

std::optional<AlarmChange> ResidualAlarm::on_piece(double mean_square, double holdout_rms) {
  const double y = log_of(mean_square);
  if (learning_.size() >= reference_pieces_) return watch(y, mean_square);
  learning_.push_back(y);
  learning_sum_.mean_square += mean_square;
  ++learning_sum_.pieces;
  if (learning_.size() < reference_pieces_) return watch(y, mean_square);

  AlarmChange change;
  change.kind = AlarmChange::Kind::kReference;
  change.ended = cusum_.raised();
  reference_ = learnt(holdout_rms);
  cusum_ = Cusum(kDrift, threshold_for(kDrift, options_.false_alarm_s / piece_s_));
  growth_ = {};
  change.rms = change.reference_rms = std::sqrt(reference_->mean_square);
  change.motion_s = static_cast<double>(reference_pieces_) * piece_s_;
  change.threshold = cusum_.threshold();
  return change;
}

std::optional<AlarmChange> ResidualAlarm::watch(double y, double mean_square) {
  if (!reference_) return std::nullopt;
  const bool was_raised = cusum_.raised();
  const double z = std::min(kClip, (y - reference_->mean) / reference_->deviation);
  cusum_.add(z);
  growth_.mean_square += mean_square;
  ++growth_.pieces;
  AlarmChange change;
  change.kind = cusum_.raised() ? AlarmChange::Kind::kRaised : AlarmChange::Kind::kBack;
  change.rms = growth_.rms();
  change.reference_rms = std::sqrt(reference_->mean_square);
  change.motion_s = static_cast<double>(growth_.pieces) * piece_s_;
  change.threshold = cusum_.threshold();
  if (cusum_.sum() == 0.0) growth_ = {};
  if (cusum_.raised() == was_raised) return std::nullopt;
  return change;
}

ResidualAlarm::Reference ResidualAlarm::learnt(double holdout_rms) const {
  const std::size_t lags = std::min(kLags, learning_.size() / 10);
  const SteadyLevel level = level_of(learning_, lags);
  Reference out;
  out.mean_square = learning_sum_.mean_square / static_cast<double>(learning_sum_.pieces);
  out.deviation = level.deviation * std::sqrt(1.0 + kUpper * level.variance_error);
  out.deviation = std::max(out.deviation, 2.0 * std::log(kGrowth));
  out.mean = level.mean + kUpper * level.mean_error;
  if (holdout_rms > 0.0) {
    const double most = kBeyondHoldout * holdout_rms;
    out.mean = std::min(out.mean, log_of(most * most));
    out.mean_square = std::min(out.mean_square, most * most);
  }
  return out;
}

}  // namespace servotwin::daemon
