#include "identification/model/motion_reach.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "identification/recording/values.h"

namespace servotwin {
namespace {

using values::number;

/// To two digits, for people.
std::string rounded(double value) {
  if (!(value > 0.0)) return "0";
  const double digit = std::pow(10.0, std::floor(std::log10(value)) - 1.0);
  return number(std::round(value / digit) * digit);
}

double times(double of_path, double of_model) { return of_model > 0.0 ? of_path / of_model : 0.0; }

}  // namespace

MotionReach motion_reach(const ModelRecord& record, std::span<const Segment> path) {
  const MotionRange asked = motion_range(path), &known = record.motion;
  MotionReach out{times(asked.speed, known.speed), times(asked.acceleration, known.acceleration),
                  ""};
  if (!(std::max(out.speed, out.acceleration) > kMaxRatioToPredict)) return out;
  const std::string unit = record.rotary ? " rad/s" : " m/s";
  out.words = record.axis + ": the command reaches " + rounded(out.speed) + " times the speed (" +
              rounded(asked.speed) + unit + ") and " + rounded(out.acceleration) +
              " times the acceleration (" + rounded(asked.acceleration) + unit +
              "^2) of the motion that its model was identified from";
  return out;
}

std::string jump_in(const Segment& path, const std::string& axis, bool rotary) {
  const double h = path.sample_time_s;
  const double most = std::max((rotary ? kMinJumpAccelerationRotary : kMinJumpAcceleration) * h * h,
                               rotary ? kMinJumpStepRotary : kMinJumpStep);
  const auto step = [&](Eigen::Index k) {  // into row k
    return k > 0 && k < path.size() ? path.command(k) - path.command(k - 1) : 0.0;
  };
  for (Eigen::Index k = 1; k < path.size(); ++k) {
    const double since = step(k) - step(k - 1), until = step(k) - step(k + 1);
    if (since * until <= 0.0 || std::min(std::abs(since), std::abs(until)) <= most) continue;
    const double by = std::abs(step(k)) * (rotary ? 180.0 / std::numbers::pi : 1e3);
    return axis + ".command jumps by " + rounded(by) + (rotary ? " deg" : " mm") +
           " within one cycle, into row " + std::to_string(k + 1) + " (at " +
           number(path.start_s + h * static_cast<double>(k)) +
           " s); no drive follows that: correct the table, or the unit in its header";
  }
  return {};
}

}  // namespace servotwin
