#include "diagnosis/torque/torque_rows.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <stdexcept>

#include "identification/least_squares/unit_columns.h"
#include "identification/recording/order_statistics.h"
#include "twin/linear_algebra.h"

namespace servotwin {

namespace {

constexpr double kMaxRestShareOfFast = 0.01;  // of the 90 % quantile of the speeds
constexpr Eigen::Index kMinRows = 40;
// Periods over the travel: at most, and at most for position-dependent friction.
constexpr double kMaxPeriods = 400.0, kMaxSlowPeriods = 5.0;
constexpr double kMinFrequency_hz = 0.5;
// Share of the motion in which a ripple must lie within the bandwidth of the filters.
constexpr double kMinInBandShare = 0.3;

/// The same motion with the tracking error in place of the torque.
std::vector<Segment> with_tracking_error(std::vector<Segment> segments) {
  for (Segment& s : segments) {
    if (s.torque.size() == 0) continue;
    s.torque = s.torque.isFinite().select(s.command - s.actual, kAbsent);
  }
  return segments;
}

}  // namespace

template <class Value>
Eigen::VectorXd TorqueRows::compared(const Value& value) const {
  Eigen::VectorXd all(data_.rows());
  Eigen::Index row = 0;
  for (const std::vector<Motion>& motion : motion_) {
    Eigen::ArrayXd samples(static_cast<Eigen::Index>(motion.size()));
    for (Eigen::Index k = 0; k < samples.size(); ++k)
      samples(k) = value(motion[static_cast<std::size_t>(k)]);
    const Eigen::VectorXd part = data_.compared(samples);
    all.segment(row, part.size()) = part;
    row += part.size();
  }
  return used_.empty() ? all : under_way(all);
}

TorqueRows::TorqueRows(const SegmentedAxis& axis, double training_share, bool commanded,
                       double bandwidth_hz)
    : bandwidth_hz_(bandwidth_hz), rotary_(axis.rotary) {
  data_ = ForceData::of_motion(axis.segments, bandwidth_hz_);
  for (const ForceData::Stretch& stretch : data_.stretches()) {
    motion_.push_back(stretch.motion);
    // The force on the body depends on its actual acceleration, not on the commanded one.
    for (std::size_t k = 0; k < motion_.back().size(); ++k) {
      Motion& m = motion_.back()[k];
      m.acceleration = m.command_acceleration = stretch.acceleration(static_cast<Eigen::Index>(k));
      if (!commanded) m.command_velocity = m.velocity;
    }
  }
  const Eigen::VectorXd speed = compared([](const Motion& m) { return m.velocity; });
  const double least = kMaxRestShareOfFast * quantile(speed.array().abs(), 0.9);
  const double fastest = speed.cwiseAbs().maxCoeff();
  for (Eigen::Index row = 0; row < speed.size(); ++row) {
    if (std::abs(speed(row)) > std::max(least, 1e-3 * fastest)) used_.push_back(row);
  }
  if (static_cast<Eigen::Index>(used_.size()) < kMinRows) {
    throw std::runtime_error(axis.axis + ": the axis moves with a recorded torque for only " +
                             std::to_string(static_cast<double>(used_.size()) * data_.step_s()) +
                             " s, too short to explain its torque; record more motion");
  }
  torque_ = under_way(data_.force());
  time_ = under_way(data_.time());
  acceleration_ = under_way(data_.acceleration());
  velocity_ = speed(used_);
  position_ = compared([](const Motion& m) { return m.position; });
  travel_ = position_.maxCoeff() - position_.minCoeff();
  begin_s_ = axis.segments.front().start_s;
  if (commanded) {
    tracking_error_ =
        under_way(ForceData::of_motion(with_tracking_error(axis.segments), bandwidth_hz_).force());
  }

  double samples = 0.0;
  for (const Segment& s : axis.segments) samples += static_cast<double>(s.size());
  double left = training_share * samples;
  for (const Segment& s : axis.segments) {
    training_to_s_ = s.start_s + s.sample_time_s * std::min(left, static_cast<double>(s.size()));
    left -= static_cast<double>(s.size());
    if (left <= 0.0) break;
  }
  for (Eigen::Index row = 0; row < time_.size(); ++row)
    (time_(row) < training_to_s_ ? training_ : holdout_).push_back(row);
  if (static_cast<Eigen::Index>(training_.size()) < kMinRows)
    throw std::runtime_error(axis.axis + ": the axis moves too little in the training data");
  if (holdout_.empty())
    throw std::runtime_error(axis.axis + ": the axis does not move in the held-out data");
}

void TorqueRows::turn_torque() {
  sign_ = -sign_;
  torque_ = -torque_;
}

void TorqueRows::friction_from(double velocity_limit) {
  for (std::vector<Motion>& motion : motion_) {
    for (Motion& m : motion) m.friction = std::clamp(m.velocity / velocity_limit, -1.0, 1.0);
  }
}

Eigen::MatrixXd TorqueRows::body(double velocity_limit) const {
  Eigen::MatrixXd out(torque_.size(), 3);
  out.col(0) = acceleration_;
  out.col(1) = compared([velocity_limit](const Motion& m) {
    return std::clamp(m.velocity / velocity_limit, -1.0, 1.0);
  });
  out.col(2) = velocity_;
  return out;
}

Eigen::MatrixXd TorqueRows::columns(const TorqueTerm& term) const {
  Eigen::MatrixXd all;
  Eigen::Index row = 0;
  for (const std::vector<Motion>& motion : motion_) {
    const auto n = static_cast<Eigen::Index>(motion.size());
    Eigen::ArrayXXd force;
    if (term.kind == kEffectKinds) {
      Eigen::ArrayXd position(n);
      for (Eigen::Index k = 0; k < n; ++k)
        position(k) = motion[static_cast<std::size_t>(k)].position;
      // Separate levels for the two directions.
      const Eigen::ArrayXd unit =
          force_through_gap(position, term.shapes[0], term.shapes[1], term.shapes[2]);
      force.resize(n, 2);
      force << unit.max(0.0), unit.min(0.0);
    } else {
      force = unit_columns(term.kind, term.shapes.data(), motion, false).force;
    }
    const Eigen::Index count = term.first > 0 ? term.first : force.cols();
    if (all.size() == 0) all.resize(data_.rows(), count);
    Eigen::Index rows = 0;
    for (Eigen::Index c = 0; c < count; ++c) {
      const Eigen::VectorXd part = data_.compared(force.col(c));
      rows = part.size();
      all.col(c).segment(row, rows) = part;
    }
    row += rows;
  }
  return all(used_, Eigen::all);
}

Eigen::MatrixXd TorqueRows::rough_waves(std::size_t kind, double first_shape) const {
  const bool of_time = kind == kind_of<PeriodicDisturbance>();
  Eigen::MatrixXd out(torque_.size(), 2);
  double passing = 0.0;
  for (Eigen::Index row = 0; row < out.rows(); ++row) {
    const double hz = of_time ? first_shape : std::abs(velocity_(row)) / first_shape;
    const double turns = of_time ? first_shape * time_(row) : position_(row) / first_shape;
    const double in_band = hz < bandwidth_hz_ ? 1.0 : 0.0;
    out(row, 0) = in_band * std::sin(2.0 * std::numbers::pi * turns);
    out(row, 1) = in_band * std::cos(2.0 * std::numbers::pi * turns);
    passing += in_band;
  }
  if (passing < kMinInBandShare * static_cast<double>(out.rows())) out.setZero();
  return out;
}

std::vector<std::vector<double>> TorqueRows::grid(std::size_t kind, double velocity_limit) const {
  const auto shapes = shapes_of(kind);
  std::vector<double> start;
  for (const Parameter& p : shapes) {
    start.push_back(p.name == "velocity_limit" ? std::clamp(velocity_limit, p.lower, p.upper)
                                               : p.start);
  }
  std::vector<std::vector<double>> out;
  if (shapes.empty() || shapes.front().name == "velocity_limit") return {start};
  const Parameter& p = shapes.front();
  const auto add = [&](double value) {
    if (!(value > p.lower) || !(value < p.upper)) return;
    out.push_back(start);
    out.back().front() = value;
  };
  const double end_s = time_(training_.back());
  switch (p.scan) {
    case Scan::kPeriod: {
      const bool slow = kind == kind_of<PositionDependentFriction>();
      // A rotary ripple repeats after a revolution: whole orders per revolution.
      for (int order = 1; rotary_ && !slow && order < 400; ++order) {
        const double period = 2.0 * std::numbers::pi / order;
        if (travel_ / period >= 1.5 && travel_ / period < kMaxPeriods) add(period);
      }
      if (rotary_ && !slow) break;
      for (double turns = slow ? 0.75 : 1.5; turns < (slow ? kMaxSlowPeriods : kMaxPeriods);
           turns += 0.5)
        add(travel_ / turns);
      break;
    }
    case Scan::kFrequency:
      for (double hz = kMinFrequency_hz; hz < 0.9 * bandwidth_hz_; hz += 0.5 / (end_s - begin_s_))
        add(hz);
      break;
    case Scan::kTime:
      for (int i = 2; i < 19; ++i) add(begin_s_ + (end_s - begin_s_) * i / 20.0);
      break;
    default:
      for (const double factor : {0.03, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0}) add(factor * p.start);
      if (kind == kind_of<Presliding>()) {
        const std::size_t scales = out.size();
        for (std::size_t i = 0; i < scales; ++i) {
          for (const double factor : {0.1, 0.9}) {
            out.push_back(out[i]);
            out.back()[1] = factor;
          }
        }
      }
  }
  if (out.empty()) out.push_back(start);
  return out;
}

std::vector<PositionForce> TorqueRows::stretches(double mass) const {
  std::vector<PositionForce> out;
  Eigen::Index row = 0;
  for (const std::vector<Motion>& motion : motion_) {
    Eigen::ArrayXd samples(static_cast<Eigen::Index>(motion.size()));
    for (Eigen::Index k = 0; k < samples.size(); ++k)
      samples(k) = motion[static_cast<std::size_t>(k)].position;
    PositionForce one;
    one.position = data_.compared(samples).array();
    const Eigen::Index n = one.position.size();
    one.start_s = data_.time()(row);
    one.step_s = data_.step_s();
    one.force = sign_ * data_.force().segment(row, n).array() -
                mass * data_.acceleration().segment(row, n).array();
    row += n;
    out.push_back(std::move(one));
  }
  return out;
}

std::vector<double> TorqueRows::tracking_error_at(const std::vector<double>& periods) const {
  if (tracking_error_.size() == 0) return std::vector<double>(periods.size(), kAbsent);
  const auto count = static_cast<Eigen::Index>(periods.size());
  Eigen::MatrixXd c(torque_.size(), 3 + 2 * count);
  c.col(0).setOnes();
  c.col(1) = velocity_;
  c.col(2) = acceleration_;
  for (Eigen::Index i = 0; i < count; ++i) {
    c.middleCols(3 + 2 * i, 2) =
        columns({kind_of<Cogging>(), {periods[static_cast<std::size_t>(i)]}, 2});
  }
  const Eigen::VectorXd theta = least_squares(c, tracking_error_);
  std::vector<double> out;
  for (Eigen::Index i = 0; i < count; ++i)
    out.push_back(std::hypot(theta(3 + 2 * i), theta(4 + 2 * i)));
  return out;
}

}  // namespace servotwin
