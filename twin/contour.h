// How far a point is from the commanded path: the contour error (docs/theory.md 12).
//
//   eps = |P - C|,  C the point of the path that is nearest to P
//
// The path is the straight lines between the commands of the cycles that were, of this cycle, and
// of those that are known ahead. Against a curve through them its chords are off by at most
// kappa (v T)^2 / 8. In the plane eps has a sign: positive where P is on the right of the direction
// of travel; on a circle run counter-clockwise that is |P - centre| - R. With more axes eps >= 0.
//
// A path may cross itself, so that not all of it is looked at, but what lies within
// kReach |P - command| along the path, both ways: the nearest point is at most 2 |P - command| from
// the command as the crow flies, and at most pi / 2 times that along a path that does not turn by
// more than a half circle in between. Beyond the last command that is known the path goes straight
// on while it moves; where it stands it ends.
//
// Linear axes [m]. Commands closer to each other than kResolution share a corner of the path.
// Errors: NaN. One thread; allocates nothing, throws nothing.
#pragma once

#include <array>
#include <cstdint>
#include <numbers>
#include <span>

#include "twin/sample.h"

namespace servotwin {

/// Axes that one path has at most.
inline constexpr int kMaxPathAxes = 5;

/// A point of the path; the axes that there are not are 0.
using PathPoint = std::array<double, kMaxPathAxes>;

class ContourError {
 public:
  static constexpr int kCorners = 512;  ///< kept of the path; 0.1 s at 5 kHz
  static constexpr double kReach = std::numbers::pi;
  static constexpr double kResolution = 1e-7;  ///< [m]

  /// `axes`: 2..kMaxPathAxes.
  explicit ContourError(int axes) noexcept : axes_(axes) {}

  /// What was commanded before does not count any more.
  void forget() noexcept { corners_ = 0; }
  /// The command of the next cycle. One that is not a number is a gap.
  void move(const PathPoint& command) noexcept;
  /// The distance of `point` from the path, `ahead` being the commands of the next cycles. NaN
  /// where there is no command, a coordinate is not a number, or the nearest point is not kept any
  /// more.
  [[nodiscard]] double of(const PathPoint& point, std::span<const PathPoint> ahead) const noexcept;

 private:
  class Nearest;
  struct Corner {
    PathPoint at{};
    double way = 0.0;  // along the path since the last gap
  };
  [[nodiscard]] const Corner& corner(std::uint64_t number) const noexcept {
    return path_[number % kCorners];
  }

  int axes_;
  std::uint64_t corners_ = 0;  // since the last gap; the last one is this cycle's command
  bool moves_ = false;         // the last command was another than the one before
  std::array<Corner, kCorners> path_{};
};

}  // namespace servotwin
