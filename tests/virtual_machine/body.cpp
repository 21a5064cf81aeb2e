#include "tests/virtual_machine/body.h"

#include <stdexcept>

#include "tests/virtual_machine/require.h"

namespace servotwin::virtual_machine {
namespace {

constexpr int kBisections = 40;
constexpr int kMaxEvents = 1000;  // in one step; a model has at most 2 kMaxElements per reversal

}  // namespace

Body::Body(const BodyParameters& parameters, double position, double velocity)
    : parameters_(parameters), friction_states_(state_size(parameters.friction)) {
  require_positive(parameters.mass, "body.mass");
  require_at_least_zero(parameters.viscous, "body.viscous");
  check(parameters.friction);
  state_.position = position;
  state_.velocity = velocity;
  if (velocity != 0.0 && sticks(parameters.friction)) {
    state_.friction.mode[0] = velocity > 0.0 ? 1 : -1;
  }
}

BodyState Body::runge_kutta(double u, double h) const {
  struct Slope {
    double velocity = 0.0;
    double acceleration = 0.0;
    std::array<double, kMaxElements> z{};
  };
  const auto slope_at = [&](const BodyState& s) {
    Slope k;
    const double other = applied(u, s.velocity);
    k.velocity = s.velocity;
    k.acceleration = (other - force(parameters_.friction, s.velocity, other, s.friction, k.z)) /
                     parameters_.mass;
    return k;
  };
  const auto moved = [&](const Slope& k, double dt) {
    BodyState s = state_;
    s.position += dt * k.velocity;
    s.velocity += dt * k.acceleration;
    for (int i = 0; i < friction_states_; ++i) s.friction.z[i] += dt * k.z[i];
    return s;
  };
  const Slope k1 = slope_at(state_);
  const Slope k2 = slope_at(moved(k1, h / 2.0));
  const Slope k3 = slope_at(moved(k2, h / 2.0));
  const Slope k4 = slope_at(moved(k3, h));
  Slope mean;
  mean.velocity = (k1.velocity + 2.0 * (k2.velocity + k3.velocity) + k4.velocity) / 6.0;
  mean.acceleration =
      (k1.acceleration + 2.0 * (k2.acceleration + k3.acceleration) + k4.acceleration) / 6.0;
  for (int i = 0; i < friction_states_; ++i) {
    mean.z[i] = (k1.z[i] + 2.0 * (k2.z[i] + k3.z[i]) + k4.z[i]) / 6.0;
  }
  return moved(mean, h);
}

void Body::advance(double u, double h) {
  for (int events = 0; events < kMaxEvents; ++events) {
    if (!holds(u, state_)) {  // the held force has changed
      switch_mode(parameters_.friction, applied(u, 0.0), state_.velocity, state_.friction);
    }
    const BodyState whole = runge_kutta(u, h);
    if (holds(u, whole)) {
      state_ = whole;
      return;
    }
    double before = 0.0;
    double after = h;
    for (int i = 0; i < kBisections; ++i) {
      const double middle = 0.5 * (before + after);
      (holds(u, runge_kutta(u, middle)) ? before : after) = middle;
    }
    state_ = runge_kutta(u, after);
    switch_mode(parameters_.friction, applied(u, 0.0), state_.velocity, state_.friction);
    h -= after;
    if (h <= 0.0) return;
  }
  throw std::runtime_error(
      "body: friction events do not come to an end within one integration step");
}

double Body::friction_force(double u) const {
  std::array<double, kMaxElements> rate{};
  return force(parameters_.friction, state_.velocity, applied(u, state_.velocity), state_.friction,
               rate);
}

}  // namespace servotwin::virtual_machine
