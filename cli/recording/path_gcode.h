// A path as G-code: straight moves (G1) that stay within a tolerance of the path at any time, and
// dwells (G4) where it rests.
//
// Between two rests of the original command the path is cut into chords (Douglas and Peucker 1973),
// each run at a constant feed in the time of the commands that it replaces, such that at no time
// the move is further than the tolerance from the command: a correction is valid at its time only,
// and a path may turn back on itself. Where the path stays within the tolerance of one point while
// the original rests, the program dwells (G4).
//
// Positions [m | rad] become mm and degrees; feeds count along the linear axes, along the rotary
// ones where no other moves. Any thread.
#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

namespace servotwin::cli {

struct PathAxisText {
  std::string name;  ///< one letter
  bool rotary = false;
};

/// Without motion for this long, the original command rests.
inline constexpr double kRest_s = 0.02;

/// The rows of `path` at which moves begin or end, `first` and `last` included: no row is further
/// than `tolerance` [m | rad] from the point that its move has reached at the same time.
[[nodiscard]] std::vector<Eigen::Index> chord_ends(const std::vector<Eigen::ArrayXd>& path,
                                                   Eigen::Index first, Eigen::Index last,
                                                   double tolerance);

struct PathGcode {
  std::string text;
  long moves = 0;
};

/// `original`: the commands; `path`: the corrected commands; one array per axis, of the same length
/// [m | rad].
[[nodiscard]] PathGcode path_gcode(const std::vector<PathAxisText>& axes,
                                   const std::vector<Eigen::ArrayXd>& original,
                                   const std::vector<Eigen::ArrayXd>& path, double sample_time_s,
                                   double tolerance);

}  // namespace servotwin::cli
