#include "daemon/record/residual_alarm.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace servotwin::daemon {
namespace {

// Motion per block: most of the correlation of a residual is within a second.
constexpr double kBlock_s = 1.0;
constexpr double kMinReference_s = 60.0;
// Lower limit of the mean square of a block [m^2]: that of 1 pm, far below any encoder.
constexpr double kMinMeanSquare = 1e-24;
// Limit of the score of one block: at the default rate at least six blocks are needed for an alarm.
constexpr double kMaxScore = 3.0;
// Drift of the CUSUM [deviations]: half of the growth that it is tuned to, which is one deviation.
constexpr double kDrift = 0.5;
// The deviation is at least that of a growth of the RMS by this factor.
constexpr double kMinDeviationGrowth = 1.2;
// Upper limit of the reference RMS over the hold-out RMS: the held-out data are short, but chance
// does not explain a larger ratio.
constexpr double kMaxReferenceOverHoldoutRms = 2.0;
// Upper end of the 95 % interval [standard errors].
constexpr double kUpperBoundStandardErrors = 2.0;
// Maximum lag at which blocks may be correlated; a short reference has fewer lags.
constexpr std::size_t kMaxLags = 20;

double log_of(double mean_square) { return std::log(std::max(mean_square, kMinMeanSquare)); }

}  // namespace

double ResidualAlarm::Sum::rms() const {
  return blocks == 0 ? 0.0 : std::sqrt(mean_square / static_cast<double>(blocks));
}

ResidualAlarm::ResidualAlarm(const AlarmOptions& options, double cycle_s) : options_(options) {
  if (!(cycle_s > 0.0) || !(options.false_alarm_s > 0.0) ||
      !(options.reference_s >= kMinReference_s))
    throw std::invalid_argument(
        "a residual alarm needs a cycle, a time between false alarms and a reference of at least "
        "60 s");
  cycles_per_block_ = static_cast<std::size_t>(std::ceil(kBlock_s / cycle_s * (1.0 - 1e-9)));
  block_s_ = static_cast<double>(cycles_per_block_) * cycle_s;
  reference_blocks_ = static_cast<std::size_t>(std::ceil(options.reference_s / block_s_));
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
  if (++cycles_ < cycles_per_block_) return std::nullopt;
  const double mean_square = sum_ / static_cast<double>(cycles_);
  sum_ = 0.0;
  cycles_ = 0;
  return on_block(mean_square, cycle.holdout_rms);
}

std::optional<AlarmChange> ResidualAlarm::on_block(double mean_square, double holdout_rms) {
  const double y = log_of(mean_square);
  if (learning_.size() >= reference_blocks_) return watch(y, mean_square);
  learning_.push_back(y);
  learning_sum_.mean_square += mean_square;
  ++learning_sum_.blocks;
  if (learning_.size() < reference_blocks_) return watch(y, mean_square);

  AlarmChange change;
  change.kind = AlarmChange::Kind::kReference;
  change.ended = cusum_.raised();
  reference_ = learnt(holdout_rms);
  cusum_ = Cusum(kDrift, threshold_for(kDrift, options_.false_alarm_s / block_s_));
  growth_ = {};
  change.rms = change.reference_rms = std::sqrt(reference_->mean_square);
  change.motion_s = static_cast<double>(reference_blocks_) * block_s_;
  change.threshold = cusum_.threshold();
  return change;
}

std::optional<AlarmChange> ResidualAlarm::watch(double y, double mean_square) {
  if (!reference_) return std::nullopt;
  const bool was_raised = cusum_.raised();
  const double z = std::min(kMaxScore, (y - reference_->mean) / reference_->deviation);
  cusum_.add(z);
  growth_.mean_square += mean_square;
  ++growth_.blocks;
  AlarmChange change;
  change.kind = cusum_.raised() ? AlarmChange::Kind::kRaised : AlarmChange::Kind::kBack;
  change.rms = growth_.rms();
  change.reference_rms = std::sqrt(reference_->mean_square);
  change.motion_s = static_cast<double>(growth_.blocks) * block_s_;
  change.threshold = cusum_.threshold();
  if (cusum_.sum() == 0.0) growth_ = {};
  if (cusum_.raised() == was_raised) return std::nullopt;
  return change;
}

ResidualAlarm::Reference ResidualAlarm::learnt(double holdout_rms) const {
  const std::size_t lags = std::min(kMaxLags, learning_.size() / 10);
  const SteadyLevel level = level_of(learning_, lags);
  Reference out;
  out.mean_square = learning_sum_.mean_square / static_cast<double>(learning_sum_.blocks);
  out.deviation =
      level.deviation * std::sqrt(1.0 + kUpperBoundStandardErrors * level.variance_error);
  out.deviation = std::max(out.deviation, 2.0 * std::log(kMinDeviationGrowth));
  out.mean = level.mean + kUpperBoundStandardErrors * level.mean_error;
  if (holdout_rms > 0.0) {
    const double most = kMaxReferenceOverHoldoutRms * holdout_rms;
    out.mean = std::min(out.mean, log_of(most * most));
    out.mean_square = std::min(out.mean_square, most * most);
  }
  return out;
}

}  // namespace servotwin::daemon
