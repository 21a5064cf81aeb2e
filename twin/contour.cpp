#include "twin/contour.h"

#include <algorithm>
#include <cmath>

namespace servotwin {
namespace {

double length(const PathPoint& a) noexcept { return std::sqrt(dot(a, a)); }

bool finite(const PathPoint& a) noexcept {
  return std::all_of(a.begin(), a.end(), [](double x) { return std::isfinite(x); });
}

}  // namespace

/// The nearest point so far, with the direction of travel there.
class ContourError::Nearest {
 public:
  Nearest(const PathPoint& point, const PathPoint& first) noexcept
      : point_(point), from_path_(minus(point, first)), square_(dot(from_path_, from_path_)) {}

  /// Looks at `from` + t `along`, t = 0..`most`.
  void look(const PathPoint& from, const PathPoint& along, double most) noexcept {
    const double square = dot(along, along);
    if (square == 0.0) return;
    const PathPoint seen = minus(point_, from);
    const double t = std::clamp(dot(seen, along) / square, 0.0, most);
    PathPoint rest;
    for (std::size_t i = 0; i < kMaxPathAxes; ++i) rest[i] = seen[i] - t * along[i];
    const double distance = dot(rest, rest);
    // The first direction also where another point is not nearer: a corner has two.
    if (distance < square_ || !directed_) {
      along_ = along;
      directed_ = true;
    }
    if (distance < square_) {
      from_path_ = rest;
      square_ = distance;
    }
  }

  [[nodiscard]] double distance() const noexcept { return std::sqrt(square_); }
  /// By how much a point is further away than the nearest one.
  [[nodiscard]] double further(const PathPoint& other) const noexcept {
    const PathPoint way = minus(point_, other);
    const double square = dot(way, way);
    return square > square_ ? std::sqrt(square) - distance() : 0.0;
  }
  /// The axes 0 and 1: P is on the left of the direction of travel.
  [[nodiscard]] bool left() const noexcept {
    return along_[0] * from_path_[1] - along_[1] * from_path_[0] > 0.0;
  }

 private:
  PathPoint point_, from_path_;
  double square_;
  PathPoint along_{};
  bool directed_ = false;
};

void ContourError::move(const PathPoint& command) noexcept {
  if (!finite(command)) {
    forget();
    return;
  }
  double way = 0.0;
  moves_ = corners_ > 0 && command != corner(corners_ - 1).at;
  if (corners_ > 0) {
    if (!moves_) return;
    // The last corner is moved with the command until it is far enough from the one before.
    const bool goes_along =
        corners_ > 1 && corner(corners_ - 1).way - corner(corners_ - 2).way < kResolution;
    if (goes_along) --corners_;
    const Corner& before = corner(corners_ - 1);
    way = before.way + length(minus(command, before.at));
  }
  path_[corners_ % kCorners] = {command, way};
  ++corners_;
}

double ContourError::of(const PathPoint& point, std::span<const PathPoint> ahead) const noexcept {
  if (corners_ == 0 || !finite(point)) return kAbsent;
  const Corner& here = corner(corners_ - 1);
  Nearest nearest(point, here.at);
  const double reach = kReach * nearest.distance();

  const std::uint64_t oldest = corners_ - std::min<std::uint64_t>(corners_, kCorners);
  std::uint64_t at = corners_ - 1;
  while (at > oldest && here.way - corner(at).way <= reach) {
    const PathPoint& from = corner(at - 1).at;
    nearest.look(from, minus(corner(at).at, from), 1.0);
    --at;
    // The distance falls by at most the arc length, so this much of the path can be skipped.
    const double until = corner(at).way - nearest.further(from);
    while (at > oldest && corner(at - 1).way > until) --at;
  }
  const bool forgotten = at == oldest && at > 0 && here.way - corner(at).way <= reach;
  if (forgotten && nearest.further(corner(at).at) <= 0.0) return kAbsent;

  double way = 0.0;
  PathPoint from = here.at;
  PathPoint along{};
  if (moves_) along = minus(from, corner(corners_ - 2).at);
  for (const PathPoint& next : ahead) {
    if (way > reach || !finite(next)) break;
    along = minus(next, from);
    nearest.look(from, along, 1.0);
    way += length(along);
    from = next;
  }
  // A point beyond the end is the nearest only where the path goes on to it.
  if (way <= reach) nearest.look(from, along, HUGE_VAL);

  const double distance = nearest.distance();
  if (!std::isfinite(distance)) return kAbsent;  // of a command beyond all bounds
  return axes_ == 2 && nearest.left() ? -distance : distance;
}

}  // namespace servotwin
