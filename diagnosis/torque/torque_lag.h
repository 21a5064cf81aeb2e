// The time by which a recorded torque is behind the motion: a drive filters the value that it
// shows, or sends it a cycle later. At reversals such a lag looks like friction that needs some
// travel.
//
//   T(t) = m a(t - lag) + F_c sgn v + B v + G  ~  m a - m lag a' + F_c sgn v + B v + G
//
// fitted where the axis is under way in one direction within the span of all filters, so that
// reversals, where friction decides, do not count. Repeated with the torque put in time by what was
// found, until nothing is left.
//
// Units: s; the rest as in torque.h. Errors: as of ForceData::of_motion, where no stretch is long
// enough. Any thread. Allocates.
#pragma once

#include <vector>

#include "identification/model/motor_torque.h"
#include "twin/sample.h"

namespace servotwin {

/// The lag of a torque; 0 where the motion shows none. Filter or delay is what leaves less of the
/// torque, reversals included.
[[nodiscard]] TorqueLag torque_lag(const std::vector<Segment>& segments, double bandwidth_hz);

/// The segments with the torque that was before the lag; absent at the ends where it is not known.
[[nodiscard]] std::vector<Segment> without_lag(std::vector<Segment> segments, const TorqueLag& lag);

}  // namespace servotwin
