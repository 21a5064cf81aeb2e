// Causes in the words of the shop floor. Any thread.
#pragma once

#include <string>

#include "diagnosis/diagnose.h"

namespace servotwin {

/// "friction unlike in the two directions", for a cause of the contract; its identifier for others.
[[nodiscard]] std::string plain_name(const std::string& id);

/// How large it is, in mm, um, ms and N per kg of moved mass.
[[nodiscard]] std::string plain_size(const Diagnosis& diagnosis, const Cause& cause);

/// Which axis, what is wrong, how much, what to do first: a few sentences.
[[nodiscard]] std::string plain_verdict(const Diagnosis& diagnosis);

}  // namespace servotwin
