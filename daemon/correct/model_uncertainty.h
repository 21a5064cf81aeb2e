// The uncertainty of a model for learning (ilc/uncertainty.h): that stated in the model file, or a
// share of every pole and coefficient if the file states none. It does not depend on the path that
// is corrected. Any thread; errors: none.
#pragma once

#include <string>

#include "identification/model/model_file.h"
#include "ilc/uncertainty.h"

namespace servotwin::daemon {

struct ModelUncertainty {
  TransferUncertainty of_transfer;
  std::string words;  ///< what is assumed and where it comes from
};

/// `transfer`: transfer function of the record's model. `share`: relative uncertainty of every pole
/// and coefficient that replaces the stated one; 0: the stated one is used.
[[nodiscard]] ModelUncertainty uncertainty_of(const ModelRecord& record, const Transfer& transfer,
                                              double share = 0.0);

}  // namespace servotwin::daemon
