// A machine that is run cycle by cycle and shares no code with the twin: axes of the virtual
// machine (tests/virtual_machine/body.h) behind the cascade that tests/virtual_machine/axis.h
// describes, and the models that are known of them in closed form.
#pragma once

#include <algorithm>
#include <cmath>

#include "tests/daemon/support.h"
#include "tests/virtual_machine/axis.h"
#include "tests/virtual_machine/body.h"
#include "tests/virtual_machine/program.h"

namespace servotwin::daemon {

/// A ball-screw axis with saturated Coulomb friction, 110 N.
inline virtual_machine::Axis stepped_axis() {
  virtual_machine::Axis axis;
  axis.body.mass = 210.0;
  axis.body.viscous = 700.0;
  axis.body.friction = virtual_machine::SaturatedCoulomb{110.0, 1e-3};
  axis.drive.position_gain = 75.0;
  axis.drive.velocity_gain = 48'000.0;
  axis.drive.integral_gain = 6.0e6;
  axis.drive.force_limit = 3000.0;
  return axis;
}

/// What is known of such an axis: its loop in the limit of a fast drive, and its friction.
inline Model model_of(const virtual_machine::Axis& axis) {
  const virtual_machine::ContinuousLoop loop = continuous_loop(axis);
  const auto& friction = std::get<virtual_machine::SaturatedCoulomb>(axis.body.friction);
  Model model;
  model.sample_time_s = kCycle_s;
  model.loop.order = loop.order;
  model.loop.denominator = {loop.a1, loop.a2, loop.a3};
  model.loop.numerator = {loop.c0, loop.c1, loop.c2};
  Effect coulomb = make_effect<CoulombFriction>();
  coulomb.shape[0] = friction.velocity_limit;
  coulomb.coefficient[0] = friction.coulomb / axis.body.mass;
  model.effects = {coulomb};
  return model;
}

/// One axis, moved by one command per cycle; the drive interpolates between two of them.
class SteppedAxis {
 public:
  explicit SteppedAxis(const virtual_machine::Axis& axis, double start = 0.0)
      : axis_(axis), body_(axis.body, start), command_(start), reading_(start) {}

  /// Changes the plant; position and velocity stay.
  void change(const virtual_machine::Axis& axis) {
    const double position = body_.state().position, velocity = body_.state().velocity;
    axis_ = axis;
    body_ = virtual_machine::Body(axis.body, position, velocity);
  }

  /// The position when the command is reached.
  double cycle(double command) {
    const virtual_machine::Drive& drive = axis_.drive;
    const double period = 1.0 / drive.rate_hz;
    const int periods = static_cast<int>(std::lround(kCycle_s * drive.rate_hz));
    for (int i = 0; i < periods; ++i) {
      const double r = command_ + (command - command_) * i / periods;
      const double x = body_.state().position;
      const double v = (x - reading_) / period;
      reading_ = x;
      const double w = drive.position_gain * (r - x) - v;
      const double wanted = drive.velocity_gain * w + integral_;
      const double u = std::clamp(wanted, -drive.force_limit, drive.force_limit);
      if (u == wanted || w * u < 0.0) integral_ += drive.integral_gain * period * w;
      for (int k = 0; k < drive.integration_steps; ++k)
        body_.advance(u, period / drive.integration_steps);
    }
    command_ = command;
    return body_.state().position;
  }

 private:
  virtual_machine::Axis axis_;
  virtual_machine::Body body_;
  double command_, reading_, integral_ = 0.0;
};

/// X and Y of a circle of 10 mm at 100 mm/s, run twice, between dwells.
inline std::array<Eigen::ArrayXd, 2> circle_program() {
  virtual_machine::PlanePath path(0.0, 0.0);
  path.dwell(0.3);
  path.arc(0.010, 0.0, 4.0 * std::numbers::pi, {0.1, 1.5, 40.0});
  path.dwell(0.4);
  const auto n = static_cast<Eigen::Index>(path.x().duration() / kCycle_s) + 1;
  std::array<Eigen::ArrayXd, 2> out{Eigen::ArrayXd(n), Eigen::ArrayXd(n)};
  for (Eigen::Index k = 0; k < n; ++k) {
    out[0](k) = path.x().at(kCycle_s * static_cast<double>(k)).position;
    out[1](k) = path.y().at(kCycle_s * static_cast<double>(k)).position;
  }
  return out;
}

}  // namespace servotwin::daemon
