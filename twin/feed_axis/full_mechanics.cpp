#include "twin/feed_axis/full_mechanics.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

#include "twin/linear_algebra.h"

namespace servotwin {

int NutGrid::intervals() const {
  return std::max(1, static_cast<int>(std::ceil((to - from) / spacing - 1e-9)));
}

HeldMechanics held(const BallScrew& screw, double nut, double step_s) {
  const Eigen::Index n = screw.size();
  const Eigen::LDLT<Eigen::MatrixXd> mass(screw.mass);
  const Eigen::MatrixXd stiffness = mass.solve(screw.stiffness_at(nut));
  // Positions times the highest frequency are as large as velocities: the exponential of what is
  // balanced loses no digits.
  const double rate = std::sqrt(stiffness.norm());
  Eigen::MatrixXd a = Eigen::MatrixXd::Zero(2 * n + 2, 2 * n + 2);
  a.block(0, n, n, n).diagonal().setConstant(rate);
  a.block(n, 0, n, n) = -stiffness / rate;
  a.block(n, n, n, n) = -mass.solve(screw.damping_at(nut));
  a.block(n, 2 * n, n, 1) = mass.solve(screw.motor);
  a.block(n, 2 * n + 1, n, 1) = -mass.solve(screw.table);
  const Eigen::MatrixXd scaled = a * step_s;
  Eigen::MatrixXd step = exponential(scaled);
  step.topRows(n) /= rate;
  step.leftCols(n) *= rate;
  return {step.topLeftCorner(2 * n, 2 * n), step.block(0, 2 * n, 2 * n, 2)};
}

FullMechanics::FullMechanics(const BallScrew& screw, const NutGrid& grid, double step_s)
    : screw_(screw), grid_(grid) {
  for (int i = 0; i <= grid.intervals(); ++i) places_.push_back(held(screw, grid.at(i), step_s));
  left_ = right_ = q_ = Eigen::VectorXd::Zero(2 * screw.size());
}

void FullMechanics::reset(double /*nut*/) {
  q_.setZero();
  now_ = {};
}

void FullMechanics::step(double torque, double friction, double nut) noexcept {
  const double place = (nut - grid_.from) / (grid_.to - grid_.from) * grid_.intervals();
  const auto i = static_cast<std::size_t>(
      std::clamp(static_cast<int>(std::floor(place)), 0, grid_.intervals() - 1));
  const double share = place - static_cast<double>(i);
  const Eigen::Vector2d input(torque, friction);
  left_.noalias() = places_[i].phi * q_;
  left_.noalias() += places_[i].gain * input;
  right_.noalias() = places_[i + 1].phi * q_;
  right_.noalias() += places_[i + 1].gain * input;
  q_ = (1.0 - share) * left_ + share * right_;

  const Eigen::Index n = screw_.size();
  now_ = {screw_.radius * screw_.motor.dot(q_.head(n)),
          screw_.radius * screw_.motor.dot(q_.tail(n)), screw_.table.dot(q_.head(n)),
          screw_.table.dot(q_.tail(n))};
}

}  // namespace servotwin
