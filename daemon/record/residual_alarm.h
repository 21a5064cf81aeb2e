// Detects that the residual of the twin of one axis has grown: a CUSUM
// (diagnosis/statistics/cusum.h) over the residual in motion.
//
//   m_j = mean square of the residual over one second of motion,   y_j = log m_j
//   z_j = (y_j - mean) / deviation, at most 3;   alarm where the CUSUM of z exceeds its threshold
//
// Blocks of one second are used instead of samples, because a residual is correlated over parts of
// a second; their logarithms, because they differ by factors. Mean and long-run deviation of y are
// learned from the first `reference_s` of motion after a model came into force, each at its upper
// 95 % bound, so that a short reference causes no false alarms. The reference RMS is limited to
// twice the hold-out RMS of the model: a model with a larger residual from the start does not count
// as normal. The deviation is at least that of a growth of 20 % RMS, because less needs no alarm.
// The drift is 0.5, and the threshold gives one false alarm in `false_alarm_s` of motion
// (docs/theory.md 11). A single second, however large its residual, raises no alarm.
//
// A new model gets its own reference. Until that is learned, the reference before stays in use, so
// that a growth which the new model has partly adopted is still detected.
//
// Residuals [m | rad]. Pure: no clock. One thread. Errors: std::invalid_argument if an option is
// not positive or the reference is shorter than 60 s.
#pragma once

#include <cstddef>
#include <optional>
#include <vector>

#include "daemon/between/cycle_row.h"
#include "diagnosis/statistics/cusum.h"

namespace servotwin::daemon {

struct AlarmOptions {
  double false_alarm_s = 30.0 * 86400.0;  ///< mean motion between two false alarms
  double reference_s = 900.0;  ///< motion from which the normal residual is learned; >= 60
};

struct AlarmChange {
  enum class Kind { kRaised, kBack, kReference };
  Kind kind = Kind::kRaised;
  bool ended = false;          ///< kReference: this ends an alarm of the reference before
  double rms = 0.0;            ///< since the growth began
  double reference_rms = 0.0;  ///< the normal RMS
  double motion_s = 0.0;       ///< since the growth began, or of the reference
  double threshold = 0.0;      ///< in deviations
};

class ResidualAlarm {
 public:
  ResidualAlarm(const AlarmOptions& options, double cycle_s);

  /// Adds the next cycle in which the axis moved. Returns a change if that raised or ended the
  /// alarm, or completed the reference.
  std::optional<AlarmChange> add(const LiveResidual& cycle);
  [[nodiscard]] bool raised() const noexcept { return cusum_.raised(); }
  /// Whether there is a reference to compare with.
  [[nodiscard]] bool watching() const noexcept { return reference_.has_value(); }

 private:
  struct Reference {
    double mean = 0.0, deviation = 0.0;  // of y, upper bounds
    double mean_square = 0.0;
  };
  struct Sum {  // of blocks
    double mean_square = 0.0;
    std::size_t blocks = 0;
    [[nodiscard]] double rms() const;
  };

  std::optional<AlarmChange> on_block(double mean_square, double holdout_rms);
  std::optional<AlarmChange> watch(double y, double mean_square);
  [[nodiscard]] Reference learnt(double holdout_rms) const;

  AlarmOptions options_;
  std::size_t cycles_per_block_, reference_blocks_;
  double block_s_;
  int version_ = 0;
  double sum_ = 0.0;  // of squares in the incomplete block
  std::size_t cycles_ = 0;
  std::vector<double> learning_;  // y of the model in force, until there are enough
  Sum learning_sum_;
  std::optional<Reference> reference_;
  Cusum cusum_;
  Sum growth_;  // since the CUSUM was last at 0
};

}  // namespace servotwin::daemon
