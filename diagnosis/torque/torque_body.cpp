#include "diagnosis/torque/torque_body.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>
#include <stdexcept>
#include <vector>

#include "twin/linear_algebra.h"

namespace servotwin {

namespace {

// Share of the path in the rarer direction above which the motion counts as in both directions.
constexpr double kMinRarerDirectionShare = 0.15;
// RMS distance of the position from a straight line over time, over the travel. Below it the motion
// counts as one constant speed.
constexpr double kMaxDeviationFromLine = 0.02;
// Squared error with the gravity of a swinging load over that without, predicted from other blocks,
// below which it belongs to the body: the RMS falls by a tenth. It is two parameters, which ripple
// or friction would imitate for less.
constexpr double kMaxErrorRatioOfGravity = 0.81;

double sum_of(const std::vector<double>& values) {
  return std::accumulate(values.begin(), values.end(), 0.0);
}

/// Cosine and sine of the angle, filtered as the torque: the gravity of a load that swings.
Eigen::MatrixXd gravity_columns(const TorqueRows& rows) {
  return rows.columns({kind_of<Cogging>(), {2.0 * std::numbers::pi}, 2}).rowwise().reverse();
}

void turn(TorqueRows& rows, TorqueBody& body) {
  rows.turn_torque();
  body.opposite = !body.opposite;
}

TorqueBody fitted(TorqueRows& rows, const Eigen::MatrixXd& gravity, bool opposite);

}  // namespace

Eigen::Index TorqueBody::coulomb_column() const {
  return coulomb > 0.0 ? (mass > 0.0 ? 1 : 0) : -1;
}
Eigen::Index TorqueBody::viscous_column() const {
  return viscous > 0.0 ? (mass > 0.0 ? 1 : 0) + (coulomb > 0.0 ? 1 : 0) : -1;
}

BlockedRegression training_of(const TorqueRows& rows) {
  return {rows.training(rows.torque()), rows.training(rows.time())};
}

void append(Eigen::MatrixXd& to, const Eigen::MatrixXd& columns) {
  to.conservativeResize(columns.rows(), to.cols() + columns.cols());
  to.rightCols(columns.cols()) = columns;
}

TorqueBody body_of(TorqueRows& rows, bool rotary) {
  TorqueBody out = fitted(rows, Eigen::MatrixXd(rows.torque().size(), 0), false);
  if (!rotary || !out.both_ways) return out;
  const Eigen::MatrixXd gravity = gravity_columns(rows);
  Eigen::MatrixXd base = out.columns;
  append(base, Eigen::MatrixXd::Ones(base.rows(), 1));
  const BlockedRegression data = training_of(rows);
  const double with = sum_of(data.predicted(rows.training(base), rows.training(gravity)));
  if (!(with < kMaxErrorRatioOfGravity * sum_of(data.predicted(rows.training(base))))) return out;
  return fitted(rows, gravity, out.opposite);
}

namespace {

/// `opposite`: the sign of the torque in `rows` has been changed already.
TorqueBody fitted(TorqueRows& rows, const Eigen::MatrixXd& gravity, bool opposite) {
  TorqueBody out;
  out.opposite = opposite;
  // What is fitted beside mass and friction, so that they do not imitate it.
  Eigen::MatrixXd beside = gravity;
  const BlockedRegression data = training_of(rows);
  const Eigen::VectorXd velocity = rows.training(rows.velocity());
  const double forward = velocity.cwiseMax(0.0).sum() / velocity.cwiseAbs().sum();
  out.both_ways = std::min(forward, 1.0 - forward) > kMinRarerDirectionShare;
  append(beside, Eigen::MatrixXd::Ones(beside.rows(), 1));
  Eigen::MatrixXd line(velocity.size(), 2);
  line << Eigen::VectorXd::Ones(velocity.size()), rows.training(rows.time());
  const Eigen::VectorXd x = rows.training(rows.position());
  out.one_speed = (x - line * least_squares(line, x)).norm() <
                  kMaxDeviationFromLine * rows.travel() * std::sqrt(static_cast<double>(x.size()));
  // Velocity above which Coulomb friction has its full value, fitted together with a constant force
  // where the motion can distinguish one.
  double least = 1e300;
  for (double limit = 2e-5; limit < 2.1e-2; limit *= 1.78) {
    Eigen::MatrixXd trial = rows.body(limit);
    append(trial, beside);
    const Eigen::MatrixXd shown = rows.training(trial);
    const double left = (rows.training(rows.torque()) - shown * data.fit(shown)).squaredNorm();
    if (left < least) least = left, out.velocity_limit = limit, out.columns = trial;
  }
  const Eigen::MatrixXd shown = rows.training(out.columns);
  const Eigen::VectorXd theta = data.fit(shown);
  if (out.both_ways) {
    // Mass and friction are positive. Where they come out negative, the torque has the opposite
    // sign.
    const double work =
        (theta.head(3).array() * shown.leftCols(3).colwise().norm().transpose().array()).sum();
    if (work < 0.0) turn(rows, out);
  } else {
    // In one direction friction may be hidden by a constant force: the mass tells.
    Eigen::MatrixXd friction = shown.col(2);
    append(friction, shown.rightCols(beside.cols()));
    const double z = data.wald(friction, shown.leftCols(1));
    append(friction, shown.leftCols(1));
    if (z > kMinMassEvidence && data.fit(friction).tail(1)(0) < 0.0) turn(rows, out);
  }
  rows.friction_from(out.velocity_limit);
  out.columns = rows.body(out.velocity_limit);
  // A mass or friction with a negative estimate is not observable in this motion: it is removed.
  const BlockedRegression turned = training_of(rows);
  std::vector<int> kept = out.both_ways ? std::vector{0, 1, 2} : std::vector{0, 2};
  for (bool again = true; again && !kept.empty();) {
    Eigen::MatrixXd c(out.columns.rows(), 0);
    for (const int i : kept) append(c, out.columns.col(i));
    append(c, beside);
    const Eigen::VectorXd all = turned.fit(rows.training(c));
    again = false;
    for (std::size_t i = 0; i < kept.size(); ++i) {
      (kept[i] == 0   ? out.mass
       : kept[i] == 1 ? out.coulomb
                      : out.viscous) = std::max(0.0, all(static_cast<Eigen::Index>(i)));
      if (all(static_cast<Eigen::Index>(i)) >= 0.0) continue;
      kept.erase(kept.begin() + static_cast<std::ptrdiff_t>(i));
      again = true;
      break;
    }
  }
  Eigen::MatrixXd c(out.columns.rows(), 0);
  for (const int i : kept) append(c, out.columns.col(i));
  if (kept.empty() && out.both_ways) {
    throw std::runtime_error(
        "neither mass nor friction contributes to the torque: is it the torque of this axis?");
  }
  Eigen::MatrixXd all = c;
  append(all, beside);
  if (out.mass > 0.0) {
    const Eigen::MatrixXd training = rows.training(all);
    out.mass_z = turned.wald(training.rightCols(all.cols() - 1), training.leftCols(1));
  }
  const Eigen::VectorXd theta_of_all = turned.fit(rows.training(all));
  if (gravity.cols() > 0) {
    const double cosine = theta_of_all(c.cols()), sine = theta_of_all(c.cols() + 1);
    out.gravity = std::hypot(cosine, sine);
    out.gravity_at = std::atan2(sine, cosine);
    append(c, gravity);
  }
  if (!out.both_ways) {
    out.constant = theta_of_all(all.cols() - 1);
    append(c, beside.rightCols(1));
  }
  out.columns = c;
  return out;
}

}  // namespace

}  // namespace servotwin
