// A diagnosis in a few sentences for people: the verdict with what to check first, and what the
// tracking error consists of, the larger part first. Any thread.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "diagnosis/search/diagnose.h"
#include "diagnosis/torque/torque.h"

namespace servotwin {

/// At least one; `torque`: what the torque shows, if it was recorded.
[[nodiscard]] std::vector<std::string> in_short(const Diagnosis& diagnosis,
                                                const std::optional<TorqueDiagnosis>& torque);

}  // namespace servotwin
