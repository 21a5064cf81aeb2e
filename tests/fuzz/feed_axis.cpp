// The parts of a feed axis: every problem is a line with its place; parts without one make a
// mechanism that stands, wherever its nut is.
#include "cli/recording/feed_axis_file.h"

#include <cmath>

#include "tests/fuzz/fuzz.h"
#include "twin/feed_axis/ball_screw.h"

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace servotwin;
  const CheckedFeedAxis checked = check_feed_axis(fuzz::text(data, size), "input.toml");
  for (const ConfigProblem& problem : checked.problems)
    fuzz::require(!problem.what.empty() && problem.message().find('\n') == std::string::npos);
  if (!checked.problems.empty()) return 0;
  const BallScrew screw(checked.parts);
  for (const double nut : {checked.parts.nut.from, checked.parts.nut.to}) {
    const double stiffness = static_stiffness(screw, nut);
    fuzz::require(std::isfinite(stiffness) && stiffness > 0.0);
    fuzz::require(mode_frequencies(screw, nut).allFinite());
  }
  return 0;
}
