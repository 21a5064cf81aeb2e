// Where an axis turns round, starts or stops: there the learned signal may need another bandwidth
// than elsewhere.
//
//   u = w Q_reversal v + (1 - w) Q v,   0 <= w <= 1
//
// What friction does at a reversal is over within a hundredth of a second and needs much bandwidth;
// elsewhere the error is smooth, and bandwidth only lets noise of the encoder and what the model
// does not know into the correction. w is 1 around every change of the direction of the command and
// falls to 0 by half a cosine. Both filters contract by the same condition, and so does their
// mixture (ilc/learning_law.h).
//
// Any thread.
#pragma once

#include <Eigen/Core>

namespace servotwin {

struct ReversalWindow {
  double before_s = 0.02, after_s = 0.06;  ///< w = 1
  double edge_s = 0.03;                    ///< over which it falls to 0
};

/// w of a command; directions are compared above `slowest` [m/s | rad/s], below it stands.
[[nodiscard]] Eigen::ArrayXd reversal_weight(const Eigen::ArrayXd& command, double h,
                                             const ReversalWindow& window = {},
                                             double slowest = 1e-6);

}  // namespace servotwin
