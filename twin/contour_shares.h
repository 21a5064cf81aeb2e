// Which axis and which of its effects make the contour error of a program.
//
//   share_(i,m) = sum_k -e_(i,m,k) away_(i,k) / sum_k |away_k|^2
//
// e_(i,m) is what effect m of axis i adds to its tracking error: the simulated error less that of
// the model without the effect. e_(i,loop) is the error without any effect, less the way from the
// nearest point of the path to the command of the moment: what all axes lag by together is none.
// The shares add up to 1 but for what effects only do together, which is the rest.
//
// Errors: as program_error. Any thread.
#pragma once

#include <string>
#include <vector>

#include "twin/model.h"
#include "twin/program_error.h"
#include "twin/sample.h"

namespace servotwin {

struct ContourShare {
  std::size_t axis = 0;  ///< of those given
  std::string what;      ///< "loop", an effect's id, or empty: the rest
  double share = 0.0;    ///< of the squared contour error; below 0: it makes it smaller
};

/// Of linear axes; `error` is the contour error that these models make of these commands. The
/// largest share first, the rest at the end.
[[nodiscard]] std::vector<ContourShare> contour_shares(const std::vector<Model>& models,
                                                       const std::vector<Segment>& paths,
                                                       const ProgramError& error);

}  // namespace servotwin
