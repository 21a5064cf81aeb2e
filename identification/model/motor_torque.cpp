#include "identification/model/motor_torque.h"

#include <algorithm>
#include <cmath>

#include "twin/twin.h"

namespace servotwin {

Eigen::ArrayXd lagged(const Eigen::ArrayXd& torque, const TorqueLag& lag, double sample_time_s) {
  if (lag.s == 0.0 || torque.size() == 0) return torque;
  const double samples = lag.s / sample_time_s;
  Eigen::ArrayXd out(torque.size());
  if (lag.filter) {
    const double share = 1.0 - std::exp(-1.0 / samples);
    out(0) = torque(0);
    for (Eigen::Index k = 1; k < torque.size(); ++k)
      out(k) = out(k - 1) + share * (torque(k) - out(k - 1));
    return out;
  }
  // Linear between samples; the first and the last value last.
  const double whole = std::floor(-samples), part = -samples - whole;
  const auto by = static_cast<Eigen::Index>(whole);
  const auto at = [&](Eigen::Index k) {
    return torque(std::clamp<Eigen::Index>(k, 0, torque.size() - 1));
  };
  for (Eigen::Index k = 0; k < torque.size(); ++k)
    out(k) = (1.0 - part) * at(k + by) + part * at(k + by + 1);
  return out;
}

Eigen::ArrayXd simulated_torque(const Model& model, const TorqueScale& by, const TorqueLag& lag,
                                const Segment& segment) {
  constexpr Outputs kTorque{.torque = true};
  const Eigen::ArrayXd simulated = simulate(model, segment, kTorque);
  const auto of = [&](Eigen::Index output) {
    return simulated(Eigen::seqN(output, segment.size(), kTorque.per_sample()));
  };
  return lagged(
      by.scale * of(kTorque.torque_at()) + by.viscous * of(kTorque.torque_at() + 1) + by.offset,
      lag, segment.sample_time_s);
}

}  // namespace servotwin
