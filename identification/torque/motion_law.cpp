#include "identification/torque/motion_law.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <stdexcept>
#include <string>

#include "twin/shown_units.h"

namespace servotwin {
namespace {

constexpr double kRounding = 1e-12;  // of m v against v^2 / 2a

std::string said(double value) {
  char digits[32];
  std::snprintf(digits, sizeof digits, "%.6g", value);
  return digits;
}

[[noreturn]] void refuse(const std::string& what) { throw std::invalid_argument(what); }

bool positive(double value) { return value > 0.0 && std::isfinite(value); }

double up_to_milliseconds(double seconds) {
  return std::ceil(seconds / kMilli * (1.0 - kRounding)) * kMilli;
}

/// Turning point of a speed, from the centre.
double turning_point(const MotionLawPlan& plan, std::size_t i) {
  return plan.bands[i] / 2.0 + plan.settle_s * plan.velocities[i];
}

void check(const MotionLawPlan& plan) {
  if (plan.velocities.empty()) refuse("there are no velocities");
  if (plan.bands.size() != plan.velocities.size()) {
    refuse(std::to_string(plan.bands.size()) + " bands for " +
           std::to_string(plan.velocities.size()) + " velocities, must be one for each");
  }
  if (!positive(plan.acceleration)) {
    refuse("acceleration is " + said(plan.acceleration / kMilli) + " mm/s^2, must be positive");
  }
  if (!(plan.settle_s >= 0.0) || !std::isfinite(plan.settle_s)) {
    refuse("settle is " + said(plan.settle_s) + " s, must be 0 or more");
  }
  if (!(plan.rest_s >= 0.0) || !std::isfinite(plan.rest_s)) {
    refuse("rest is " + said(plan.rest_s) + " s, must be 0 or more");
  }
  if (!std::isfinite(plan.centre)) refuse("centre is " + said(plan.centre) + ", must be finite");
  if (!(plan.travel > 0.0)) {
    refuse("travel is " + said(plan.travel / kMilli) + " mm, must be positive");
  }
  for (std::size_t i = 0; i < plan.velocities.size(); ++i) {
    const double v = plan.velocities[i];
    const std::string name =
        "velocity " + std::to_string(i + 1) + " (" + said(v / kMilli) + " mm/s)";
    if (!positive(v)) refuse(name + " must be positive; every one is run in both directions");
    if (!positive(plan.bands[i])) {
      refuse("the band of " + name + " is " + said(plan.bands[i] / kMilli) +
             " mm, must be positive");
    }
    const double needed = v * v / (2.0 * plan.acceleration);
    const double there = plan.settle_s * v;
    if (there < needed * (1.0 - kRounding)) {
      refuse(name + " is not reached before its band: it takes " + said(needed / kMilli) +
             " mm (v^2 / 2a) and has " + said(there / kMilli) + " mm; settle for at least " +
             said(up_to_milliseconds(needed / v)) + " s, or accelerate more");
    }
    if (2.0 * turning_point(plan, i) > plan.travel) {
      refuse(name + " needs " + said(2.0 * turning_point(plan, i) / kMilli) +
             " mm of travel and there are " + said(plan.travel / kMilli) +
             " mm; take a narrower band, a shorter settling time or a lower velocity");
    }
  }
}

std::vector<MotionRamp> ramps_of(const MotionLawPlan& plan) {
  std::vector<MotionRamp> ramps;
  double position = plan.centre - turning_point(plan, 0);
  double time = 0.0;
  const auto ramp_to = [&](double target, std::size_t i) {
    const double v = plan.velocities[i];
    const double direction = target > position ? 1.0 : -1.0;
    MotionRamp ramp;
    ramp.velocity = direction * v;
    ramp.band = plan.bands[i];
    ramp.from = position;
    ramp.to = target;
    ramp.start_s = time;
    ramp.end_s = time + std::abs(target - position) / v + v / plan.acceleration;
    // Accelerating takes v/a and covers only the distance of v/2a at full speed.
    const double to_band = std::abs(plan.centre - position) - ramp.band / 2.0;
    ramp.band_begin_s = time + to_band / v + v / plan.acceleration / 2.0;
    ramp.band_end_s = ramp.band_begin_s + ramp.band / v;
    ramps.push_back(ramp);
    position = target;
    time = ramp.end_s + plan.rest_s;
  };
  for (std::size_t i = 0; i < plan.velocities.size(); ++i) {
    const std::size_t next = std::min(i + 1, plan.velocities.size() - 1);
    ramp_to(plan.centre + turning_point(plan, i), i);
    ramp_to(plan.centre - std::max(turning_point(plan, i), turning_point(plan, next)), i);
  }
  return ramps;
}

}  // namespace

std::vector<double> polynomial_velocities(std::span<const double> coefficients, int count) {
  std::vector<double> velocities;
  for (int i = 1; i <= count; ++i) {
    double v = 0.0;
    for (auto a = coefficients.rbegin(); a != coefficients.rend(); ++a) v = v * i + *a;
    velocities.push_back(v);
  }
  return velocities;
}

MotionLaw::MotionLaw(const MotionLawPlan& plan)
    : acceleration_(plan.acceleration), rest_s_(plan.rest_s) {
  check(plan);
  ramps_ = ramps_of(plan);
  MotionLawPlan single = plan;
  std::fill(single.bands.begin(), single.bands.end(),
            *std::max_element(plan.bands.begin(), plan.bands.end()));
  single_band_duration_s_ = ramps_of(single).back().end_s + plan.rest_s;
  if (!std::isfinite(single_band_duration_s_)) refuse("the motion would never end");
}

double MotionLaw::low() const {
  double low = ramps_.front().from;
  for (const MotionRamp& ramp : ramps_) low = std::min(low, ramp.to);
  return low;
}

double MotionLaw::high() const {
  double high = ramps_.front().to;
  for (const MotionRamp& ramp : ramps_) high = std::max(high, ramp.to);
  return high;
}

double MotionLaw::at(double time_s) const {
  const auto after =
      std::upper_bound(ramps_.begin(), ramps_.end(), time_s,
                       [](double t, const MotionRamp& ramp) { return t < ramp.start_s; });
  if (after == ramps_.begin()) return ramps_.front().from;
  const MotionRamp& ramp = *std::prev(after);
  if (time_s >= ramp.end_s) return ramp.to;
  const double direction = ramp.velocity > 0.0 ? 1.0 : -1.0;
  const double since = time_s - ramp.start_s;
  const double left = ramp.end_s - time_s;
  const double changing = std::abs(ramp.velocity) / acceleration_;
  if (since < changing) return ramp.from + direction * 0.5 * acceleration_ * since * since;
  if (left < changing) return ramp.to - direction * 0.5 * acceleration_ * left * left;
  return ramp.from + ramp.velocity * (since - 0.5 * changing);
}

}  // namespace servotwin
