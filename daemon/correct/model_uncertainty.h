// What a model file says of its own uncertainty, or a share where it says nothing
// (ilc/uncertainty.h). The path that is to be corrected has no say in it. Any thread.
#pragma once

#include <string>

#include "identification/model/model_file.h"
#include "ilc/uncertainty.h"

namespace servotwin::daemon {

struct ModelUncertainty {
  TransferUncertainty of_transfer;
  std::string words;  ///< what it is and where it is from
};

/// `transfer`: of the record's model. `share`: of every pole and coefficient, in place of what the
/// model says; 0: what it says.
[[nodiscard]] ModelUncertainty uncertainty_of(const ModelRecord& record, const Transfer& transfer,
                                              double share = 0.0);

}  // namespace servotwin::daemon
