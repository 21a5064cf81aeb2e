// The daemon's configuration: every problem is a line with its place, and what is read twice is the
// same.
#include "daemon/config/config.h"

#include "tests/fuzz/fuzz.h"

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace servotwin;
  const daemon::CheckedConfig checked = daemon::check_config(fuzz::text(data, size), "input.toml");
  for (const ConfigProblem& problem : checked.problems)
    fuzz::require(!problem.what.empty() && problem.message().find('\n') == std::string::npos);
  const daemon::CheckedConfig again = daemon::check_config(fuzz::text(data, size), "input.toml");
  fuzz::require(again.problems.size() == checked.problems.size() &&
                again.config.given == checked.config.given);
  return 0;
}
