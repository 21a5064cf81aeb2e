// The contour error: distance of a point from the commanded path (docs/theory.md 12).
//
//   eps = |P - C|,  C the point of the path that is nearest to P
//
// The path is the polygon through the commands of past cycles, of this cycle, and of cycles that
// are known ahead. Its chords deviate from a curve through them by at most kappa (v T)^2 / 8. In
// the plane eps has a sign: positive if P is to the right of the direction of travel; on a circle
// run counter-clockwise that is |P - centre| - R. With more axes eps >= 0.
//
// A path may cross itself, so only the part within kReach |P - command| along the path, in both
// directions, is searched: the nearest point is at most 2 |P - command| from the command in a
// straight line, and at most pi / 2 times that along a path that turns by no more than a half
// circle in between. Beyond the last known command the path continues straight while it moves;
// where it rests it ends.
//
// Linear axes [m]. Commands closer to each other than kResolution share a corner of the path.
// Errors: NaN. One thread; allocates nothing, throws nothing. Source: Koren 1980; docs/theory.md
// 12.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <numbers>
#include <span>

#include "twin/sample.h"

namespace servotwin {

/// The largest number of axes of a path.
inline constexpr int kMaxPathAxes = 5;

/// A point of the path [m]; unused axes are 0.
using PathPoint = std::array<double, kMaxPathAxes>;

[[nodiscard]] inline PathPoint minus(const PathPoint& a, const PathPoint& b) noexcept {
  PathPoint out;
  for (std::size_t i = 0; i < kMaxPathAxes; ++i) out[i] = a[i] - b[i];
  return out;
}

[[nodiscard]] inline double dot(const PathPoint& a, const PathPoint& b) noexcept {
  double out = 0.0;
  for (std::size_t i = 0; i < kMaxPathAxes; ++i) out += a[i] * b[i];
  return out;
}

class ContourError {
 public:
  static constexpr int kCorners = 512;  ///< stored corners of the path; 0.1 s at 5 kHz
  static constexpr double kReach = std::numbers::pi;
  static constexpr double kResolution = 1e-7;  ///< [m]

  /// `axes`: 2..kMaxPathAxes.
  explicit ContourError(int axes) noexcept : axes_(axes) {}

  /// Forgets all earlier commands.
  void forget() noexcept { corners_ = 0; }
  /// Adds the command of the next cycle. NaN is a gap.
  void move(const PathPoint& command) noexcept;
  /// The distance of `point` from the path [m]; `ahead` holds the commands of the next cycles. NaN
  /// if there is no command, a coordinate is not a number, or the nearest point is no longer
  /// stored.
  [[nodiscard]] double of(const PathPoint& point, std::span<const PathPoint> ahead) const noexcept;

 private:
  class Nearest;
  struct Corner {
    PathPoint at{};
    double way = 0.0;  // arc length of the path since the last gap [m]
  };
  [[nodiscard]] const Corner& corner(std::uint64_t number) const noexcept {
    return path_[number % kCorners];
  }

  int axes_;
  std::uint64_t corners_ = 0;  // since the last gap; the last one is this cycle's command
  bool moves_ = false;         // the last command differs from the one before
  std::array<Corner, kCorners> path_{};
};

}  // namespace servotwin
