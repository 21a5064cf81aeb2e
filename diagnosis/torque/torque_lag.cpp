#include "diagnosis/torque/torque_lag.h"

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

/// Forces on the body and what they are compared with, after the filter of the force.
struct Compared {
  explicit Compared(const std::vector<Segment>& segments, double bandwidth_hz)
      : data(ForceData::of_motion(segments, bandwidth_hz)) {
    velocity = column([](const ForceData::Stretch& stretch) { return velocity_of(stretch); });
    direction = column([](const ForceData::Stretch& stretch) {
      return Eigen::ArrayXd(velocity_of(stretch).sign());
    });
    const double h = segments.front().sample_time_s;
    jerk = column([h](const ForceData::Stretch& stretch) {
      const Eigen::ArrayXd& a = stretch.acceleration;
      Eigen::ArrayXd out = Eigen::ArrayXd::Zero(a.size());
      out.segment(1, a.size() - 2) = (a.tail(a.size() - 2) - a.head(a.size() - 2)) / (2.0 * h);
      return out;
    });
  }

  /// Mean squared residual of the rigid body over all of the motion.
  [[nodiscard]] double left() const {
    Eigen::MatrixXd body(data.rows(), 4);
    body << data.acceleration(), direction, velocity, Eigen::VectorXd::Ones(data.rows());
    return (data.force() - body * least_squares(body, data.force())).squaredNorm() /
           static_cast<double>(data.rows());
  }

  ForceData data;
  Eigen::VectorXd velocity, direction, jerk;

 private:
  static Eigen::ArrayXd velocity_of(const ForceData::Stretch& stretch) {
    Eigen::ArrayXd out(static_cast<Eigen::Index>(stretch.motion.size()));
    for (Eigen::Index k = 0; k < out.size(); ++k)
      out(k) = stretch.motion[static_cast<std::size_t>(k)].velocity;
    return out;
  }
  template <class Of>
  [[nodiscard]] Eigen::VectorXd column(const Of& of) const {
    Eigen::VectorXd out(data.rows());
    Eigen::Index at = 0;
    for (const ForceData::Stretch& stretch : data.stretches()) {
      const Eigen::VectorXd part = data.compared(of(stretch));
      out.segment(at, part.size()) = part;
      at += part.size();
    }
    return out;
  }
};

/// One more step of the lag; nothing where the motion does not show it.
std::optional<double> step_of_lag(const Compared& compared) {
  const ForceData& data = compared.data;
  const double least = kMinSpeedShareOfLag * quantile(compared.velocity.array().abs(), 0.9);
  std::vector<Eigen::Index> rows;
  for (Eigen::Index k = 0; k < data.rows(); ++k) {
    if (data.least_speed()(k) > least) rows.push_back(k);
  }
  const auto n = static_cast<Eigen::Index>(rows.size());
  if (n < kMinRowsOfLag) return std::nullopt;
  Eigen::MatrixXd columns(n, 5);
  columns << data.acceleration()(rows), compared.direction(rows), compared.velocity(rows),
      Eigen::VectorXd::Ones(n), compared.jerk(rows);
  const Eigen::VectorXd force = data.force()(rows);
  const Eigen::MatrixXd body = columns.leftCols(4);
  const double without = (force - body * least_squares(body, force)).squaredNorm();
  const Eigen::VectorXd theta = least_squares(columns, force);
  if (!((force - columns * theta).squaredNorm() < kMaxErrorRatioOfLag * without))
    return std::nullopt;
  const double lag_s = -theta(4) / theta(0);
  return std::isfinite(lag_s) ? std::optional(lag_s) : std::nullopt;
}

Eigen::ArrayXd advanced(const Eigen::ArrayXd& torque, double samples) {
  const double whole = std::floor(samples), part = samples - whole;
  const auto by = static_cast<Eigen::Index>(whole);
  Eigen::ArrayXd out = Eigen::ArrayXd::Constant(torque.size(), kAbsent);
  for (Eigen::Index k = std::max<Eigen::Index>(0, -by);
       k < torque.size() && k + by + 1 < torque.size(); ++k)
    out(k) = (1.0 - part) * torque(k + by) + part * torque(k + by + 1);
  return out;
}

Eigen::ArrayXd unfiltered(const Eigen::ArrayXd& torque, double samples) {
  Eigen::ArrayXd out = Eigen::ArrayXd::Constant(torque.size(), kAbsent);
  for (Eigen::Index k = 1; k + 1 < torque.size(); ++k)
    out(k) = torque(k) + 0.5 * samples * (torque(k + 1) - torque(k - 1));
  return out;
}

struct Fitted {
  TorqueLag lag;
  double left = HUGE_VAL;
};

/// Of one kind; nothing where the motion does not show it.
std::optional<Fitted> fitted(const std::vector<Segment>& segments, double bandwidth_hz,
                             bool filter) {
  Fitted out{{0.0, filter}, HUGE_VAL};
  for (int i = 0;; ++i) {
    const Compared compared(without_lag(segments, out.lag), bandwidth_hz);
    out.left = compared.left();
    if (i == kMaxRepetitions) break;
    const auto step_s = step_of_lag(compared);
    if (!step_s) break;
    out.lag.s += *step_s;
    if (std::abs(out.lag.s) > kMaxLag_s || (filter && out.lag.s <= 0.0)) return std::nullopt;
    if (std::abs(*step_s) < kMinChangeOfLag_s) break;
  }
  return out;
}

}  // namespace

std::vector<Segment> without_lag(std::vector<Segment> segments, const TorqueLag& lag) {
  for (Segment& s : segments) {
    if (s.torque.size() != s.size() || lag.s == 0.0) continue;
    const double samples = lag.s / s.sample_time_s;
    s.torque = lag.filter ? unfiltered(s.torque, samples) : advanced(s.torque, samples);
  }
  return segments;
}

TorqueLag torque_lag(const std::vector<Segment>& segments, double bandwidth_hz) {
  const auto delay = fitted(segments, bandwidth_hz, false),
             filter = fitted(segments, bandwidth_hz, true);
  if (filter && (!delay || filter->left < delay->left)) return filter->lag;
  return delay ? delay->lag : TorqueLag();
}

}  // namespace servotwin
