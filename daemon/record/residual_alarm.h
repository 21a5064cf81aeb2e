// Notices that what the twin of one axis leaves has grown: a CUSUM (diagnosis/cusum.h) over the
// residual in motion.
//
//   m_j = mean square of the residual over one second of motion,   y_j = log m_j
//   z_j = (y_j - mean) / deviation, at most 3;   alarm where the CUSUM of z exceeds its threshold
//
// Seconds in place of samples, because a residual hangs together over parts of a second; their
// logarithms, because they differ by factors. Mean and long-run deviation are those of the first
// `reference_s` of motion after a model came into force, each at its upper 95 % bound: an alarm
// must not come of having seen too little. A model that leaves more than twice its hold-out RMS
// from the start is not taken for normal. The deviation is taken to be at least a growth of 20 %
// RMS: less is worth no alarm. The drift is 0.5 and the threshold gives one false alarm in
// `false_alarm_s` of motion (docs/theory.md 11). One second alone, however bad, raises no alarm.
//
// A new model gets a reference of its own; until that is known the one before goes on watching, so
// that a growth which the new model has half taken up is noticed all the same.
//
// Residuals [m | rad]. Pure: no clock. One thread. Errors: std::invalid_argument for options that
// are not positive.
#pragma once

#include <cstddef>
#include <optional>
#include <vector>

#include "daemon/between/cycle_row.h"
#include "diagnosis/cusum.h"

namespace servotwin::daemon {

struct AlarmOptions {
  double false_alarm_s = 30.0 * 86400.0;  ///< of motion, on average between false alarms
  double reference_s = 900.0;             ///< of motion that tells what is normal; at least 60
};

struct AlarmChange {
  enum class Kind { kRaised, kBack, kReference };
  Kind kind = Kind::kRaised;
  bool ended = false;          ///< kReference: an alarm by the one before
  double rms = 0.0;            ///< since the growth began
  double reference_rms = 0.0;  ///< what is normal
  double motion_s = 0.0;       ///< since the growth began, or of the reference
  double threshold = 0.0;      ///< in deviations
};

class ResidualAlarm {
 public:
  ResidualAlarm(const AlarmOptions& options, double cycle_s);

  /// The next cycle in which the axis moved. Says if that raised the alarm or ended it, or if it is
  /// now known what is normal.
  std::optional<AlarmChange> add(const LiveResidual& cycle);
  [[nodiscard]] bool raised() const noexcept { return cusum_.raised(); }
  /// Whether there is a reference to compare with.
  [[nodiscard]] bool watching() const noexcept { return reference_.has_value(); }

 private:
  struct Reference {
    double mean = 0.0, deviation = 0.0;  // of y, upper bounds
    double mean_square = 0.0;
  };
  struct Sum {  // of pieces
    double mean_square = 0.0;
    std::size_t pieces = 0;
    [[nodiscard]] double rms() const;
  };

  std::optional<AlarmChange> on_piece(double mean_square, double holdout_rms);
  std::optional<AlarmChange> watch(double y, double mean_square);
  [[nodiscard]] Reference learnt(double holdout_rms) const;

  AlarmOptions options_;
  std::size_t cycles_per_piece_, reference_pieces_;
  double piece_s_;
  int version_ = 0;
  double sum_ = 0.0;  // of squares in the piece that is not complete
  std::size_t cycles_ = 0;
  std::vector<double> learning_;  // y of the model in force, until there are enough
  Sum learning_sum_;
  std::optional<Reference> reference_;
  Cusum cusum_;
  Sum growth_;  // since the CUSUM was last at 0
};

}  // namespace servotwin::daemon
