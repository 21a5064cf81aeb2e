// What becomes of a correction after a run: the rule by which it is kept, learned anew or
// withdrawn.
//
//   withdraw    the machine is not the model's any more, the path or an axis was followed no better
//               than it would be without, the gate refuses what was learned
//   learn anew  the model in force is another one, or what was measured is more than kAsPredicted
//               times what was to be expected: predicted and missed of the hold-out, as squares
//   keep        else
//
// Of a dry run what was measured is held against the prediction without correction. Fewer than
// kLeastCycles that count say nothing. Pure: no clock, file or thread.
#pragma once

#include <cstdint>
#include <string>

#include "daemon/between/offset_plan.h"

namespace servotwin::daemon {

inline constexpr double kAsPredicted = 3.0;
inline constexpr std::uint64_t kLeastCycles = 100;

struct CorrectionRuling {
  enum class What : std::uint8_t { kKeep, kLearnAnew, kWithdraw };
  What what = What::kKeep;
  std::string reason;  ///< one line for people
};

/// `run` is one of `learned`.
[[nodiscard]] CorrectionRuling ruling_after(const OffsetRun& run, const LearnedProgram& learned,
                                            const MachineDescription& machine);

/// What was measured beside what was predicted, RMS: for people, and as an event's detail (JSON).
[[nodiscard]] std::string gain_text(const OffsetRun& run, const LearnedProgram& learned);
[[nodiscard]] std::string gain_detail(const OffsetRun& run, const LearnedProgram& learned,
                                      const CorrectionRuling& ruling);

}  // namespace servotwin::daemon
