// What one cause is worth, measured in free simulation on data that no fit has seen.
#pragma once

#include <vector>

#include "twin/model.h"
#include "twin/sample.h"

namespace servotwin {

/// RMS without and with one cause, everything else as it is in the extended model [m | rad].
struct Gain {
  double before = kAbsent, after = kAbsent;  ///< of measured minus simulated
  double low = kAbsent, high = kAbsent;      ///< 95 % interval of before - after (block bootstrap)
  /// Of the tracking error itself, simulated: as the machine is, and with the cause repaired on the
  /// machine. Absent where there is nothing to repair.
  double tracking_now = kAbsent, tracking_repaired = kAbsent;
  /// Of the part of it that is across the path of this axis and its neighbour: what this axis
  /// contributes to the contour error. Absent where no other linear axis was recorded.
  double contour_now = kAbsent, contour_repaired = kAbsent;
};

/// before^2 - after^2; 0 where it was not measured.
[[nodiscard]] double worth_of(const Gain& gain);

/// Any thread.
[[nodiscard]] Gain gain_of(const Model& without, const Model& with,
                           const std::vector<Segment>& holdout);

/// Fills in what repair would bring: the tracking and contour error that the two models simulate
/// for these commands.
void judge_repair(const Model& now, const Model& repaired, const std::vector<Segment>& segments,
                  Gain& gain);

}  // namespace servotwin
