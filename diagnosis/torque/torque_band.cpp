#include "diagnosis/torque/torque_band.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <stdexcept>
#include <vector>

#include "diagnosis/torque/torque_body.h"
#include "diagnosis/torque/torque_rows.h"
#include "identification/recording/order_statistics.h"

namespace servotwin {

namespace {

constexpr double kFilterBandwidth_hz = 40.0;  // of the published figures (force_data.h), ..
constexpr double kMaxBandwidthShare = 0.15;   // .. and at most this share of the sampling rate
// Two octaves of a machine's motion lie below it: a narrower band would hold little else than
// friction.
constexpr double kMinBandwidth_hz = 4.0;
// Of the mass in the lowest band that shows it: noise that takes more than a fifth of it away is
// more than a quarter of the acceleration's power.
constexpr double kMinMassShare = 0.8;
constexpr double kMinLackEvidence = 2.0;  // in standard deviations of both masses
constexpr double kFrictionRise = 0.05;    // of the fast speeds: the mass hardly depends on it

struct Mass {
  double value = 0.0;  ///< positive where a torque accelerates and friction brakes
  double z = 0.0;
  [[nodiscard]] double deviation() const { return std::abs(value) / std::max(z, 1e-9); }
};

Mass mass_of(const TorqueRows& rows, bool rotary) {
  const double fast = quantile(rows.velocity().array().abs(), 0.9);
  const Eigen::MatrixXd body = rows.body(kFrictionRise * fast);
  Eigen::MatrixXd beside = body.rightCols(2);
  append(beside, Eigen::MatrixXd::Ones(body.rows(), 1));
  if (rotary) append(beside, rows.columns({kind_of<Cogging>(), {2.0 * std::numbers::pi}, 2}));
  const BlockedRegression data = training_of(rows);
  const Eigen::MatrixXd acceleration = rows.training(Eigen::MatrixXd(body.leftCols(1)));
  Mass out;
  out.z = data.wald(rows.training(beside), acceleration);
  append(beside, body.leftCols(1));
  const Eigen::MatrixXd all = rows.training(beside);
  const Eigen::VectorXd theta = data.fit(all);
  const double friction =
      (theta.head(2).array() * all.leftCols(2).colwise().norm().transpose().array()).sum();
  out.value = std::copysign(1.0, friction) * theta(theta.size() - 1);
  return out;
}

bool shown(const Mass& mass) { return mass.value > 0.0 && mass.z > kMinMassEvidence; }
bool falls_short(const Mass& mass, const Mass& reference) {
  if (!shown(mass)) return true;
  const double lacking = reference.value - mass.value;
  return lacking > (1.0 - kMinMassShare) * reference.value &&
         lacking > kMinLackEvidence * std::hypot(mass.deviation(), reference.deviation());
}

}  // namespace

double torque_band(const SegmentedAxis& axis, double training_share, bool commanded) {
  double band = std::min(kFilterBandwidth_hz, kMaxBandwidthShare / axis.sample_time_s);
  const auto mass_at = [&](double hz) {
    return mass_of(TorqueRows(axis, training_share, commanded, hz), axis.rotary);
  };
  std::vector<Mass> masses{mass_at(band)};
  try {
    for (double hz = 0.5 * band; hz >= kMinBandwidth_hz; hz *= 0.5) masses.push_back(mass_at(hz));
  } catch (const std::runtime_error&) {
    // Too little motion for the longer filters: the bands above it are compared.
  }
  while (masses.size() > 1 && !shown(masses.back())) masses.pop_back();
  if (!shown(masses.back())) return band;  // no band shows it
  for (const Mass& mass : masses) {
    if (!falls_short(mass, masses.back())) break;
    band *= 0.5;
  }
  return band;
}

}  // namespace servotwin
