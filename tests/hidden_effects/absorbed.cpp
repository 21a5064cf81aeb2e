#include "tests/hidden_effects/absorbed.h"

#include <cmath>
#include <vector>

namespace servotwin::hidden_effects {
namespace {

/// Copies of the machine, each with one parameter changed by 1 %.
std::vector<Rig> neighbours(const Rig& rig) {
  constexpr double kShare = 0.01;
  std::vector<Rig> out;
  const auto with = [&](const auto& change) {
    out.push_back(rig);
    change(out.back());
  };
  with([](Rig& r) { r.drive.position_gain *= 1.0 + kShare; });
  with([](Rig& r) { r.drive.velocity_gain *= 1.0 + kShare; });
  with([](Rig& r) { r.body.mass *= 1.0 + kShare; });
  with([](Rig& r) { r.drive.velocity_feedforward += kShare; });
  with([](Rig& r) { r.drive.acceleration_feedforward += kShare * r.body.mass; });
  with([](Rig& r) { r.friction.level *= 1.0 + kShare; });
  with([](Rig& r) { r.friction.viscous *= 1.0 + kShare; });
  if (rig.drive.integral_time > 0.0) {
    with([](Rig& r) { r.drive.integral_time *= 1.0 + kShare; });
  }
  return out;
}

Eigen::VectorXd difference(const Trace& a, const Trace& b) {
  const auto size = static_cast<Eigen::Index>(a.exact.size());
  return Eigen::Map<const Eigen::VectorXd>(a.exact.data(), size) -
         Eigen::Map<const Eigen::VectorXd>(b.exact.data(), size);
}

}  // namespace

Absorbed::Absorbed(const Rig& rig, const virtual_machine::Trajectory& command, const Trace& clean) {
  const auto rows = static_cast<Eigen::Index>(clean.exact.size());
  basis_.resize(rows, 0);
  for (const Rig& other : neighbours(rig)) {
    const Trace trace = simulate(other, command);
    if (trace.runaway) continue;
    // Modified Gram-Schmidt, twice, since the directions are nearly parallel.
    Eigen::VectorXd direction = difference(trace, clean);
    const double length = direction.norm();
    for (int pass = 0; pass < 2; ++pass) {
      for (Eigen::Index i = 0; i < basis_.cols(); ++i) {
        direction -= basis_.col(i) * basis_.col(i).dot(direction);
      }
    }
    if (!(direction.norm() > 1e-6 * length)) continue;
    basis_.conservativeResize(rows, basis_.cols() + 1);
    basis_.col(basis_.cols() - 1) = direction.normalized();
  }
}

double Absorbed::left_rms(const Trace& with, const Trace& without) const {
  if (with.runaway || without.runaway) return kNever;
  Eigen::VectorXd change = difference(with, without);
  change -= basis_ * (basis_.transpose() * change);
  return std::sqrt(change.squaredNorm() / static_cast<double>(change.size()));
}

}  // namespace servotwin::hidden_effects
