#include "tests/virtual_machine/axis.h"

#include <algorithm>
#include <cmath>
#include <random>
#include <stdexcept>

#include "tests/virtual_machine/require.h"

namespace servotwin::virtual_machine {
namespace {

double rounded(double x, double step) { return step > 0.0 ? std::nearbyint(x / step) * step : x; }

void check_axis(const Axis& axis, double duration) {
  const std::string name = "axis " + axis.name + ": ";
  const Drive& d = axis.drive;
  if (!(d.rate_hz >= 8000.0) || !std::isfinite(d.rate_hz)) {
    throw std::invalid_argument(name + "drive.rate_hz is " + std::to_string(d.rate_hz) +
                                ", must be at least 8000");
  }
  if (!(d.rate_hz * d.integration_steps >= 80000.0)) {
    throw std::invalid_argument(name + "drive.integration_steps is " +
                                std::to_string(d.integration_steps) +
                                ", must integrate at 80 kHz or faster");
  }
  require_positive(d.position_gain, name + "drive.position_gain");
  require_positive(d.velocity_gain, name + "drive.velocity_gain");
  require_at_least_zero(d.integral_gain, name + "drive.integral_gain");
  if (!(d.force_limit > 0.0)) {
    throw std::invalid_argument(name + "drive.force_limit is " + std::to_string(d.force_limit) +
                                ", must be positive");
  }
  require_at_least_zero(d.encoder_step, name + "drive.encoder_step");
  require_positive(axis.recorder.sample_time, name + "recorder.sample_time");
  require_at_least_zero(axis.recorder.position_step, name + "recorder.position_step");
  require_at_least_zero(axis.recorder.delay, name + "recorder.delay");
  require_at_least_zero(axis.recorder.position_noise, name + "recorder.position_noise");
  require_at_least_zero(axis.recorder.torque_noise, name + "recorder.torque_noise");
  require_at_least_zero(duration, name + "duration");
}

class Controller {
 public:
  Controller(const Drive& drive, double position, double held_force)
      : drive_(drive),
        period_(1.0 / drive.rate_hz),
        last_position_(rounded(position, drive.encoder_step)),
        integral_(drive.integral_gain > 0.0 ? held_force : 0.0) {}

  double act(const Setpoint& command, double true_position) {
    const double position = rounded(true_position, drive_.encoder_step);
    const double velocity = (position - last_position_) / period_;
    last_position_ = position;
    const double error = drive_.position_gain * (command.position - position) +
                         drive_.velocity_feedforward * command.velocity - velocity;
    const double wanted = drive_.velocity_gain * error + integral_ +
                          drive_.acceleration_feedforward * command.acceleration;
    const double force = std::clamp(wanted, -drive_.force_limit, drive_.force_limit);
    if ((wanted - force) * error <= 0.0) integral_ += drive_.integral_gain * period_ * error;
    return force;
  }

 private:
  Drive drive_;
  double period_;
  double last_position_;
  double integral_;
};

/// Unit normal noise as the sum of twelve uniform numbers: the same on every platform.
class Noise {
 public:
  explicit Noise(std::uint64_t seed) : engine_(seed) {}
  double next() {
    double sum = -6.0;
    for (int i = 0; i < 12; ++i) sum += static_cast<double>(engine_() >> 11) * 0x1p-53;
    return sum;
  }

 private:
  std::mt19937_64 engine_;
};

/// The position at the share `t` of the step `h`: a parabola, which is off by 1e-14 m at most.
double position_between(const BodyState& from, const BodyState& to, double h, double t) {
  const double start = h * from.velocity;
  return from.position + t * (start + t * (to.position - from.position - start));
}

double between(double from, double to, double t) { return from + t * (to - from); }

}  // namespace

AxisRecord record(const Axis& axis, const Command& command, double duration) {
  check_axis(axis, duration);
  const Drive& drive = axis.drive;
  const Recorder& recorder = axis.recorder;
  const double held = axis.body.constant_force;
  // Without integrator the load is held by a standing error.
  const double standing =
      drive.integral_gain > 0.0 ? 0.0 : held / (drive.velocity_gain * drive.position_gain);
  const double start = command(0.0).position - standing;

  const auto rows =
      static_cast<Eigen::Index>(std::floor(duration / recorder.sample_time + 1e-9)) + 1;
  AxisRecord out;
  out.name = axis.name;
  out.sample_time = recorder.sample_time;
  for (Eigen::ArrayXd* column : {&out.command, &out.actual, &out.torque, &out.true_position,
                                 &out.true_velocity, &out.true_friction}) {
    column->resize(rows);
  }

  Body body(axis.body, start);
  Controller controller(drive, start, held);
  Noise noise(recorder.seed);
  double force = held;

  Eigen::Index row = 0;
  const auto write = [&](double position, double velocity, double friction) {
    out.command[row] = command(static_cast<double>(row) * recorder.sample_time).position;
    out.true_position[row] = position;
    out.true_velocity[row] = velocity;
    out.true_friction[row] = friction;
    out.actual[row] =
        rounded(position + recorder.position_noise * noise.next(), recorder.position_step);
    out.torque[row] = force * axis.transmission + recorder.torque_noise * noise.next();
    ++row;
  };

  // Times are counted in integration steps, so that a row at the time of a drive period sees the
  // force of that period.
  const double step = 1.0 / (drive.rate_hz * drive.integration_steps);
  const auto step_of_row = [&] {
    return (static_cast<double>(row) * recorder.sample_time - recorder.delay) / step;
  };
  while (row < rows && step_of_row() < -1e-6) write(start, 0.0, 0.0);
  for (std::int64_t n = 0; row < rows; ++n) {
    if (n % drive.integration_steps == 0) {
      const std::int64_t cycle = n / drive.integration_steps;
      const double time = static_cast<double>(cycle) / drive.rate_hz;
      force = controller.act(command(time), body.state().position);
    }
    const BodyState before = body.state();
    const double friction_before = body.friction_force(force);
    body.advance(force, step);
    const double friction_after = body.friction_force(force);
    while (row < rows && step_of_row() < static_cast<double>(n + 1) - 1e-6) {
      const double t = std::max(0.0, step_of_row() - static_cast<double>(n));
      write(position_between(before, body.state(), step, t),
            between(before.velocity, body.state().velocity, t),
            between(friction_before, friction_after, t));
    }
  }
  return out;
}

AxisRecord record(const Axis& axis, const Trajectory& trajectory) {
  return record(
      axis, [&](double t) { return trajectory.at(t); }, trajectory.duration());
}

ContinuousLoop continuous_loop(const Axis& axis) {
  const Drive& d = axis.drive;
  const double m = axis.body.mass;
  const double velocity_loop = d.velocity_gain / m;
  const double integral_loop = d.integral_gain / m;
  ContinuousLoop loop;
  loop.order = d.integral_gain > 0.0 ? 3 : 2;
  loop.a1 = axis.body.viscous / m + velocity_loop;
  loop.a2 = integral_loop + d.position_gain * velocity_loop;
  loop.a3 = d.position_gain * integral_loop;
  loop.c0 = 1.0 - d.acceleration_feedforward / m;
  loop.c1 = loop.a1 - velocity_loop * d.velocity_feedforward;
  loop.c2 = loop.order == 2 ? 0.0
                            : loop.a2 - d.position_gain * velocity_loop -
                                  integral_loop * d.velocity_feedforward;
  return loop;
}

}  // namespace servotwin::virtual_machine
