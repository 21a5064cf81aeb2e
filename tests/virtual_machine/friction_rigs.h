// The two test rigs whose friction is published, with the published friction as their truth.
//
//   drive_chain   ball-screw axis of a parallel robot, taken off its leg: directed Stribeck
//                 friction. Giberti et al. 2019, Table 1.
//   cover_rig     feed axis with and without its telescopic cover: LuGre friction of the drive,
//                 and a second one of the cover. Ferkl et al. 2021, Table 1 and section 2.
//
// What the papers do not print is assumed, and said so where it is set. SI units. Errors:
// std::invalid_argument for what is out of range. Any thread.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "tests/virtual_machine/axis.h"
#include "tests/virtual_machine/velocity_ramps.h"

namespace servotwin::virtual_machine {

/// Table 1. Fc+ is printed as 6111.8 N, more than the static 944.2 N and six times what the motor
/// can give; the shifted point makes it 611.18 N, about as much below Fs+ as Fc- is below Fs-.
[[nodiscard]] DirectedStribeck drive_chain_friction();
/// F at a steady velocity [N], signed.
[[nodiscard]] double steady_force(const DirectedStribeck& friction, double velocity);

/// Recorded torque in N m over a lead of 40 mm, every 4 ms. P-PI without feed-forward. Friction
/// falls by up to S = 36 N per mm/s (at 1.9 mm/s), which the loop must hold against:
///   (Kv - S) (Ki + Kp Kv) > m Kp Ki                                     (Routh)
/// is true from Kv = 38 kN s/m on with the other gains in proportion; the axis has 50 kN s/m and
/// moves steadily at all velocities of the paper, 0.0243 to 50.72 mm/s.
[[nodiscard]] Axis drive_chain_axis(double torque_noise = 0.02);

/// For every velocity a ramp up and a ramp down across the middle with trapezoidal velocity, each
/// with a rest of 1 s after it: from -x to x and back, x = band / 2 + `settle` v, where of two
/// ramps that meet the longer one decides. One band per velocity, or one for all.
[[nodiscard]] VelocityRamps drive_chain_motion(std::span<const double> velocities,
                                               std::span<const double> bands, double settle = 0.2,
                                               double acceleration = 1.0);

/// The 51 velocities of the paper, 0.0243 to 50.72 mm/s, and its bands: 2 mm for the first three,
/// 5 mm up to the sixth, 10 mm for the rest.
[[nodiscard]] std::vector<double> drive_chain_velocities();
[[nodiscard]] std::vector<double> drive_chain_bands();

/// The paper's experiment on `drive_chain_axis`. All of it is 925 s of motion, of which the six
/// slowest velocities take 490 s; it takes about 25 ms of computing per second of motion.
[[nodiscard]] AxisRecord drive_chain_record(std::span<const double> velocities,
                                            std::span<const double> bands,
                                            double torque_noise = 0.02);

/// Model 1, or Model 1 and 2.
[[nodiscard]] CoveredLuGre cover_rig_friction(double closing_ratio = 1.0);
[[nodiscard]] double steady_force(const LuGre& friction, double velocity);
[[nodiscard]] double steady_force(const CoveredLuGre& friction, double velocity);

/// Recorded torque in N m over a lead of 32 mm, every 1 ms. `closing_ratio`: of the cover
/// (friction.h).
[[nodiscard]] Axis cover_rig_axis(bool covered, double torque_noise = 0.01,
                                  double closing_ratio = 1.0);

/// The reversing sequence: in every cycle a stroke out and a stroke back at a top velocity drawn
/// between `slowest` and `fastest`; each stroke goes up to half of it, holds, up to all of it,
/// holds, and down again the same way, with 10 m/s^2; then it rests for 1 s. The stroke is what
/// `fastest` runs in 1 s, at most 0.36 m, as in the paper's three intervals; it lies within 0 to
/// 0.4 m. The three holds are of equal time, which the paper does not print.
[[nodiscard]] VelocityRamps cover_rig_motion(std::uint64_t seed, double slowest, double fastest,
                                             int cycles);

}  // namespace servotwin::virtual_machine
