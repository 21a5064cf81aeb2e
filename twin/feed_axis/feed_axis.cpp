#include "twin/feed_axis/feed_axis.h"

#include <cmath>
#include <numbers>
#include <utility>

namespace servotwin {
namespace {

NutGrid grid_of(const NutParts& nut, double spacing) { return {nut.from, nut.to, spacing}; }

}  // namespace

TableFriction::TableFriction(const LuGreParts& parts, double step_s)
    : shape_{parts.coulomb / parts.stiffness, parts.breakaway / parts.coulomb,
             parts.stribeck_velocity, parts.stribeck_exponent, parts.damping / parts.stiffness},
      coulomb_(parts.coulomb),
      viscous_(parts.viscous),
      memory_(shape_) {
  motion_.step_s = step_s;
}

double TableFriction::step(double velocity) noexcept {
  motion_.velocity = velocity;
  motion_.displacement = velocity * motion_.step_s;
  const double before = memory_.bristle;
  double force[LuGre::kCoefficients.size()];
  LuGre::unit_forces(shape_, memory_, motion_, force);
  // The effect's bristle is that of the end of the cycle; what is held is its mean.
  const double middle = force[0] + (before - memory_.bristle) / 2.0;
  return coulomb_ * middle + viscous_ * force[1];
}

double steady_force(const LuGreParts& parts, double speed) {
  const double falling =
      std::exp(-std::pow(speed / parts.stribeck_velocity, parts.stribeck_exponent));
  return parts.coulomb + (parts.breakaway - parts.coulomb) * falling + parts.viscous * speed;
}

template <class Mechanics>
FeedAxis<Mechanics>::FeedAxis(const FeedAxisParts& parts, Mechanics mechanics)
    : control_(parts.control, parts.screw.lead / (2.0 * std::numbers::pi)),
      mechanics_(std::move(mechanics)),
      at_zero_(parts.nut.at_zero) {
  take_friction(parts);
}

template <class Mechanics>
void FeedAxis<Mechanics>::take_friction(const FeedAxisParts& parts) {
  friction_.reset();
  cover_.reset();
  if (parts.friction) friction_.emplace(*parts.friction, control_.step_s());
  if (parts.cover) cover_.emplace(*parts.cover, control_.step_s());
}

template <class Mechanics>
void FeedAxis<Mechanics>::start(double position) {
  start_ = position;
  control_.reset();
  mechanics_.reset(at_zero_ + position);
  if (friction_) friction_->reset();
  if (cover_) cover_->reset();
}

template <class Mechanics>
FeedAxisSample FeedAxis<Mechanics>::step(double command) noexcept {
  const MechanicsState now = mechanics_.state();
  FeedAxisSample out;
  out.motor_position = start_ + now.motor_position;
  out.table_position = start_ + now.table_position;
  out.motor_velocity = now.motor_velocity;
  out.torque = control_.step(command - start_, now.motor_position, now.motor_velocity);
  if (friction_) out.friction = friction_->step(now.table_velocity);
  if (cover_) out.cover = cover_->step(now.table_velocity);
  mechanics_.step(out.torque, out.friction + out.cover, at_zero_ + out.table_position);
  return out;
}

FullAxis full_axis(const FeedAxisParts& parts, const FullAxisOptions& options) {
  return {parts, FullMechanics(BallScrew(parts), grid_of(parts.nut, options.spacing),
                               1.0 / parts.control.rate_hz)};
}

ReducedAxis reduced_axis(const FeedAxisParts& parts, const ReducedAxisOptions& options) {
  const BallScrew screw(parts);
  const Eigen::MatrixXd basis = modal_basis(screw, parts.nut.from, parts.nut.to, options.modes);
  return {parts, ReducedMechanics(screw.in(basis), grid_of(parts.nut, options.spacing),
                                  1.0 / parts.control.rate_hz)};
}

template <class Mechanics>
FeedAxisRun run(FeedAxis<Mechanics>& axis, const Eigen::ArrayXd& command) {
  const Eigen::Index n = command.size();
  FeedAxisRun out{Eigen::ArrayXd(n), Eigen::ArrayXd(n), Eigen::ArrayXd(n), Eigen::ArrayXd(n),
                  Eigen::ArrayXd(n)};
  axis.start(n > 0 ? command(0) : 0.0);
  for (Eigen::Index k = 0; k < n; ++k) {
    const FeedAxisSample sample = axis.step(command(k));
    out.torque(k) = sample.torque;
    out.motor_position(k) = sample.motor_position;
    out.table_position(k) = sample.table_position;
    out.friction(k) = sample.friction;
    out.cover(k) = sample.cover;
  }
  return out;
}

template class FeedAxis<FullMechanics>;
template class FeedAxis<ReducedMechanics>;
template FeedAxisRun run(FullAxis& axis, const Eigen::ArrayXd& command);
template FeedAxisRun run(ReducedAxis& axis, const Eigen::ArrayXd& command);

}  // namespace servotwin
