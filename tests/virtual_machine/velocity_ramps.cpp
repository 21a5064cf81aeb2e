#include "tests/virtual_machine/velocity_ramps.h"

#include <algorithm>
#include <cmath>

#include "tests/virtual_machine/require.h"

namespace servotwin::virtual_machine {
namespace {

Setpoint moved(const Setpoint& from, double dt) {
  return {from.position + dt * (from.velocity + dt * from.acceleration / 2.0),
          from.velocity + dt * from.acceleration, from.acceleration, 0.0};
}

}  // namespace

void VelocityRamps::accelerate_to(double velocity, double acceleration) {
  require_positive(acceleration, "velocity_ramps: acceleration");
  const double change = velocity - end_.velocity;
  if (change == 0.0) return;
  go_on(std::abs(change) / acceleration, std::copysign(acceleration, change));
  end_.velocity = velocity;  // free of rounding, so that a rest is a rest
}

void VelocityRamps::hold(double seconds) {
  require_positive(seconds, "velocity_ramps: hold");
  go_on(seconds, 0.0);
}

void VelocityRamps::go_on(double seconds, double acceleration) {
  end_.acceleration = acceleration;
  pieces_.push_back({duration_, end_});
  end_ = moved(end_, seconds);
  end_.acceleration = 0.0;
  duration_ += seconds;
}

Setpoint VelocityRamps::at(double time) const {
  if (pieces_.empty() || time >= duration_) return {.position = end_.position};
  if (time < 0.0) return {.position = pieces_.front().setpoint.position};
  const auto after = std::upper_bound(pieces_.begin(), pieces_.end(), time,
                                      [](double t, const Piece& p) { return t < p.start; });
  const Piece& piece = *std::prev(after);
  return moved(piece.setpoint, time - piece.start);
}

Command VelocityRamps::command() const {
  return [ramps = *this](double time) { return ramps.at(time); };
}

}  // namespace servotwin::virtual_machine
