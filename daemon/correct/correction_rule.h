// The rule that is applied after a run: the correction is kept, learned again or withdrawn.
//
//   withdraw     a residual left its band; the error of the path or of an axis was no smaller than
//                predicted without a correction; or the gate refused the offset itself
//   learn again  the gate refused because another model is in force or the model is too old; or the
//                measured RMS is more than kMaxRatioToExpectedRms times the expected one, which is
//                sqrt(p^2 + h^2) of the predicted RMS p and the RMS h of the model on held-out data
//   keep         otherwise
//
// The measured errors of a dry run are compared with the prediction without correction. A run with
// fewer than kMinCountedCycles counted cycles changes nothing. Pure: no clock, file or thread.
#pragma once

#include <cstdint>
#include <string>

#include "daemon/between/offset_plan.h"

namespace servotwin::daemon {

/// Measured RMS over expected RMS above which a correction is learned again.
inline constexpr double kMaxRatioToExpectedRms = 3.0;
/// Minimum number of counted cycles (0.1 s at 1 kHz) for a decision.
inline constexpr std::uint64_t kMinCountedCycles = 100;

struct CorrectionRuling {
  enum class What : std::uint8_t { kKeep, kLearnAnew, kWithdraw };
  What what = What::kKeep;
  std::string reason;  ///< one line for people
};

/// `run` is one of `learned`.
[[nodiscard]] CorrectionRuling ruling_after(const OffsetRun& run, const LearnedProgram& learned,
                                            const MachineDescription& machine);

/// Measured and predicted RMS of a run: one line for people, and the detail of the event (JSON).
[[nodiscard]] std::string gain_text(const OffsetRun& run, const LearnedProgram& learned);
[[nodiscard]] std::string gain_detail(const OffsetRun& run, const LearnedProgram& learned,
                                      const CorrectionRuling& ruling);

}  // namespace servotwin::daemon
