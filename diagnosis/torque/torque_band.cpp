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
// Of the mass in the lowest band that shows it: noise that takes more than a tenth of it away is
// more than a ninth of the acceleration's power.
constexpr double kMinMassShare = 0.9;
constexpr double kMinLackEvidence = 2.0;  // in standard deviations of both masses
constexpr double kFrictionRise = 0.05;    // of the fast speeds: the mass hardly depends on it

using Estimate = BlockedRegression::Estimate;

/// Of the torque against the motion by its friction: 1 or -1; 0 where the motion does not show it.
int friction_sign(const TorqueRows& rows) {
  const Eigen::VectorXd direction = rows.training(rows.velocity()).array().sign();
  const Eigen::MatrixXd beside = Eigen::MatrixXd::Ones(direction.size(), 1);
  const Estimate friction = training_of(rows).estimate(beside, direction);
  return std::abs(friction.z) < kMinMassEvidence ? 0 : friction.value > 0.0 ? 1 : -1;
}

Estimate mass_of(const TorqueRows& rows, bool rotary) {
  const double fast = quantile(rows.velocity().array().abs(), 0.9);
  const Eigen::MatrixXd body = rows.body(kFrictionRise * fast);
  Eigen::MatrixXd beside = body.rightCols(2);
  append(beside, Eigen::MatrixXd::Ones(body.rows(), 1));
  if (rotary) append(beside, rows.columns({kind_of<Cogging>(), {2.0 * std::numbers::pi}, 2}));
  return training_of(rows).estimate(rows.training(beside),
                                    rows.training(Eigen::VectorXd(body.col(0))));
}

bool shown(const Estimate& mass) { return std::abs(mass.z) > kMinMassEvidence; }
bool falls_short(const Estimate& mass, const Estimate& reference) {
  if (!shown(mass)) return true;
  // The sign is that of the recorded torque, the same in all bands.
  const double lacking = std::copysign(1.0, reference.value) * (reference.value - mass.value);
  return lacking > (1.0 - kMinMassShare) * std::abs(reference.value) &&
         lacking > kMinLackEvidence * std::hypot(mass.deviation, reference.deviation);
}

}  // namespace

double widest_torque_band(double sample_time_s) {
  return std::min(kFilterBandwidth_hz, kMaxBandwidthShare / sample_time_s);
}

double torque_band(const SegmentedAxis& axis, double training_share) {
  double band = widest_torque_band(axis.sample_time_s);
  const auto rows_at = [&](double hz) { return TorqueRows(axis, training_share, false, hz); };
  const TorqueRows widest = rows_at(band);
  // A mass of the sign opposite to that of friction is a spring of the load.
  const int sign = friction_sign(widest);
  std::vector<Estimate> masses{mass_of(widest, axis.rotary)};
  try {
    for (double hz = 0.5 * band; hz >= kMinBandwidth_hz; hz *= 0.5)
      masses.push_back(mass_of(rows_at(hz), axis.rotary));
  } catch (const std::runtime_error&) {
    // Too little motion for the longer filters: the bands above it are compared.
  }
  const auto is_a_mass = [&](const Estimate& mass) {
    return shown(mass) && sign * mass.value >= 0.0;
  };
  while (masses.size() > 1 && !is_a_mass(masses.back())) masses.pop_back();
  if (!is_a_mass(masses.back())) return band;  // no band shows it
  for (const Estimate& mass : masses) {
    if (!falls_short(mass, masses.back())) break;
    band *= 0.5;
  }
  return band;
}

}  // namespace servotwin
