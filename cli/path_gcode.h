// A path as G-code: straight moves (G1) that are within a tolerance of it at any time, and its
// rests.
//
// Between two rests of the original command the path is cut into chords (Douglas and Peucker 1973),
// each run at a constant feed in the time of the commands that it stands for, such that no command
// is further than the tolerance from where the move is then: a correction is right only at its
// time, and a path may turn back on itself. Where the path stays within the tolerance of where it
// is while the original rests, it dwells (G4).
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

inline constexpr double kRest_s = 0.02;

/// Rows of `path` that moves end at, with the first and the last: no row is further than
/// `tolerance` [m | rad] from the move over it, at its time.
[[nodiscard]] std::vector<Eigen::Index> chord_ends(const std::vector<Eigen::ArrayXd>& path,
                                                   Eigen::Index first, Eigen::Index last,
                                                   double tolerance);

struct PathGcode {
  std::string text;
  long moves = 0;
};

/// `original`: the commands, `path`: where to go instead; one array per axis.
[[nodiscard]] PathGcode path_gcode(const std::vector<PathAxisText>& axes,
                                   const std::vector<Eigen::ArrayXd>& original,
                                   const std::vector<Eigen::ArrayXd>& path, double sample_time_s,
                                   double tolerance);

}  // namespace servotwin::cli
