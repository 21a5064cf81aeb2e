// Shares of the contour error of a program by axis and effect.
//
//   share_(i,m) = sum_k -e_(i,m,k) away_(i,k) / sum_k |away_k|^2
//
// e_(i,m) is the contribution of effect m of axis i to its tracking error: the simulated error
// minus that of the model without the effect. e_(i,loop) is the error without any effect, minus the
// distance from the nearest point of the path to the momentary command, so that a common lag of all
// axes does not count. The shares sum to 1 except for what effects cause only together, which is
// reported as the rest.
//
// Units: m. Errors: as program_error. Allocates. Any thread. Source: docs/theory.md 12.
#pragma once

#include <string>
#include <vector>

#include "twin/model.h"
#include "twin/program_error.h"
#include "twin/sample.h"

namespace servotwin {

struct ContourShare {
  std::size_t axis = 0;  ///< index of the axis in the input
  std::string what;      ///< "loop", an effect's id, or empty: the rest
  double share = 0.0;    ///< of the squared contour error; below 0: it reduces the error
};

/// For linear axes; `error` is the contour error of these models for these commands. The largest
/// share comes first, the rest last.
[[nodiscard]] std::vector<ContourShare> contour_shares(const std::vector<Model>& models,
                                                       const std::vector<Segment>& paths,
                                                       const ProgramError& error);

}  // namespace servotwin
