// Checks of numbers on the command line. Unlike CLI::Range they refuse nan.
#pragma once

#include <CLI/CLI.hpp>

namespace servotwin::cli {

/// A number from `low` to `high`.
[[nodiscard]] CLI::Validator between(double low, double high);
/// A whole number from `low` to `high`.
[[nodiscard]] CLI::Validator between(int low, int high);

}  // namespace servotwin::cli
