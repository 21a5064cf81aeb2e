// An example of every command: the last lines of its --help, and of its part of the manual page.
#pragma once

#include <string>
#include <string_view>
#include <vector>

namespace servotwin::cli {

/// Command lines of this command, in the order of the work; from the folder that holds examples/.
/// Empty if there is no such command. Any thread.
[[nodiscard]] std::vector<std::string> examples_of(std::string_view command);

}  // namespace servotwin::cli
