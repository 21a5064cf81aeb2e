#include "ilc/reversals.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace servotwin {

Eigen::ArrayXd reversal_weight(const Eigen::ArrayXd& command, double h,
                               const ReversalWindow& window, double slowest) {
  const Eigen::Index n = command.size();
  Eigen::ArrayXd weight = Eigen::ArrayXd::Zero(n);
  const auto samples = [h](double seconds) {
    return static_cast<Eigen::Index>(std::lround(seconds / h));
  };
  const Eigen::Index before = samples(window.before_s), after = samples(window.after_s),
                     edge = std::max<Eigen::Index>(1, samples(window.edge_s));
  int direction = 0;
  for (Eigen::Index k = 1; k < n; ++k) {
    const double velocity = (command(k) - command(k - 1)) / h;
    const int now = std::abs(velocity) <= slowest ? 0 : velocity > 0.0 ? 1 : -1;
    if (now == direction) continue;
    direction = now;
    const Eigen::Index first = std::max<Eigen::Index>(0, k - before - edge),
                       last = std::min(n - 1, k + after + edge);
    for (Eigen::Index i = first; i <= last; ++i) {
      const Eigen::Index outside = std::max({Eigen::Index{0}, k - before - i, i - k - after});
      const double w = 0.5 + 0.5 * std::cos(std::numbers::pi * static_cast<double>(outside) /
                                            static_cast<double>(edge));
      weight(i) = std::max(weight(i), w);
    }
  }
  return weight;
}

}  // namespace servotwin
