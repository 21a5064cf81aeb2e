#include "tests/hidden_effects/rig.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <stdexcept>
#include <string>

#include "tests/hidden_effects/random.h"
#include "tests/virtual_machine/friction.h"

namespace servotwin::hidden_effects {
namespace {

constexpr int kSteps = 8;  // of the body per control period
constexpr double kPeriod = 1.0 / kControlRate;
constexpr double kStep = kPeriod / kSteps;
constexpr int kElements = 5;
constexpr double kRunaway = 0.05;  // [m]

double wave(double amplitude, double period, double phase, double x) {
  return amplitude == 0.0 ? 0.0 : amplitude * std::sin(2.0 * std::numbers::pi * x / period + phase);
}

void require(bool holds, const char* field, double value, const char* rule) {
  if (holds) return;
  throw std::invalid_argument(std::string("rig: ") + field + " is " + std::to_string(value) +
                              ", must be " + rule);
}

void check(const Rig& rig) {
  const auto positive = [](const char* field, double value) {
    require(value > 0.0 && !std::isnan(value), field, value, "positive");
  };
  positive("mass", rig.body.mass);
  positive("position_gain", rig.drive.position_gain);
  positive("velocity_gain", rig.drive.velocity_gain);
  positive("sample_time", rig.reading.sample_time);
  positive("force_limit", rig.drive.force_limit);
  positive("saturation_velocity", rig.friction.saturation_velocity);
  positive("presliding_distance", rig.friction.presliding_distance);
  positive("stribeck_velocity", rig.friction.stribeck_velocity);
  positive("direction_ratio", rig.friction.direction_ratio);
  positive("mass_ratio", rig.body.mass_ratio);
  require(rig.body.motor_share > 0.0 && rig.body.motor_share < 1.0, "motor_share",
          rig.body.motor_share, "between 0 and 1");
  require(rig.friction.level >= 0.0, "level", rig.friction.level, "at least 0");
  require(rig.friction.motor_share >= 0.0 && rig.friction.motor_share <= 1.0,
          "friction.motor_share", rig.friction.motor_share, "between 0 and 1");
  require(rig.body.gap >= 0.0, "gap", rig.body.gap, "at least 0");
  require(rig.body.gap == 0.0 || rig.body.spring_frequency_hz > 0.0, "gap", rig.body.gap,
          "0 on a rigid axis");
  require(rig.drive.command_filter_hz >= 0.0, "command_filter_hz", rig.drive.command_filter_hz,
          "at least 0");
  require(rig.drive.current_lag >= 0.0, "current_lag", rig.drive.current_lag, "at least 0");
  require(rig.reading.delay >= 0.0, "delay", rig.reading.delay, "at least 0");
}

/// phi and L of the header.
class FrictionState {
 public:
  explicit FrictionState(const Friction& f) : f_(f) {
    if (f.family != Friction::Family::kMaxwell) return;
    const virtual_machine::Gms curve =
        virtual_machine::gms_with_curve(1.0, f.presliding_distance, f.curve, kElements);
    std::copy_n(curve.stiffness.begin(), kElements, stiffness_.begin());
    std::copy_n(curve.share.begin(), kElements, share_.begin());
  }

  /// Advances by one step with this velocity. The breakaway excess E grows during rest as
  /// dE/dt = c / (t0 + t_rest), so that E = c ln(1 + t_rest / t0), and decays with travel:
  /// dE/ds = -E / d.
  void advance(double v) {
    const double way = v * kStep;
    const double s = fall(v);
    if (f_.family == Friction::Family::kMaxwell) {
      phi_ = 0.0;
      for (int i = 0; i < kElements; ++i) {
        element_[i] = std::clamp(element_[i] + stiffness_[i] * way, -share_[i] * s, share_[i] * s);
        phi_ += element_[i];
      }
    } else if (f_.family == Friction::Family::kLuGre) {
      // Implicit in z, which is stiff at speed.
      const double before = z_;
      z_ = (z_ + way / f_.presliding_distance) /
           (1.0 + std::abs(way) / (f_.presliding_distance * s));
      phi_ = z_ + f_.bristle_damping * (z_ - before) / kStep;
    }
    if (f_.dwell_growth > 0.0) {
      from_rest_ += way;
      if (std::abs(from_rest_) > kRestWithin) from_rest_ = 0.0, rest_ = -kRestFor;
      rest_ += kStep;
      if (rest_ > 0.0) extra_ += f_.dwell_growth * kStep / (f_.dwell_time + rest_);
      extra_ /= 1.0 + std::abs(way) / f_.dwell_distance;
    }
    time_ += kStep;
  }

  [[nodiscard]] double force(double x, double v) const {
    const double phi = f_.family == Friction::Family::kCoulomb
                           ? std::clamp(v / f_.saturation_velocity, -1.0, 1.0) * fall(v)
                           : phi_;
    double level = f_.level;
    double viscous = f_.viscous;
    if (f_.wear != 0.0) {
      const double off = (x - f_.wear_place) / f_.wear_width;
      level *= 1.0 + f_.wear * std::exp(-0.5 * off * off);
    }
    if (f_.viscous_excess != 0.0) {
      viscous *= 1.0 + f_.viscous_excess * std::exp(-time_ / f_.viscous_time);
    }
    if (time_ >= f_.added_time) level += f_.added_level, viscous += f_.added_viscous;
    level += extra_;
    // The mean of both directions stays. The sign is that of phi, not of v, so that the force does
    // not jump at a reversal within presliding.
    const double plus = 2.0 * f_.direction_ratio / (1.0 + f_.direction_ratio);
    return level * phi * (phi > 0.0 ? plus : 2.0 - plus) +
           viscous * v * (v > 0.0 ? plus : 2.0 - plus);
  }

 private:
  static constexpr double kRestWithin = 1e-6, kRestFor = 0.01;  // [m] in [s]: more is motion

  [[nodiscard]] double fall(double v) const {
    return f_.stribeck_rise == 0.0
               ? 1.0
               : 1.0 + f_.stribeck_rise * std::exp(-std::abs(v) / f_.stribeck_velocity);
  }

  Friction f_;
  std::array<double, kElements> stiffness_{}, share_{}, element_{};
  double phi_ = 0.0, z_ = 0.0;
  double time_ = 0.0, rest_ = 0.0, from_rest_ = 0.0, extra_ = 0.0;
};

/// Of a friction, this share of its level, and `viscous` of what is viscous.
Friction part_of(Friction f, double level, double viscous) {
  for (double* part : {&f.level, &f.added_level, &f.dwell_growth}) *part *= level;
  for (double* part : {&f.viscous, &f.added_viscous}) *part *= viscous;
  return f;
}

struct Mass {
  double x = 0.0, v = 0.0, a = 0.0;

  void kick() { v += 0.5 * kStep * a; }
  void drift() { x += kStep * v; }
  /// Within the step that started at `x`, `v`: a parabola to where it ended.
  [[nodiscard]] static double between(const Mass& from, const Mass& to, double t) {
    const double straight = from.v * kStep;
    return from.x + t * (straight + t * (to.x - from.x - straight));
  }
};

class Plant {
 public:
  Plant(const Rig& rig, double start)
      : body_(rig.body),
        friction_(part_of(rig.friction, 1.0 - on_motor(rig), 1.0)),
        motor_friction_(part_of(rig.friction, on_motor(rig), 0.0)),
        viscous_(rig.friction.viscous) {
    rigid_ = body_.spring_frequency_hz == 0.0;
    const double table = body_.mass * (1.0 - body_.motor_share);
    const double omega = 2.0 * std::numbers::pi * body_.spring_frequency_hz;
    stiffness_ = table * omega * omega;
    damping_ = 2.0 * body_.damping_ratio * table * omega;
    motor.x = load.x = start;
    if (rigid_) return;
    // The constant load deflects the spring on one side of the gap.
    const double held = body_.constant_force;
    load.x -= held / stiffness() + (held > 0.0 ? 0.5 : held < 0.0 ? -0.5 : 0.0) * body_.gap;
  }

  void advance(double force, double external, double time) {
    if (time >= body_.mass_time && !heavier_) {
      heavier_ = true;
      body_.mass *= body_.mass_ratio;
    }
    if (rigid_) {
      load.kick();
      load.drift();
      friction_.advance(load.v);
      load.a = (force + cogging(load.x) + external - body_.constant_force -
                friction_.force(load.x, load.v)) /
               body_.mass;
      load.kick();
      motor = load;
      return;
    }
    motor.kick();
    load.kick();
    motor.drift();
    load.drift();
    friction_.advance(load.v);
    motor_friction_.advance(motor.v);
    const double contact = contact_force();
    // Half of the viscous friction acts on motor and screw.
    const double half = 0.5 * viscous_;
    motor.a = (force + cogging(motor.x) - half * motor.v - contact -
               motor_friction_.force(motor.x, motor.v)) /
              (body_.mass * body_.motor_share);
    load.a = (contact + external - body_.constant_force + half * load.v -
              friction_.force(load.x, load.v)) /
             (body_.mass * (1.0 - body_.motor_share));
    motor.kick();
    load.kick();
  }

  Mass motor, load;

 private:
  [[nodiscard]] double cogging(double x) const {
    return wave(body_.cogging, body_.cogging_period, body_.cogging_phase, x);
  }
  [[nodiscard]] double stiffness() const {
    const double stiffer = 1.0 + body_.spring_by_position * load.x;
    return stiffness_ * stiffer * stiffer;
  }
  /// Never pulls across the gap: at the end of a contact the damper releases.
  [[nodiscard]] double contact_force() const {
    const double apart = motor.x - load.x;
    const double damper = damping_ * (motor.v - load.v);
    if (body_.gap == 0.0) return stiffness() * apart + damper;
    const double beyond = apart - std::clamp(apart, -0.5 * body_.gap, 0.5 * body_.gap);
    if (beyond > 0.0) return std::max(0.0, stiffness() * beyond + damper);
    if (beyond < 0.0) return std::min(0.0, stiffness() * beyond + damper);
    return 0.0;
  }

  static double on_motor(const Rig& rig) {
    return rig.body.spring_frequency_hz == 0.0 ? 0.0 : rig.friction.motor_share;
  }

  Body body_;
  FrictionState friction_, motor_friction_;  // of the load, or of the one body
  double viscous_ = 0.0;
  bool rigid_ = true, heavier_ = false;
  double stiffness_ = 0.0, damping_ = 0.0;
};

/// Two equal poles; exact, with the command held over a period.
class CommandFilter {
 public:
  CommandFilter(double frequency_hz, double start)
      : omega_(2.0 * std::numbers::pi * frequency_hz), place_(start) {}

  virtual_machine::Setpoint follow(const virtual_machine::Setpoint& command) {
    if (omega_ == 0.0) return command;
    const double faded = std::exp(-omega_ * kPeriod), behind = place_ - command.position;
    place_ = command.position + faded * (behind * (1.0 + omega_ * kPeriod) + velocity_ * kPeriod);
    velocity_ = faded * (velocity_ * (1.0 - omega_ * kPeriod) - behind * omega_ * omega_ * kPeriod);
    virtual_machine::Setpoint out = command;
    out.position = place_, out.velocity = velocity_;
    out.acceleration = -2.0 * omega_ * velocity_ - omega_ * omega_ * (place_ - command.position);
    return out;
  }

 private:
  double omega_, place_, velocity_ = 0.0;
};

class Controller {
 public:
  Controller(const Drive& drive, double motor, double held)
      : drive_(drive), last_motor_(motor), integral_(drive.integral_time > 0.0 ? held : 0.0) {}

  double act(const virtual_machine::Setpoint& command, double motor, double position, double time) {
    const double velocity = (motor - last_motor_) / kPeriod;
    last_motor_ = motor;
    const double gain = drive_.position_gain * (time >= drive_.gain_time ? drive_.gain_ratio : 1.0);
    const double error = gain * (command.position - position) +
                         drive_.velocity_feedforward * command.velocity - velocity;
    const double wanted = drive_.velocity_gain * error + integral_ +
                          drive_.acceleration_feedforward * command.acceleration;
    const double force = std::clamp(wanted, -drive_.force_limit, drive_.force_limit);
    if (drive_.integral_time > 0.0) {
      const double rate = drive_.velocity_gain / drive_.integral_time * error;
      const bool limited = force != wanted;
      switch (drive_.anti_windup) {
        case IntegratorAtLimit::kClamping:
          if ((wanted - force) * error <= 0.0) integral_ += kPeriod * rate;
          break;
        case IntegratorAtLimit::kHolding:
          if (!limited) integral_ += kPeriod * rate;
          break;
        case IntegratorAtLimit::kTracking:
          integral_ += kPeriod * (rate + (force - wanted) / drive_.tracking_time);
          break;
      }
    }
    return force;
  }

 private:
  Drive drive_;
  double last_motor_;
  double integral_;
};

}  // namespace

Trace simulate(const Rig& rig, const Command& command) {
  return simulate(
      rig, [&](double time) { return command.at(time); }, command.duration());
}

Trace simulate(const Rig& rig, const std::function<virtual_machine::Setpoint(double)>& command,
               double duration) {
  check(rig);
  const Reading& reading = rig.reading;
  const bool loop_on_load = rig.drive.position_from == Encoder::kLoad;
  const double held = rig.body.constant_force;
  const double standing = rig.drive.integral_time > 0.0
                              ? 0.0
                              : held / (rig.drive.velocity_gain * rig.drive.position_gain);
  const double start = command(0.0).position - standing;
  const auto rows = static_cast<std::size_t>(std::floor(duration / reading.sample_time + 1e-9)) + 1;

  Plant plant(rig, start);
  const auto encoder = [&](double x) {
    return x + wave(reading.cyclic_error, reading.cyclic_period, reading.cyclic_phase, x);
  };
  const auto recorded = [&](double motor, double load, double time) {
    if (reading.recorded == Encoder::kMotor) return encoder(motor);
    if (loop_on_load) return encoder(load);
    return load + wave(reading.lead_error, reading.lead_period, reading.lead_phase, load) +
           reading.lead_slope * load +
           reading.growth * (load - reading.fixed_end) *
               (1.0 - std::exp(-time / reading.growth_time));
  };
  Controller controller(rig.drive, encoder(plant.motor.x), held);
  CommandFilter filter(rig.drive.command_filter_hz, command(0.0).position);
  const double follows = 1.0 - std::exp(-kPeriod / rig.drive.current_lag);  // where it lags
  Random noise(reading.noise_seed), torque_noise(~reading.noise_seed);

  Trace trace;
  for (auto* column :
       {&trace.command, &trace.actual, &trace.exact, &trace.motor, &trace.load, &trace.force}) {
    column->reserve(rows);
  }
  double force = held, filtered = held;
  const auto write = [&](double motor, double load) {
    const std::size_t row = trace.exact.size();
    const double time = static_cast<double>(row) * reading.sample_time;
    const bool stuck = row > 0 && row < reading.stuck.size() && reading.stuck[row];
    const double exact = stuck ? trace.exact.back() : recorded(motor, load, time);
    const double noisy = exact + reading.noise * noise.normal();
    trace.command.push_back(command(time).position);
    trace.exact.push_back(exact);
    trace.actual.push_back(stuck ? trace.actual.back()
                           : reading.step > 0.0
                               ? std::nearbyint(noisy / reading.step) * reading.step
                               : noisy);
    trace.motor.push_back(motor);
    trace.load.push_back(load);
    trace.force.push_back(force);
    if (reading.torque_per_newton != 0.0) {
      trace.torque.push_back(stuck ? trace.torque.back()
                                   : reading.torque_per_newton *
                                         (filtered + reading.torque_noise * torque_noise.normal()));
    }
  };
  // In integration steps, so that a row at the time of a control period sees its force.
  const auto row_step = [&] {
    return (static_cast<double>(trace.command.size()) * reading.sample_time - reading.delay) /
           kStep;
  };

  while (trace.command.size() < rows && row_step() < -1e-6) write(plant.motor.x, plant.load.x);
  double external = 0.0;
  for (std::int64_t n = 0; trace.command.size() < rows; ++n) {
    const double time = static_cast<double>(n) * kStep;
    if (n % kSteps == 0) {
      const auto k = static_cast<std::size_t>(n / kSteps);
      const virtual_machine::Setpoint wanted = command(time);
      const double asked =
          controller.act(filter.follow(wanted), encoder(plant.motor.x),
                         encoder(loop_on_load ? plant.load.x : plant.motor.x), time);
      force = rig.drive.current_lag > 0.0 ? force + follows * (asked - force) : asked;
      filtered += (force - filtered) * kPeriod / std::max(kPeriod, reading.torque_lag);
      external = k < rig.external_force.size() ? rig.external_force[k] : 0.0;
      trace.acceleration.push_back(plant.load.a);
      if (!(std::abs(plant.load.x - wanted.position) < kRunaway)) {
        trace.runaway = true;
        return trace;
      }
    }
    const Mass motor = plant.motor, load = plant.load;
    plant.advance(force, external, time);
    while (trace.command.size() < rows && row_step() < static_cast<double>(n + 1) - 1e-6) {
      const double t = std::max(0.0, row_step() - static_cast<double>(n));
      write(Mass::between(motor, plant.motor, t), Mass::between(load, plant.load, t));
    }
  }
  return trace;
}

double rms_apart(const Trace& a, const Trace& b) {
  if (a.runaway || b.runaway || a.exact.size() != b.exact.size()) return kNever;
  double sum = 0.0;
  for (std::size_t i = 0; i < a.exact.size(); ++i) {
    const double d = a.exact[i] - b.exact[i];
    sum += d * d;
  }
  return std::sqrt(sum / static_cast<double>(a.exact.size()));
}

double noise_rms(const Trace& trace) {
  double sum = 0.0;
  for (std::size_t i = 0; i < trace.exact.size(); ++i) {
    const double d = trace.actual[i] - trace.exact[i];
    sum += d * d;
  }
  return std::sqrt(sum / static_cast<double>(trace.exact.size()));
}

}  // namespace servotwin::hidden_effects
