// Intervals of a recording, over which squared errors are averaged and compared in pairs: long
// against the memory of the residual, short against the recording. SI units. Any thread.
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <vector>

#include "twin/model.h"
#include "twin/twin.h"

namespace servotwin {

inline constexpr double kPiece_s = 0.25;   // length of an interval
inline constexpr double kSettle_s = 0.25;  // start of every segment, not used: transient

// Of a linear regression (screen.h, blocked_regression.h): blocks of its cross-validation, weight
// of all blocks in a fit to the other blocks, which holds coefficients that those do not determine,
// and share of the diagonal against singular matrices.
inline constexpr int kRegressionBlocks = 5;
inline constexpr double kPriorWeight = 0.03, kRidge = 1e-10;

/// An interval of the rows of a regression, and the block of the cross-validation that it is in.
struct Piece {
  Eigen::Index first = 0, count = 0;
  int block = 0;
};

/// RMS from the mean squares of intervals of equal length; 0 of none.
[[nodiscard]] inline double rms_of(const std::vector<double>& pieces) {
  double sum = 0.0;
  for (const double piece : pieces) sum += piece;
  return std::sqrt(sum / std::max<double>(1.0, static_cast<double>(pieces.size())));
}

/// The error that an addition removes: sqrt(before^2 - after^2) of the RMS; 0 if it adds some.
[[nodiscard]] inline double removed_rms(const std::vector<double>& before,
                                        const std::vector<double>& after) {
  const double with = rms_of(after), without = rms_of(before);
  return std::sqrt(std::max(0.0, without * without - with * with));
}

/// Appends the mean squares of the residual of a segment, interval by interval [m^2 | rad^2].
void add_pieces(const Segment& s, const Eigen::Ref<const Eigen::ArrayXd>& left,
                std::vector<double>& out);
/// The mean square of the simulation error of a model in every interval of 0.25 s [m^2 | rad^2].
[[nodiscard]] std::vector<double> left_by(const Model& model, const std::vector<Segment>& segments);
/// Whether the command moves in each of these intervals.
[[nodiscard]] std::vector<bool> moving(const std::vector<Segment>& segments);

/// z of the mean of paired differences; 0 where there are fewer than four.
[[nodiscard]] double paired_z(const std::vector<double>& before, const std::vector<double>& after);
/// z of the signed ranks of paired differences (Wilcoxon, Biometrics Bulletin 1 (1945) 80), which
/// does not fall when a few intervals contain most of the error; 0 where there are fewer than ten.
[[nodiscard]] double signed_rank_z(const std::vector<double>& before,
                                   const std::vector<double>& after);

}  // namespace servotwin
