// The columns of one more effect beside a loop that is held: the error per unit of each coefficient
// that is identifiable beside a free loop. What does not depend on the effect, the motion and the
// filters of the loop, is prepared once for many of them.
//
// Units: m | rad, s. Const members may be called from several threads at once. Allocates. Source:
// docs/theory.md 4.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <variant>
#include <vector>

#include "identification/loop/force_filter.h"
#include "identification/loop/projection.h"
#include "identification/recording/signals.h"
#include "twin/loop.h"

namespace servotwin {

class EffectColumns {
 public:
  /// The loop with all its modes; its command comes this much later.
  EffectColumns(const std::vector<Signals>& segments, const Loop& loop, double command_delay_s);

  /// Rows as in a Projection of these segments. `shapes`: all of this effect.
  [[nodiscard]] Eigen::MatrixXd of(std::size_t kind, const std::vector<double>& shapes) const;

 private:
  struct Part {
    MotionsSeen motions;
    std::variant<ForceFilter<2>, ForceFilter<3>> filter;
    Eigen::Index first = 0, count = 0;  // its rows
  };
  std::vector<Part> parts_;
  Eigen::Index rows_ = 0;
  int order_;
};

}  // namespace servotwin
