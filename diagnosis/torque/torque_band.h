// The bandwidth up to which torque and motion are compared. Above a resonance, and where the
// encoder's noise is larger than the acceleration, the motion does not show the mass: the estimate
// from a band that holds this is too small (errors in variables). Any thread.
#pragma once

#include "identification/recording/segments.h"

namespace servotwin {

/// 40 Hz, or 0.15 of the sampling rate if that is less.
[[nodiscard]] double widest_torque_band(double sample_time_s);
/// The bandwidth [Hz]: the widest, halved while the mass in it is not significant, or significantly
/// smaller than in the lowest band, where that shows one. The torque is in time (torque_lag.h),
/// since a lag takes mass away too. Throws as the constructor of TorqueRows.
[[nodiscard]] double torque_band(const SegmentedAxis& axis, double training_share);

}  // namespace servotwin
