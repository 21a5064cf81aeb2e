#include "identification/torque/force_data.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

#include "identification/recording/motion_range.h"
#include "identification/recording/segments.h"
#include "twin/hold.h"

namespace servotwin {

namespace {

// As published with the EMPS benchmark.
constexpr int kMotionOrder = 4, kComparisonOrder = 8;
constexpr double kMotionBandwidth = 2.5;  // of the bandwidth of the comparison
constexpr double kRipple_dB = 0.05;
constexpr double kPassBand = 0.8;  // of half the thinned rate
// Samples this close to the ends of a stretch are affected by the filters and left out [s].
constexpr double kBorder_s = 0.049, kBorderPeriods = 1.96;  // the former at 40 Hz

/// [DIFFCENT] central differences, one-sided at the ends.
Eigen::ArrayXd differentiated(const Eigen::ArrayXd& x, double h) {
  const Eigen::Index n = x.size();
  Eigen::ArrayXd out(n);
  out(0) = (x(1) - x(0)) / h;
  out.segment(1, n - 2) = (x.tail(n - 2) - x.head(n - 2)) / (2.0 * h);
  out(n - 1) = (x(n - 1) - x(n - 2)) / h;
  return out;
}

/// The parts of a segment with torque values.
std::vector<Segment> with_torque(const Segment& segment, Eigen::Index shortest) {
  std::vector<Segment> parts;
  for (Eigen::Index k = 0; k < segment.torque.size();) {
    Eigen::Index end = k;
    while (end < segment.torque.size() && std::isfinite(segment.torque(end))) ++end;
    if (end - k >= shortest) parts.push_back(part_of(segment, k, end - k));
    k = end + 1;
  }
  return parts;
}

/// The motion of a spline through the positions, in `substeps` steps per sample.
std::vector<Motion> motion_of(const Spline& position, const Spline& command, int substeps,
                              double start_s) {
  const double step = position.h / substeps;
  const Eigen::Index n = position.value.size();
  std::vector<Motion> out;
  out.reserve(static_cast<std::size_t>((n - 1) * substeps + 1));
  for (Eigen::Index k = 0; k < n; ++k) {
    for (int i = 0; i < (k + 1 < n ? substeps : 1); ++i) {
      const double t = step * i;
      const auto at = [k, t](const Spline& s) {
        return s.value(k) + t * (s.first(k) + t * (s.second(k) / 2.0 + t * s.third(k) / 6.0));
      };
      const auto slope_at = [k, t](const Spline& s) {
        return s.first(k) + t * (s.second(k) + t * s.third(k) / 2.0);
      };
      Motion m;
      m.step_s = step;
      m.time_s = start_s + position.h * static_cast<double>(k) + t;
      m.position = at(position);
      m.velocity = slope_at(position);
      m.acceleration = position.second(k) + t * position.third(k);
      m.displacement = out.empty() ? 0.0 : m.position - out.back().position;
      m.command_velocity = slope_at(command);
      m.command_acceleration = command.second(k) + t * command.third(k);
      out.push_back(m);
    }
  }
  return out;
}

}  // namespace

ForceData ForceData::of_motion(const std::vector<Segment>& segments, double bandwidth_hz,
                               int substeps) {
  ForceData data;
  if (segments.empty()) throw std::runtime_error("there is no motion to fit a force to");
  const double h = segments.front().sample_time_s;
  LowPass smoothing;
  if (bandwidth_hz > 0.0) {
    data.thinning_ = std::max<Eigen::Index>(1, std::llround(kPassBand / (2.0 * bandwidth_hz * h)));
    if (data.thinning_ > 1) {
      data.comparison_ = chebyshev(kComparisonOrder, kRipple_dB,
                                   0.5 * kPassBand / static_cast<double>(data.thinning_));
    }
    data.border_ = std::llround(std::max(kBorder_s, kBorderPeriods / bandwidth_hz) / h);
    if (kMotionBandwidth * bandwidth_hz * h < 0.45)
      smoothing = butterworth(kMotionOrder, kMotionBandwidth * bandwidth_hz * h);
  }
  data.step_s_ = h * static_cast<double>(data.thinning_);
  data.length_scale_ = servotwin::length_scale(segments);
  const Eigen::Index shortest = 2 * data.border_ + 10 * data.thinning_ + 64;
  for (const Segment& segment : segments) {
    for (const Segment& part : with_torque(segment, shortest)) {
      Stretch stretch;
      const Spline command = Spline::through(part.command, h);
      if (bandwidth_hz > 0.0) {
        const Eigen::ArrayXd position =
            smoothing.empty() ? part.actual : zero_phase(smoothing, part.actual);
        const Eigen::ArrayXd velocity = differentiated(position, h);
        stretch.motion = motion_of(Spline::through(position, h), command, 1, part.start_s);
        for (Eigen::Index k = 0; k < position.size(); ++k)
          stretch.motion[static_cast<std::size_t>(k)].velocity = velocity(k);
        stretch.acceleration = differentiated(velocity, h);
      } else {
        const Spline position = Spline::through(part.actual, h);
        stretch.motion = motion_of(position, command, substeps, part.start_s);
        stretch.substeps = substeps;
        stretch.acceleration = position.second;
      }
      stretch.force = part.torque;
      stretch.start_s = part.start_s;
      data.stretches_.push_back(std::move(stretch));
    }
  }
  if (data.stretches_.empty()) {
    throw std::runtime_error(
        "there is no segment of " + std::to_string(shortest) +
        " samples with torque, which this bandwidth needs: a force fit needs the motor's torque, "
        "force or current with the motion; record longer, or compare up to a higher bandwidth");
  }
  data.finish();
  return data;
}

ForceData ForceData::of_velocities(const Eigen::ArrayXd& velocity, const Eigen::ArrayXd& force) {
  ForceData data;
  Stretch stretch;
  for (const double v : velocity) {
    Motion m;
    m.step_s = 1.0;
    m.velocity = v;
    m.displacement = v;
    m.command_velocity = v;
    stretch.motion.push_back(m);
  }
  stretch.force = force;
  stretch.acceleration = Eigen::ArrayXd::Zero(force.size());
  data.step_s_ = 1.0;
  data.stretches_.push_back(std::move(stretch));
  data.finish();
  return data;
}

ForceData ForceData::of_virgin_curve(const Eigen::ArrayXd& displacement,
                                     const Eigen::ArrayXd& force) {
  ForceData data;
  Stretch stretch;
  double before = 0.0;
  for (const double x : displacement) {
    Motion m;
    m.step_s = 1.0;
    m.position = x;
    m.displacement = x - before;  // speed stays 0: a virgin curve contains hysteresis only
    stretch.motion.push_back(m);
    before = x;
  }
  stretch.force = force;
  stretch.acceleration = Eigen::ArrayXd::Zero(force.size());
  data.step_s_ = 1.0;
  data.stretches_.push_back(std::move(stretch));
  data.finish();
  return data;
}

Eigen::VectorXd ForceData::compared(const Eigen::ArrayXd& samples) const {
  const Eigen::Index kept = samples.size() - 2 * border_;
  const Eigen::ArrayXd filtered = comparison_.empty() ? samples : zero_phase(comparison_, samples);
  return filtered(Eigen::seqN(border_, (kept + thinning_ - 1) / thinning_, thinning_)).matrix();
}

Eigen::VectorXd ForceData::slowest_of(const Stretch& stretch, Eigen::Index rows) const {
  const Eigen::Index reach = comparison_.empty() ? 1 : 2 * thinning_;
  Eigen::VectorXd out(rows);
  for (Eigen::Index row = 0; row < rows; ++row) {
    const Eigen::Index at = border_ + row * thinning_;
    double least = std::numeric_limits<double>::infinity();
    for (Eigen::Index k = std::max<Eigen::Index>(0, at - reach);
         k <= std::min(at + reach, stretch.force.size() - 1); ++k) {
      least = std::min(
          least, std::abs(stretch.motion[static_cast<std::size_t>(k * stretch.substeps)].velocity));
    }
    out(row) = least;
  }
  return out;
}

void ForceData::finish() {
  std::vector<Eigen::VectorXd> forces, accelerations;
  Eigen::Index rows = 0;
  for (const Stretch& stretch : stretches_) {
    forces.push_back(compared(stretch.force));
    accelerations.push_back(compared(stretch.acceleration));
    rows += forces.back().size();
  }
  force_.resize(rows);
  acceleration_.resize(rows);
  least_speed_.resize(rows);
  time_.resize(rows);
  Eigen::Index row = 0;
  for (std::size_t i = 0; i < forces.size(); ++i) {
    force_.segment(row, forces[i].size()) = forces[i];
    acceleration_.segment(row, forces[i].size()) = accelerations[i];
    for (Eigen::Index k = 0; k < forces[i].size(); ++k) {
      time_(row + k) =
          stretches_[i].start_s +
          (static_cast<double>(border_) / static_cast<double>(thinning_) + static_cast<double>(k)) *
              step_s_;
    }
    least_speed_.segment(row, forces[i].size()) = slowest_of(stretches_[i], forces[i].size());
    row += forces[i].size();
  }
}

}  // namespace servotwin
