// The machine and domain of the DDS tests of this process, and how long they wait.
#pragma once

#include <unistd.h>

#include <string>

#include "drivers/dds/dds.h"

namespace servotwin {

inline constexpr double kPatience_s =
    10.0;  // of a busy machine; nothing waits that long where all is well

/// A machine name of this process only.
inline DdsPlace place(const std::string& name) {
  return {name + "-" + std::to_string(getpid()), 91, ""};
}

}  // namespace servotwin
