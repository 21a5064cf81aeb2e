// The uncertainty of a model for learning (ilc/uncertainty.h): that stated by its identification,
// or a share of every pole and coefficient if it states none. It does not depend on the path that
// is corrected. Any thread; errors: none.
#pragma once

#include <string>

#include "ilc/uncertainty.h"

namespace servotwin {

struct ModelUncertainty {
  TransferUncertainty of_transfer;
  std::string words;  ///< what is assumed and where it comes from
};

/// `transfer`: transfer function of the model. `share`: relative uncertainty of every pole and
/// coefficient that replaces the stated one; 0: the stated one is used.
[[nodiscard]] ModelUncertainty uncertainty_of(const StatedDeviations& stated,
                                              const Transfer& transfer, double sample_time_s,
                                              double share = 0.0);

}  // namespace servotwin
