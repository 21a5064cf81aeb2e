// The bandwidth up to which torque and motion are compared. Above a resonance, and where the
// encoder's noise is larger than the acceleration, the motion does not show the mass: the estimate
// from a band that holds this is too small (errors in variables). Any thread.
#pragma once

#include "identification/recording/segments.h"

namespace servotwin {

/// The bandwidth [Hz]: 40 Hz, or 0.15 of the sampling rate if that is less; halved while the mass
/// in it is not significant, or significantly smaller than in the lowest band, where that shows
/// one. `training_share`, `commanded` as for TorqueRows. Throws as its constructor.
[[nodiscard]] double torque_band(const SegmentedAxis& axis, double training_share, bool commanded);

}  // namespace servotwin
