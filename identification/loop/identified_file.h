// What `identify` found as JSON (docs/files.md): the model file with the structures that were tried
// and the reasons against its use. Any thread.
#pragma once

#include <nlohmann/json_fwd.hpp>

#include "identification/loop/identify.h"

namespace servotwin {

[[nodiscard]] nlohmann::json to_json(const Identified& identified);

}  // namespace servotwin
