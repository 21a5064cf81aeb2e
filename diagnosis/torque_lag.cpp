#include "diagnosis/torque_lag.h"

#include <algorithm>
#include <cmath>
#include <optional>

#include "identification/recording/order_statistics.h"
#include "identification/torque/force_data.h"
#include "twin/linear_algebra.h"

namespace servotwin {

namespace {

constexpr double kMaxLag_s = 0.02;  // of a display filter; more is another recording's torque
constexpr int kMaxRepetitions = 4;
constexpr double kMinChangeOfLag_s = 2e-5;   // of the lag, for another repetition
constexpr double kMinSpeedShareOfLag = 0.1;  // of the 90 % quantile of the speeds
constexpr Eigen::Index kMinRowsOfLag = 100;
// Squared residual with the lag over that without it, above which the motion does not show it.
constexpr double kMaxErrorRatioOfLag = 0.9;

/// One more step of the lag; nothing where the motion does not show it.
std::optional<double> step_of_lag(const std::vector<Segment>& segments, double bandwidth_hz) {
  const ForceData data = ForceData::of_motion(segments, bandwidth_hz);
  // Of every stretch, after the filter of the force.
  const auto compared = [&](const auto& samples_of) {
    Eigen::VectorXd out(data.rows());
    Eigen::Index at = 0;
    for (const ForceData::Stretch& stretch : data.stretches()) {
      const Eigen::VectorXd part = data.compared(samples_of(stretch));
      out.segment(at, part.size()) = part;
      at += part.size();
    }
    return out;
  };
  const Eigen::VectorXd velocity = compared([](const ForceData::Stretch& stretch) {
    Eigen::ArrayXd out(static_cast<Eigen::Index>(stretch.motion.size()));
    for (Eigen::Index k = 0; k < out.size(); ++k)
      out(k) = stretch.motion[static_cast<std::size_t>(k)].velocity;
    return out;
  });
  const double h = segments.front().sample_time_s;
  const Eigen::VectorXd jerk = compared([h](const ForceData::Stretch& stretch) {
    const Eigen::ArrayXd& a = stretch.acceleration;
    Eigen::ArrayXd out = Eigen::ArrayXd::Zero(a.size());
    out.segment(1, a.size() - 2) = (a.tail(a.size() - 2) - a.head(a.size() - 2)) / (2.0 * h);
    return out;
  });
  const double least = kMinSpeedShareOfLag * quantile(velocity.array().abs(), 0.9);
  std::vector<Eigen::Index> rows;
  for (Eigen::Index k = 0; k < data.rows(); ++k) {
    if (data.least_speed()(k) > least) rows.push_back(k);
  }
  const auto n = static_cast<Eigen::Index>(rows.size());
  if (n < kMinRowsOfLag) return std::nullopt;
  Eigen::MatrixXd columns(n, 5);
  Eigen::VectorXd force(n);
  for (Eigen::Index i = 0; i < n; ++i) {
    const Eigen::Index k = rows[static_cast<std::size_t>(i)];
    columns.row(i) << data.acceleration()(k), std::copysign(1.0, velocity(k)), velocity(k), 1.0,
        jerk(k);
    force(i) = data.force()(k);
  }
  const Eigen::MatrixXd body = columns.leftCols(4);
  const double without = (force - body * least_squares(body, force)).squaredNorm();
  const Eigen::VectorXd theta = least_squares(columns, force);
  if (!((force - columns * theta).squaredNorm() < kMaxErrorRatioOfLag * without))
    return std::nullopt;
  const double lag_s = -theta(4) / theta(0);
  return std::isfinite(lag_s) ? std::optional(lag_s) : std::nullopt;
}

}  // namespace

std::vector<Segment> with_torque_advanced(std::vector<Segment> segments, double lag_s) {
  for (Segment& s : segments) {
    if (s.torque.size() != s.size() || lag_s == 0.0) continue;
    const double shift = lag_s / s.sample_time_s, whole = std::floor(shift), part = shift - whole;
    const auto by = static_cast<Eigen::Index>(whole);
    Eigen::ArrayXd advanced = Eigen::ArrayXd::Constant(s.size(), kAbsent);
    for (Eigen::Index k = std::max<Eigen::Index>(0, -by); k + by + 1 < s.size(); ++k) {
      if (k < s.size()) advanced(k) = (1.0 - part) * s.torque(k + by) + part * s.torque(k + by + 1);
    }
    s.torque = std::move(advanced);
  }
  return segments;
}

double torque_lag(const std::vector<Segment>& segments, double bandwidth_hz) {
  double lag_s = 0.0;
  for (int i = 0; i < kMaxRepetitions; ++i) {
    const auto step_s = step_of_lag(with_torque_advanced(segments, lag_s), bandwidth_hz);
    if (!step_s) break;
    lag_s += *step_s;
    if (std::abs(lag_s) > kMaxLag_s) return 0.0;
    if (std::abs(*step_s) < kMinChangeOfLag_s) break;
  }
  return lag_s;
}

}  // namespace servotwin
