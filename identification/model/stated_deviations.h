// What a model file states of the certainty of its loop. Any thread; errors: none.
#pragma once

#include "identification/model/model_file.h"

namespace servotwin {

[[nodiscard]] StatedDeviations stated_deviations(const ModelRecord& record);

}  // namespace servotwin
