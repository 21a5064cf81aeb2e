// Windows around the reversals of an axis, where the learned signal may have another bandwidth.
//
//   u = w Q_reversal v + (1 - w) Q v,   0 <= w <= 1
//
// The effect of friction at a reversal lasts a hundredth of a second and needs much bandwidth.
// Elsewhere the error is smooth, and bandwidth only adds encoder noise and unmodelled dynamics to
// the correction. w is 1 around every start, stop and change of direction of the command and falls
// to 0 along half a cosine. Both filters contract by the same condition, and so does their mixture
// (ilc/learning_law.h).
//
// Units: m | rad, s. Errors: none. Any thread. Source: docs/theory.md 13.3.
#pragma once

#include <Eigen/Core>

namespace servotwin {

struct ReversalWindow {
  double before_s = 0.02, after_s = 0.06;  ///< w = 1 from before to after a reversal
  double edge_s = 0.03;                    ///< then w falls to 0 within this time
};

/// w of a command, one value per sample. Below the speed `slowest` [m/s | rad/s] the axis counts as
/// standing.
[[nodiscard]] Eigen::ArrayXd reversal_weight(const Eigen::ArrayXd& command, double h,
                                             const ReversalWindow& window = {},
                                             double slowest = 1e-6);

}  // namespace servotwin
