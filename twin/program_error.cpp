#include "twin/program_error.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace servotwin {
namespace {

constexpr double kReach = ContourError::kReach;
constexpr double kResolution = 1e-8;  // [m], commands closer than that share a corner

/// A place where the path may turn, and the samples that stand there.
struct Corner {
  PathPoint at{};
  double way = 0.0;  // arc length along the path
  Eigen::Index first = 0, last = 0;
};

PathPoint point_at(std::span<const Eigen::ArrayXd> axes, Eigen::Index k) {
  PathPoint out{};
  for (std::size_t i = 0; i < axes.size(); ++i) out[i] = axes[i](k);
  return out;
}

std::vector<Corner> corners_of(std::span<const Eigen::ArrayXd> command) {
  std::vector<Corner> out{{point_at(command, 0), 0.0, 0, 0}};
  for (Eigen::Index k = 1; k < command.front().size(); ++k) {
    const PathPoint at = point_at(command, k);
    const PathPoint step = minus(at, out.back().at);
    const double length = std::sqrt(dot(step, step));
    if (length < kResolution) {
      out.back().last = k;
    } else {
      out.push_back({at, out.back().way + length, k, k});
    }
  }
  return out;
}

/// The nearest point so far.
struct Nearest {
  PathPoint point{}, away{}, along{};
  double square = 0.0;
  std::size_t from = 0;  // corner before it
  double share = 0.0;    // of the way to the next one

  void look(const std::vector<Corner>& corners, std::size_t j) {
    const PathPoint chord = minus(corners[j + 1].at, corners[j].at);
    const PathPoint seen = minus(point, corners[j].at);
    const double t = std::clamp(dot(seen, chord) / dot(chord, chord), 0.0, 1.0);
    PathPoint rest;
    for (std::size_t i = 0; i < kMaxPathAxes; ++i) rest[i] = seen[i] - t * chord[i];
    const double distance = dot(rest, rest);
    if (distance >= square && along != PathPoint{}) return;
    // The first direction also where another point is not nearer: a corner has two.
    const double length = std::sqrt(dot(chord, chord));
    for (std::size_t i = 0; i < kMaxPathAxes; ++i) along[i] = chord[i] / length;
    if (distance > square) return;
    away = rest, square = distance, from = j, share = t;
  }
};

void require(bool holds, const char* rule) {
  if (!holds) throw std::invalid_argument(std::string("program error: ") + rule);
}

}  // namespace

ProgramError program_error(std::span<const Eigen::ArrayXd> command,
                           std::span<const Eigen::ArrayXd> actual,
                           std::span<const Eigen::ArrayXd> rotary,
                           std::span<const Eigen::ArrayXd> rotary_actual) {
  require(!command.empty() && command.size() <= kMaxPathAxes, "a path has 1 to 5 linear axes");
  require(actual.size() == command.size() && rotary_actual.size() == rotary.size(),
          "every axis needs command and position");
  const Eigen::Index n = command.front().size();
  for (const auto& axes : {command, actual, rotary, rotary_actual}) {
    for (const Eigen::ArrayXd& axis : axes) require(axis.size() == n, "axes of unlike length");
  }
  ProgramError out;
  out.distance = out.place = Eigen::ArrayXd::Zero(n);
  if (!rotary.empty()) out.turned = Eigen::ArrayXd::Zero(n);
  if (n == 0) return out;

  const std::vector<Corner> corners = corners_of(command);
  std::size_t here = 0;  // the corner where this sample's command is
  for (Eigen::Index k = 0; k < n; ++k) {
    while (here + 1 < corners.size() && corners[here + 1].first <= k) ++here;
    Nearest nearest;
    nearest.point = point_at(actual, k);
    nearest.away = minus(nearest.point, corners[here].at);
    nearest.square = dot(nearest.away, nearest.away);
    nearest.from = here;
    const double reach = kReach * std::sqrt(nearest.square);
    const double way = corners[here].way;
    for (std::size_t j = here; j > 0 && way - corners[j].way <= reach; --j)
      nearest.look(corners, j - 1);
    for (std::size_t j = here; j + 1 < corners.size() && corners[j].way - way <= reach; ++j)
      nearest.look(corners, j);

    out.away.push_back(nearest.away);
    out.along.push_back(nearest.along);
    const bool left = nearest.along[0] * nearest.away[1] - nearest.along[1] * nearest.away[0] > 0.0;
    out.distance(k) = std::sqrt(nearest.square) * (command.size() == 2 && left ? -1.0 : 1.0);
    // At a corner the samples that stand there are all the same place of the path.
    const Corner& before = corners[nearest.from];
    const Corner& after = corners[std::min(nearest.from + 1, corners.size() - 1)];
    out.place(k) =
        nearest.share <= 0.0   ? static_cast<double>(std::clamp(k, before.first, before.last))
        : nearest.share >= 1.0 ? static_cast<double>(std::clamp(k, after.first, after.last))
                               : static_cast<double>(before.last) +
                                     nearest.share * static_cast<double>(after.first - before.last);
    if (rotary.empty()) continue;
    const auto low = static_cast<Eigen::Index>(out.place(k));
    const Eigen::Index high = std::min(low + 1, n - 1);
    const double part = out.place(k) - static_cast<double>(low);
    double square = 0.0;
    for (std::size_t i = 0; i < rotary.size(); ++i) {
      const double due = rotary[i](low) + part * (rotary[i](high) - rotary[i](low));
      square += std::pow(rotary_actual[i](k) - due, 2.0);
    }
    out.turned(k) = std::sqrt(square);
  }
  return out;
}

}  // namespace servotwin
