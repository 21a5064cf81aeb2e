// What the control asks of the motor, as a linear law of the command and the following error:
//
//   torque = c_s + c_1 sign(v_r) + c_2 sign(v_r, 4 ms before) + c_3 v_r + c_4 x_r + c_5 integral e
//            + sum_j (p_j e(t - t_j) + q_j a_r(t - t_j)),   t_j = 0, 1 .. 5 times 1 ms
//
// with a constant c_s for each segment, whose integrator starts anywhere, and the derivatives of
// the command x_r over 2 ms to each side (times of at least a sampling time, and whole ones). A
// cascade of P and PI controllers with feed-forward, behind the filters of a drive, is near such a
// law as long as its integrator is not held; behind a limit it may have been. The law says nothing
// about the machine, and no loop has to be identified for it. Where the torque stays away from it,
// the motor does not give what the control asks.
//
// SI units, the torque in its recorded unit and with its recorded sign. Any thread.
#pragma once

#include <Eigen/Core>
#include <functional>
#include <vector>

#include "twin/sample.h"

namespace servotwin {

/// What the law asks at every sample of every segment. It is fitted to the samples for which
/// `fits(segment, sample)` holds (at most 30,000 of them, spread over all); NaN near the ends of a
/// segment, where what came before or comes after is not known, and where none of a segment is
/// fitted. Empty where too few are fitted, or where a segment has no torque.
[[nodiscard]] std::vector<Eigen::ArrayXd> asked_torque(
    const std::vector<Segment>& segments,
    const std::function<bool(std::size_t, Eigen::Index)>& fits);

}  // namespace servotwin
