#include "tests/virtual_machine/friction_rigs.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>
#include <stdexcept>
#include <string>

#include "tests/virtual_machine/require.h"

namespace servotwin::virtual_machine {
namespace {

constexpr double kTurn = 2.0 * std::numbers::pi;

LuGre model_1() {
  return {.level = {.coulomb = 163.0, .breakaway = 200.0, .stribeck_velocity = 2.53e-3},
          .sigma0 = 9.37e6,
          .sigma1 = 4.45e4,
          .sigma2 = 530.0};
}

/// Its breakaway force lies below its Coulomb force, as printed.
LuGre model_2() {
  return {.level = {.coulomb = 106.0, .breakaway = 49.6, .stribeck_velocity = 5.30e-4},
          .sigma0 = 1.92e6,
          .sigma1 = 5.78e3,
          .sigma2 = 86.2};
}

}  // namespace

DirectedStribeck drive_chain_friction() {
  return {.plus = {.coulomb = 611.18,
                   .breakaway = 944.2,
                   .stribeck_velocity = 0.0065,
                   .exponent = 1.26},
          .minus = {.coulomb = 750.9,
                    .breakaway = 1049.2,
                    .stribeck_velocity = 0.0074,
                    .exponent = 1.26},
          .viscous_plus = 1904.2,
          .viscous_minus = 2565.0};
}

double steady_force(const DirectedStribeck& friction, double velocity) {
  return velocity > 0.0 ? friction.plus.at(velocity) + friction.viscous_plus * velocity
                        : -friction.minus.at(velocity) + friction.viscous_minus * velocity;
}

Axis drive_chain_axis(double torque_noise) {
  constexpr double kLead = 0.040;
  Axis axis;
  axis.body.mass = 60.0;  // assumed: slider, with rotor, coupling and screw over the lead
  axis.body.friction = drive_chain_friction();
  // The gains are not printed.
  axis.drive.rate_hz = 8000.0;
  axis.drive.integration_steps = 10;
  axis.drive.position_gain = 60.0;
  axis.drive.velocity_gain = 5e4;
  axis.drive.integral_gain = 5e6;
  axis.drive.encoder_step = kLead / 0x1p20;
  axis.recorder.sample_time = 4e-3;
  axis.recorder.position_step = kLead / 0x1p20;
  axis.recorder.torque_noise = torque_noise;
  axis.transmission = kLead / kTurn;
  return axis;
}

VelocityRamps drive_chain_motion(std::span<const double> velocities, std::span<const double> bands,
                                 double settle, double acceleration) {
  if (bands.size() != 1 && bands.size() != velocities.size()) {
    throw std::invalid_argument("drive_chain: " + std::to_string(bands.size()) + " bands for " +
                                std::to_string(velocities.size()) +
                                " velocities, must be one or as many");
  }
  const auto extreme = [&](std::size_t i) {
    return bands[bands.size() == 1 ? 0 : i] / 2.0 + settle * velocities[i];
  };
  VelocityRamps motion(velocities.empty() ? 0.0 : -extreme(0));
  const auto ramp_to = [&](double target, double velocity) {
    const double stroke = std::abs(target - motion.end().position);
    motion.accelerate_to(std::copysign(velocity, target - motion.end().position), acceleration);
    motion.hold((stroke - velocity * velocity / acceleration) / velocity);
    motion.accelerate_to(0.0, acceleration);
    motion.hold(1.0);
  };
  motion.hold(1.0);
  for (std::size_t i = 0; i < velocities.size(); ++i) {
    require_positive(velocities[i], "drive_chain: velocity");
    ramp_to(extreme(i), velocities[i]);
    ramp_to(-std::max(extreme(i), extreme(std::min(i + 1, velocities.size() - 1))), velocities[i]);
  }
  return motion;
}

std::vector<double> drive_chain_velocities() {
  std::vector<double> velocities;
  for (int i = 1; i <= 51; ++i) {
    velocities.push_back(1e-7 * (100.0 + i * (100.0 + i * (40.0 + i * 3.0))));
  }
  return velocities;
}

std::vector<double> drive_chain_bands() {
  std::vector<double> bands(51, 10e-3);
  std::fill_n(bands.begin(), 6, 5e-3);
  std::fill_n(bands.begin(), 3, 2e-3);
  return bands;
}

AxisRecord drive_chain_record(std::span<const double> velocities, std::span<const double> bands,
                              double torque_noise) {
  const VelocityRamps motion = drive_chain_motion(velocities, bands);
  return record(drive_chain_axis(torque_noise), motion.command(), motion.duration());
}

CoveredLuGre cover_rig_friction(double closing_ratio) {
  return {model_1(), model_2(), closing_ratio};
}

double steady_force(const LuGre& friction, double velocity) {
  return std::copysign(friction.level.at(velocity), velocity) + friction.sigma2 * velocity;
}

double steady_force(const CoveredLuGre& friction, double velocity) {
  return steady_force(friction.drive, velocity) +
         (velocity < 0.0 ? friction.closing_ratio : 1.0) * steady_force(friction.cover, velocity);
}

Axis cover_rig_axis(bool covered, double torque_noise, double closing_ratio) {
  constexpr double kLead = 0.032;
  constexpr double kInertia = 593e-6 + 114e-6;  // rotor and coupling; the screw's is not printed
  Axis axis;
  axis.body.mass = 106.0 + kInertia * (kTurn / kLead) * (kTurn / kLead);
  if (covered) {
    axis.body.friction = cover_rig_friction(closing_ratio);
  } else {
    axis.body.friction = model_1();
  }
  // The gains are not printed: a velocity loop of 60 Hz with an integrator of 10 ms.
  axis.drive.rate_hz = 16000.0;
  axis.drive.integration_steps = 8;
  axis.drive.position_gain = 40.0;
  axis.drive.velocity_gain = axis.body.mass * kTurn * 60.0;
  axis.drive.integral_gain = axis.drive.velocity_gain / 0.010;
  axis.drive.encoder_step = kLead / 0x1p24;
  axis.recorder.sample_time = 1e-3;
  axis.recorder.position_step = kLead / 0x1p24;
  axis.recorder.torque_noise = torque_noise;
  axis.transmission = kLead / kTurn;
  return axis;
}

VelocityRamps cover_rig_motion(std::uint64_t seed, double slowest, double fastest, int cycles) {
  constexpr double kAcceleration = 10.0;
  constexpr double kLongestStroke = 0.36;
  constexpr double kSecond = 1.0;  // of the stroke at the fastest velocity, and of every rest
  require_positive(slowest, "cover_rig: slowest");
  require_positive(fastest - slowest, "cover_rig: fastest - slowest");
  const double stroke = std::min(kLongestStroke, fastest * kSecond);
  // The four ramps take v^2 / a of the stroke; the holds must have some of it left.
  require_positive(stroke - fastest * fastest / kAcceleration, "cover_rig: stroke at one velocity");
  std::mt19937_64 engine(seed);
  VelocityRamps motion;
  motion.hold(kSecond);
  for (int cycle = 0; cycle < cycles; ++cycle) {
    const double share = static_cast<double>(engine() >> 11) * 0x1p-53;
    const double top = slowest + (fastest - slowest) * share;
    const double hold = (stroke - top * top / kAcceleration) / (2.0 * top);
    for (const double v : {top, -top}) {
      for (const double next : {v / 2.0, v, v / 2.0}) {
        motion.accelerate_to(next, kAcceleration);
        motion.hold(hold);
      }
      motion.accelerate_to(0.0, kAcceleration);
      motion.hold(kSecond);
    }
  }
  return motion;
}

}  // namespace servotwin::virtual_machine
