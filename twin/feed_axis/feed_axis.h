// A feed axis built from its parts: drive control, ball screw, friction of guideways and cover on
// the table (Ferkl et al. 2021; docs/theory.md 16). Every cycle:
//
//   measured: motor position and velocity; friction at the table's velocity, held over the cycle
//   torque = control(command, measured)
//   motor and table move under torque and friction
//
// Friction is the LuGre law of the catalogue (twin/effects/lugre.h); the held force is that of the
// middle of the cycle. The mechanics are FullMechanics, or ReducedMechanics for speed.
//
// Positions are those of the axis [m]; at 0 the nut is at parts.nut.at_zero from the bearing.
// Outside of the nut's travel the nut is simulated at the end of it. Errors: only those of
// ReducedMechanics. One thread; step() allocates nothing.
#pragma once

#include <Eigen/Core>
#include <optional>

#include "twin/effects/lugre.h"
#include "twin/feed_axis/drive_control.h"
#include "twin/feed_axis/full_mechanics.h"
#include "twin/feed_axis/reduced_mechanics.h"

namespace servotwin {

/// LuGre friction, held over a cycle.
class TableFriction {
 public:
  TableFriction(const LuGreParts& parts, double step_s);
  void reset() noexcept { memory_.bristle = 0.0; }
  [[nodiscard]] double step(double velocity) noexcept;  ///< [N]

 private:
  double shape_[LuGre::kShapes.size()];
  double coulomb_, viscous_;
  Motion motion_;
  LuGre::Memory<double> memory_;
};

/// Friction at a constant speed [m/s], against the motion [N]; at 0 the limit from motion.
[[nodiscard]] double steady_force(const LuGreParts& parts, double speed);

struct FeedAxisSample {
  double torque = 0.0;                                ///< [Nm]
  double motor_position = 0.0, table_position = 0.0;  ///< [m]
  double motor_velocity = 0.0;                        ///< [m/s]
  double friction = 0.0, cover = 0.0;                 ///< [N]
};

struct FullAxisOptions {
  double spacing = 5e-3;  ///< spacing of the grid of nut positions [m]
};
struct ReducedAxisOptions {
  double spacing = 2e-3;  ///< spacing of the grid of nut positions [m]
  int modes = 3;          ///< modes at each of five positions, beside the rigid motion
};

template <class Mechanics>
class FeedAxis {
 public:
  /// Starts at rest at `position` [m], which is also the command.
  void start(double position);
  /// The measured values at the start of the cycle, and the torque during it.
  [[nodiscard]] FeedAxisSample step(double command) noexcept;

  FeedAxis(const FeedAxisParts& parts, Mechanics mechanics);
  /// Replaces friction and cover by those of these parts; call start() afterwards.
  void take_friction(const FeedAxisParts& parts);

 private:
  DriveControl control_;
  Mechanics mechanics_;
  std::optional<TableFriction> friction_, cover_;
  double at_zero_ = 0.0, start_ = 0.0;
};

using FullAxis = FeedAxis<FullMechanics>;
using ReducedAxis = FeedAxis<ReducedMechanics>;

[[nodiscard]] FullAxis full_axis(const FeedAxisParts& parts, const FullAxisOptions& options = {});
[[nodiscard]] ReducedAxis reduced_axis(const FeedAxisParts& parts,
                                       const ReducedAxisOptions& options = {});

/// The axis along a motion from rest, one sample per cycle; units as in FeedAxisSample.
struct FeedAxisRun {
  Eigen::ArrayXd torque, motor_position, table_position, friction, cover;
};
template <class Mechanics>
[[nodiscard]] FeedAxisRun run(FeedAxis<Mechanics>& axis, const Eigen::ArrayXd& command);

}  // namespace servotwin
