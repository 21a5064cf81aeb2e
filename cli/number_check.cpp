#include "cli/number_check.h"

#include <CLI/CLI.hpp>
#include <sstream>
#include <string>

#include "drivers/text.h"

namespace servotwin::cli {

CLI::Validator between(double low, double high) {
  return {[low, high](std::string& input) -> std::string {
            double value = 0.0;
            if (CLI::detail::lexical_cast(input, value) && value >= low && value <= high) return {};
            std::ostringstream out;
            out << in_quotes(input) << " must be a number from " << low << " to " << high;
            return out.str();
          },
          ""};
}

CLI::Validator between(int low, int high) {
  return {[low, high](std::string& input) -> std::string {
            int value = 0;
            if (CLI::detail::lexical_cast(input, value) && value >= low && value <= high) return {};
            return in_quotes(input) + " must be a whole number from " + std::to_string(low) +
                   " to " + std::to_string(high);
          },
          ""};
}

}  // namespace servotwin::cli
