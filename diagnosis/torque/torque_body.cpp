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

// Share of the path or of the time in the rarer direction above which the motion counts as in both
// directions.
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

/// Of the rarer direction, the larger of its shares of the path and of the time.
double rarer_share(const Eigen::VectorXd& velocity) {
  const auto share = [](double forward) { return std::min(forward, 1.0 - forward); };
  const double of_path = velocity.cwiseMax(0.0).sum() / velocity.cwiseAbs().sum(),
               of_time = static_cast<double>((velocity.array() > 0.0).count()) /
                         static_cast<double>(velocity.size());
  return std::max(share(of_path), share(of_time));
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

/// Fills in what the motion shows, whatever the torque.
void look_at_motion(const TorqueRows& rows, TorqueBody& out) {
  const Eigen::VectorXd velocity = rows.training(rows.velocity());
  out.both_ways = rarer_share(velocity) > kMinRarerDirectionShare;
  Eigen::VectorXd all = rows.holdout(rows.velocity());
  all.conservativeResize(all.size() + velocity.size());
  all.tail(velocity.size()) = velocity;
  out.held_out_turns = !out.both_ways && rarer_share(all) > kMinRarerDirectionShare;
  Eigen::MatrixXd line(velocity.size(), 2);
  line << Eigen::VectorXd::Ones(velocity.size()), rows.training(rows.time());
  const Eigen::VectorXd x = rows.training(rows.position());
  out.one_speed = (x - line * least_squares(line, x)).norm() <
                  kMaxDeviationFromLine * rows.travel() * std::sqrt(static_cast<double>(x.size()));
}

/// Finds the velocity above which Coulomb friction has its full value, with the columns `beside`
/// fitted too. Returns the training rows of mass, Coulomb and viscous friction, then of `beside`.
Eigen::MatrixXd find_rise(const TorqueRows& rows, const Eigen::MatrixXd& beside, TorqueBody& out) {
  const BlockedRegression data = training_of(rows);
  Eigen::MatrixXd best;
  double least = 1e300;
  for (double limit = 2e-5; limit < 2.1e-2; limit *= 1.78) {
    Eigen::MatrixXd trial = rows.body(limit);
    append(trial, beside);
    Eigen::MatrixXd shown = rows.training(trial);
    const double left = (rows.training(rows.torque()) - shown * data.fit(shown)).squaredNorm();
    if (left < least) least = left, out.velocity_limit = limit, best = std::move(shown);
  }
  return best;
}

/// Whether mass and friction come out negative: the torque has the opposite sign. `shown`: as
/// find_rise() returns it.
bool is_opposite(const TorqueRows& rows, const Eigen::MatrixXd& shown, bool both_ways) {
  const BlockedRegression data = training_of(rows);
  if (both_ways) {
    const Eigen::VectorXd theta = data.fit(shown);
    return (theta.head(3).array() * shown.leftCols(3).colwise().norm().transpose().array()).sum() <
           0.0;
  }
  // In one direction friction may be hidden by a constant force: the mass tells.
  const Eigen::MatrixXd beside = shown.rightCols(shown.cols() - 2);
  return data.estimate(beside, shown.col(0)).z < -kMinMassEvidence;
}

/// Fills in mass and friction, with `beside` fitted too. Returns the columns of those that are not
/// negative: of the others this motion shows nothing.
Eigen::MatrixXd fit_positive(const TorqueRows& rows, const Eigen::MatrixXd& beside,
                             TorqueBody& out) {
  const Eigen::MatrixXd body = rows.body(out.velocity_limit);
  const BlockedRegression data = training_of(rows);
  std::vector<int> kept = out.both_ways ? std::vector{0, 1, 2} : std::vector{0, 2};
  for (;;) {
    Eigen::MatrixXd columns(body.rows(), 0);
    for (const int i : kept) append(columns, body.col(i));
    const Eigen::Index count = columns.cols();
    append(columns, beside);
    const Eigen::VectorXd theta = data.fit(rows.training(columns));
    auto negative = kept.end();
    for (std::size_t i = 0; i < kept.size(); ++i) {
      const double value = theta(static_cast<Eigen::Index>(i));
      (kept[i] == 0 ? out.mass : kept[i] == 1 ? out.coulomb : out.viscous) = std::max(0.0, value);
      if (value < 0.0 && negative == kept.end())
        negative = kept.begin() + static_cast<std::ptrdiff_t>(i);
    }
    if (negative == kept.end()) return columns.leftCols(count);
    kept.erase(negative);
  }
}

/// `opposite`: the sign of the torque in `rows` has been changed already.
TorqueBody fitted(TorqueRows& rows, const Eigen::MatrixXd& gravity, bool opposite) {
  TorqueBody out;
  out.opposite = opposite;
  look_at_motion(rows, out);
  // What is fitted beside mass and friction, so that they do not imitate it.
  Eigen::MatrixXd beside = gravity;
  append(beside, Eigen::MatrixXd::Ones(beside.rows(), 1));
  const Eigen::MatrixXd shown = find_rise(rows, beside, out);
  if (is_opposite(rows, shown, out.both_ways)) turn(rows, out);
  rows.friction_from(out.velocity_limit);
  out.columns = fit_positive(rows, beside, out);
  if (out.columns.cols() == 0 && out.both_ways) {
    throw std::runtime_error(
        "neither mass nor friction contributes to the torque: is it the torque of this axis?");
  }
  Eigen::MatrixXd all = out.columns;
  append(all, beside);
  const Eigen::MatrixXd training = rows.training(all);
  const BlockedRegression data = training_of(rows);
  if (out.mass > 0.0)
    out.mass_z = data.estimate(training.rightCols(all.cols() - 1), training.col(0)).z;
  const Eigen::VectorXd theta = data.fit(training);
  if (gravity.cols() > 0) {
    const double cosine = theta(out.columns.cols()), sine = theta(out.columns.cols() + 1);
    out.gravity = std::hypot(cosine, sine);
    out.gravity_at = std::atan2(sine, cosine);
    append(out.columns, gravity);
  }
  if (!out.both_ways) {
    out.constant = theta(theta.size() - 1);
    append(out.columns, beside.rightCols(1));
  }
  return out;
}

}  // namespace

}  // namespace servotwin
