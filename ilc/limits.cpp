#include "ilc/limits.h"

#include <algorithm>
#include <cmath>

namespace servotwin {

Eigen::ArrayXd limited(const Eigen::ArrayXd& u, const CorrectionLimits& limits, double h) {
  const Eigen::Index n = u.size();
  Eigen::ArrayXd out = u;
  if (n == 0) return out;
  const double step = limits.rate * h;
  if (std::isfinite(step)) {
    Eigen::ArrayXd above = u, below = u;
    for (Eigen::Index k = 1; k < n; ++k) {
      above(k) = std::max(above(k), above(k - 1) - step);
      below(k) = std::min(below(k), below(k - 1) + step);
    }
    for (Eigen::Index k = n - 1; k-- > 0;) {
      above(k) = std::max(above(k), above(k + 1) - step);
      below(k) = std::min(below(k), below(k + 1) + step);
    }
    out = 0.5 * (above + below);
  }
  for (Eigen::Index k = 0; k < n; ++k) {
    const Eigen::Index from_end = std::min(k, n - 1 - k);
    const double most =
        from_end == 0 ? 0.0 : std::min(limits.peak, step * static_cast<double>(from_end));
    out(k) = std::clamp(out(k), -most, most);
  }
  return out;
}

}  // namespace servotwin
