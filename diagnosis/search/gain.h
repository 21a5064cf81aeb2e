// The gain of one cause: how much it lowers the error of a free simulation on held-out data.
#pragma once

#include <vector>

#include "twin/model.h"
#include "twin/sample.h"

namespace servotwin {

/// RMS [m | rad] of the model refitted without a cause, and of the extended model.
struct Gain {
  double before = kAbsent, after = kAbsent;  ///< of measured minus simulated
  double low = kAbsent, high = kAbsent;      ///< 95 % interval of before - after (block bootstrap)
  /// RMS of the simulated tracking error: of the machine as it is, and with the cause repaired.
  /// Absent where there is nothing to repair.
  double tracking_now = kAbsent, tracking_repaired = kAbsent;
  /// RMS of its component across the path of this axis and its neighbour, which is the contribution
  /// of this axis to the contour error. Absent where no other linear axis was recorded.
  double contour_now = kAbsent, contour_repaired = kAbsent;
};

/// Whether a repair would lower the contour error, or the tracking error where that is not known,
/// by so much that it is worth a word: 2 %.
[[nodiscard]] bool worth_a_repair(const Gain& gain);

/// before^2 - after^2 [m^2 | rad^2]; 0 where the gain was not measured.
[[nodiscard]] double worth_of(const Gain& gain);

/// The gain of the cause that `with` has and `without` lacks. Any thread.
[[nodiscard]] Gain gain_of(const Model& without, const Model& with,
                           const std::vector<Segment>& holdout);

/// Fills in the tracking and contour errors that the two models simulate for these commands: `now`
/// for the machine as it is, `repaired` for the machine without the cause.
void judge_repair(const Model& now, const Model& repaired, const std::vector<Segment>& segments,
                  Gain& gain);

}  // namespace servotwin
