// What the control asks of the motor, as a linear law of the command and the following error:
//
//   torque = c_0 + c_1 sign(v_r) + c_2 sign(v_r, before) + c_3 v_r + c_4 integral e
//            + sum_j (p_j e(t - t_j) + q_j a_r(t - t_j)),   t_j = 0 .. 5 ms or sampling times
//
// Any cascade of P and PI controllers with feed-forward, behind the filters of a drive, is near
// such a law. It says nothing about the machine, and no loop has to be identified for it. Where the
// torque stays away from it, the motor does not give what the control asks.
//
// SI units, the torque in its recorded unit and with its recorded sign. Any thread.
#pragma once

#include <Eigen/Core>
#include <functional>
#include <vector>

#include "twin/sample.h"

namespace servotwin {

/// What the law asks at every sample of every segment. It is fitted to the samples for which
/// `fits(segment, sample)` holds; empty where they are too few, or where a segment has no torque.
[[nodiscard]] std::vector<Eigen::ArrayXd> asked_torque(
    const std::vector<Segment>& segments,
    const std::function<bool(std::size_t, Eigen::Index)>& fits);

}  // namespace servotwin
