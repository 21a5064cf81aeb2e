#include "tests/support/thesis_study.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>
#include <stdexcept>
#include <string>
#include <unsupported/Eigen/MatrixFunctions>
#include <vector>

#include "tests/virtual_machine/trajectory.h"

namespace servotwin {
namespace {

using Eigen::ArrayXd;
using Eigen::Matrix3d;
using Eigen::MatrixXd;
using Eigen::Vector3d;

constexpr double kSampleTime = 0.6e-3;  // [s]
constexpr double kPositionGain = 75.0;  // [1/s]
constexpr double kLevel = 286.0;        // [mm/s^2]
constexpr double kBreakaway = 0.02;     // [mm]
constexpr double kShape = 0.7;
constexpr int kElements = 10;

virtual_machine::Trajectory command_of_the_study() {
  const virtual_machine::Limits limits{.velocity = 96.0, .acceleration = 451.0, .jerk = 3.82e4};
  virtual_machine::Trajectory command;
  command.dwell(0.2);
  for (int k = 1; k <= 18; ++k)
    command.move_to((k % 2 == 1 ? 1.0 : -1.0) * 11.0 * k / 18.0, limits);
  command.move_to(0.0, limits);
  command.dwell(0.5);
  return command;
}

/// z' = A z + B_r x_r - B_d d with z = [x, v, q].
struct Loop {
  Matrix3d a;
  Vector3d command;
  Vector3d friction;
};

Loop loop_of_the_study() {
  const double p = 2.0 * std::numbers::pi * 9.87;
  const double w = 2.0 * std::numbers::pi * 31.31;
  const double zeta = 0.44;
  const double a1 = p + 2.0 * zeta * w;
  const double a2 = w * w + 2.0 * zeta * w * p;
  const double a3 = p * w * w;
  // Without feed-forward the three coefficients and Kp determine the three normalised gains.
  const double beta = a3 / kPositionGain;
  const double alpha = (a2 - beta) / kPositionGain;
  const double viscous = a1 - alpha;
  Loop loop;
  loop.a << 0.0, 1.0, 0.0,                               //
      -alpha * kPositionGain, -(viscous + alpha), beta,  //
      -kPositionGain, -1.0, 0.0;
  loop.command << 0.0, alpha * kPositionGain, kPositionGain;
  loop.friction << 0.0, 1.0, 0.0;
  return loop;
}

/// Response over one step: the first three columns propagate the state, column 3 + k the k-th
/// derivative of the input at the start of the step.
MatrixXd step_response(const Matrix3d& a, const Vector3d& b, double step, int derivatives) {
  const Eigen::Index n = 3 + derivatives;
  MatrixXd m = MatrixXd::Zero(n, n);
  m.topLeftCorner<3, 3>() = a;
  m.block<3, 1>(0, 3) = b;
  for (Eigen::Index k = 3; k + 1 < n; ++k) m(k, k + 1) = 1.0;
  return MatrixXd((m * step).exp()).topRows<3>();
}

/// Solves delta + gain * d(delta) = wanted and moves the elements there; returns the new total
/// force. The left side rises, and bends only where an element reaches its level, so that walking
/// the bends in their order is exact.
class Elements {
 public:
  explicit Elements(const ThesisFriction& f)
      : stiffness_(f.stiffness),
        level_(f.level),
        force_(ArrayXd::Zero(f.level.size())),
        order_(static_cast<std::size_t>(f.level.size())) {}

  double couple(double wanted, double gain) {
    const double demand = wanted - gain * force_.sum();
    const double sign = demand < 0.0 ? -1.0 : 1.0;
    const ArrayXd room = (level_ - sign * force_).max(0.0);
    std::iota(order_.begin(), order_.end(), Eigen::Index{0});
    std::sort(order_.begin(), order_.end(), [&](Eigen::Index i, Eigen::Index k) {
      return room[i] * stiffness_[k] < room[k] * stiffness_[i];
    });
    double spring = stiffness_.sum();
    double yielded = 0.0;
    double delta = 0.0;
    for (const Eigen::Index i : order_) {
      delta = (std::abs(demand) - gain * yielded) / (1.0 + gain * spring);
      if (delta * stiffness_[i] <= room[i]) break;
      spring -= stiffness_[i];
      yielded += room[i];
      delta = (std::abs(demand) - gain * yielded) / (1.0 + gain * spring);
    }
    force_ += sign * (stiffness_ * delta).min(room);
    return force_.sum();
  }

 private:
  ArrayXd stiffness_, level_, force_;
  std::vector<Eigen::Index> order_;
};

}  // namespace

ThesisFriction thesis_friction() {
  // Virgin curve x(t), f(t) = 1 - x(1 - t), 0 <= t <= 1: the quartic with vertical start,
  // horizontal end and midpoint ((1 - shape) / 2, (1 + shape) / 2); length 8 shape - 3 is the
  // shortest that stays in the box.
  constexpr double kLength = 8.0 * kShape - 3.0;
  const auto x = [](double t) {
    return t * t *
           ((3.0 + kLength - 8.0 * kShape) + (16.0 * kShape - 3.0 * kLength - 2.0) * t +
            (2.0 * kLength - 8.0 * kShape) * t * t);
  };
  const auto f = [&](double t) { return 1.0 - x(1.0 - t); };
  const auto slope = [&](int j) {  // of chord j = 1..kElements; beyond the end the curve is flat
    if (j > kElements) return 0.0;
    const double begin = (j - 1.0) / kElements;
    const double end = static_cast<double>(j) / kElements;
    return (f(end) - f(begin)) / (x(end) - x(begin));
  };
  ThesisFriction friction{ArrayXd(kElements), ArrayXd(kElements)};
  for (int j = 1; j <= kElements; ++j) {
    const double bend = slope(j) - slope(j + 1);
    friction.stiffness[j - 1] = kLevel / kBreakaway * bend;
    friction.level[j - 1] = kLevel * bend * x(static_cast<double>(j) / kElements);
  }
  return friction;
}

ThesisStudy thesis_study(double internal_step_s) {
  const double steps_per_sample = std::round(kSampleTime / internal_step_s);
  if (!(internal_step_s > 0.0) || steps_per_sample < 1.0 ||
      std::abs(steps_per_sample * internal_step_s - kSampleTime) > 1e-9 * kSampleTime) {
    throw std::invalid_argument("thesis study: an internal step of " +
                                std::to_string(internal_step_s) +
                                " s does not go into the sampling time of 0.0006 s");
  }
  const auto substeps = static_cast<Eigen::Index>(steps_per_sample);
  const double h = kSampleTime / steps_per_sample;

  const virtual_machine::Trajectory command = command_of_the_study();
  const Loop loop = loop_of_the_study();
  const MatrixXd by_command = step_response(loop.a, loop.command, h, 4);
  const MatrixXd by_friction = step_response(loop.a, loop.friction, h, 2);
  // Friction is linear over the step: d(t_n + s) = d_n + (d_(n+1) - d_n) s / h.
  const Vector3d of_next = by_friction.col(4) / h;
  const Vector3d of_present = by_friction.col(3) - of_next;

  const auto samples = static_cast<Eigen::Index>(std::floor(command.duration() / kSampleTime)) + 1;
  ThesisStudy study;
  study.sample_time_s = kSampleTime;
  study.command_mm.resize(samples);
  study.actual_mm.resize(samples);
  study.velocity.resize(samples);
  study.friction_mm_s2.resize(samples);

  Elements elements(thesis_friction());
  Vector3d z = Vector3d::Zero();
  double d = 0.0;
  for (Eigen::Index n = 0; n < samples * substeps; ++n) {
    const virtual_machine::Setpoint r = command.at(static_cast<double>(n) * h);
    if (n % substeps == 0) {
      const Eigen::Index row = n / substeps;
      study.command_mm[row] = r.position;
      study.actual_mm[row] = z[0];
      study.velocity[row] = z[1];
      study.friction_mm_s2[row] = d;
    }
    const Vector3d free = by_command.leftCols<3>() * z +
                          by_command.rightCols<4>() *
                              Eigen::Vector4d(r.position, r.velocity, r.acceleration, r.jerk) -
                          of_present * d;
    d = elements.couple(free[0] - z[0], of_next[0]);
    z = free - of_next * d;
  }
  return study;
}

Eigen::ArrayXd quantised(const Eigen::ArrayXd& samples, double step) {
  if (!(step >= 0.0) || !std::isfinite(step)) {
    throw std::invalid_argument("quantised: the step is " + std::to_string(step) +
                                ", must be 0 or positive");
  }
  if (step == 0.0) return samples;
  return samples.unaryExpr([step](double x) { return std::nearbyint(x / step) * step; });
}

}  // namespace servotwin
