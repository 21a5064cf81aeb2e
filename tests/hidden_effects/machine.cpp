#include "tests/hidden_effects/machine.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <sstream>

namespace servotwin::hidden_effects {
namespace {

using Range = Ranges::Range;

double draw(const Range& range, Random& random) {
  return random.log_between(range.low, range.high);
}

Friction draw_friction(const Ranges& ranges, const Needs& needs, double mass, Random& random) {
  Friction f;
  f.level = mass * draw(ranges.friction_mps2, random);
  f.viscous = mass * draw(ranges.drag_per_s, random);
  f.saturation_velocity = random.log_between(1e-4, 1e-3);
  const int families = needs.coulomb ? 1 : needs.level_friction ? 2 : 3;
  switch (random.below(families)) {
    case 0:
      break;
    case 1:
      f.family = Friction::Family::kMaxwell;
      f.presliding_distance = draw(ranges.presliding_m, random);
      f.curve = random.between(2.0, 5.0);
      break;
    default: {
      f.family = Friction::Family::kLuGre;
      f.presliding_distance = 0.3 * draw(ranges.presliding_m, random);
      const double stiffness = f.level / f.presliding_distance;
      f.bristle_damping = 2.0 * random.between(0.1, 0.3) * std::sqrt(mass / stiffness);
      f.stribeck_rise = random.between(0.1, 0.5);
      f.stribeck_velocity = random.log_between(2e-3, 1.5e-2);
    }
  }
  return f;
}

Drive draw_drive(const Ranges& ranges, const Needs& needs, double mass, Random& random) {
  Drive d;
  d.position_gain = 2.0 * std::numbers::pi * draw(ranges.position_loop_hz, random);
  const double velocity_loop = d.position_gain * draw(ranges.velocity_loop_ratio, random);  // [1/s]
  d.velocity_gain = mass * velocity_loop;
  const bool integrator = needs.integrator || (random.chance(0.6) && !needs.no_integrator);
  const double integral_time = random.between(3.0, 8.0) / velocity_loop;
  if (integrator) d.integral_time = integral_time;
  const double pick = random.uniform(), share = random.between(0.3, 1.0);
  d.velocity_feedforward = pick < 0.4 ? 0.0 : pick < 0.8 ? share : 1.0;
  const double weight = random.between(0.5, 1.0);
  if (random.chance(0.3) && d.velocity_feedforward > 0.0)
    d.acceleration_feedforward = weight * mass;
  return d;
}

Reading draw_reading(const Ranges& ranges, const Needs& needs, Drive& drive, Random& random) {
  constexpr double kSampleTimes[] = {0.6e-3, 1e-3, 2e-3, 4e-3};
  Reading r;
  r.sample_time = kSampleTimes[random.below(4)];
  r.step = draw(ranges.encoder_step_m, random);
  r.noise = r.step * draw(ranges.noise_to_step, random);
  const bool load_loop = random.chance(0.25), outside = random.chance(0.2);
  if (needs.outside || (outside && !needs.inside)) {
    r.recorded = Encoder::kLoad;
  } else if (load_loop && !needs.motor_loop) {
    r.recorded = drive.position_from = Encoder::kLoad;
  }
  return r;
}

Motion draw_motion(const Ranges& ranges, const Needs& needs, Random& random) {
  constexpr Motion::Style kStyles[] = {Motion::Style::kProduction, Motion::Style::kProduction,
                                       Motion::Style::kCircles, Motion::Style::kMoves};
  Motion m;
  m.style = kStyles[random.below(4)];
  m.duration = random.between(16.0, 24.0);
  m.start = random.between(-0.2, 0.2);
  m.stroke = draw(ranges.stroke, random);
  m.longest_rest = needs.long_rests ? 2.0 : random.log_between(0.1, 1.0);
  m.limits = {draw(ranges.velocity, random), draw(ranges.acceleration, random),
              draw(ranges.jerk, random)};
  return m;
}

Rig draw_rig(const Ranges& ranges, const Needs& needs, Random& random) {
  Rig rig;
  rig.body.mass = draw(ranges.mass, random);
  rig.body.motor_share = random.between(0.3, 0.7);
  rig.friction = draw_friction(ranges, needs, rig.body.mass, random);
  rig.drive = draw_drive(ranges, needs, rig.body.mass, random);
  rig.reading = draw_reading(ranges, needs, rig.drive, random);
  return rig;
}

/// White noise, one value per control period. Behind the loop 1 / (s^2 + a1 s + a2) the RMS of the
/// position is that of the force over the mass times 1 / sqrt(2 a1 a2 rate).
std::vector<double> draw_torque_noise(const Rig& rig, double share, double duration,
                                      Random& random) {
  const double a1 = rig.drive.velocity_gain / rig.body.mass, a2 = a1 * rig.drive.position_gain;
  const double reading = std::hypot(rig.reading.noise, rig.reading.step / std::sqrt(12.0));
  const double rms = share * reading * rig.body.mass * std::sqrt(2.0 * a1 * a2 * kControlRate);
  std::vector<double> out(static_cast<std::size_t>(duration * kControlRate) + 1);
  for (double& force : out) force = rms * random.normal();
  return out;
}

}  // namespace

Machine draw_machine(const Ranges& ranges, const Needs& needs, Random& random) {
  Machine machine;
  Scene& scene = machine.scene;
  scene.rig = draw_rig(ranges, needs, random);
  const Motion motion = draw_motion(ranges, needs, random);
  scene.command = motion_of(motion, random);
  scene.stroke = motion.stroke;
  scene.first_change = ranges.first_change;
  scene.last_change = ranges.last_change;
  machine.torque_noise = draw_torque_noise(scene.rig, random.between(0.0, ranges.torque_noise),
                                           motion.duration, random);
  scene.rig.reading.noise_seed = static_cast<std::uint64_t>(random.uniform() * 0x1p53);

  // Some recordings contain a second axis even if it has no influence.
  machine.records_other = random.chance(0.3) || needs.other_axis;
  if (!machine.records_other) return machine;
  machine.other = draw_rig(ranges, {}, random);
  machine.other.reading.sample_time = scene.rig.reading.sample_time;
  machine.other.reading.noise_seed = scene.rig.reading.noise_seed + 1;
  Motion other = draw_motion(ranges, {}, random);
  other.duration = motion.duration;
  machine.other_command = motion_of(other, random);
  return machine;
}

std::vector<std::string> own_effects(const Rig& rig) {
  switch (rig.friction.family) {
    case Friction::Family::kCoulomb:
      return {};
    case Friction::Family::kMaxwell:
      return {"presliding"};
    case Friction::Family::kLuGre:
      return {"presliding", "stribeck"};
  }
  return {};
}

std::string describe(const Rig& rig) {
  constexpr const char* kFamilies[] = {"Coulomb", "Maxwell", "LuGre"};
  const Drive& d = rig.drive;
  std::ostringstream out;
  out.precision(3);
  out << rig.body.mass << " kg, Kp " << d.position_gain << "/s, velocity loop "
      << d.velocity_gain / rig.body.mass << "/s, "
      << (d.integral_time > 0.0 ? "integrator" : "no integrator") << ", feed-forward "
      << d.velocity_feedforward << ", " << kFamilies[static_cast<int>(rig.friction.family)] << ' '
      << rig.friction.level / rig.body.mass << " m/s2, record of the "
      << (rig.reading.recorded == Encoder::kMotor ? "motor"
          : d.position_from == Encoder::kLoad     ? "load"
                                                  : "load outside the loop")
      << " every " << 1e3 * rig.reading.sample_time << " ms, step " << 1e6 * rig.reading.step
      << " um";
  if (d.command_filter_hz > 0.0) out << ", command filter " << d.command_filter_hz << " Hz";
  if (d.current_lag > 0.0) out << ", current " << 1e3 * d.current_lag << " ms late";
  return out.str();
}

}  // namespace servotwin::hidden_effects
