#include "identification/recording/signals.h"

#include <algorithm>
#include <array>
#include <utility>

#include "twin/neighbour.h"

namespace servotwin {

Eigen::ArrayXd measured_velocity(const Eigen::ArrayXd& position, double h, int half_window) {
  const Eigen::Index n = position.size();
  Eigen::ArrayXd velocity = Eigen::ArrayXd::Zero(n);
  if (n > 2) velocity.segment(1, n - 2) = (position.tail(n - 2) - position.head(n - 2)) / (2.0 * h);
  if (half_window <= 0) return velocity;
  Eigen::ArrayXd sum(n + 1);
  sum(0) = 0.0;
  for (Eigen::Index i = 0; i < n; ++i) sum(i + 1) = sum(i) + velocity(i);
  for (Eigen::Index i = 0; i < n; ++i) {
    const Eigen::Index w = std::min<Eigen::Index>({half_window, i, n - 1 - i});
    velocity(i) = (sum(i + w + 1) - sum(i - w)) / static_cast<double>(2 * w + 1);
  }
  return velocity;
}

namespace {

/// The centred mean over as many samples, by the trapezoidal rule; shorter at the ends.
Eigen::ArrayXd mean_over(const Eigen::ArrayXd& x, int samples) {
  const Eigen::Index half = samples / 2;
  const double ends = samples % 2 == 0 ? 0.5 : 1.0;
  Eigen::ArrayXd out(x.size());
  for (Eigen::Index k = 0; k < x.size(); ++k) {
    const Eigen::Index reach = std::min({half, k, x.size() - 1 - k});
    double sum = x(k), weight = 1.0;
    for (Eigen::Index i = 1; i <= reach; ++i) {
      const double w = i == half ? ends : 1.0;
      sum += w * (x(k - i) + x(k + i));
      weight += 2.0 * w;
    }
    out(k) = sum / weight;
  }
  return out;
}

/// Of the first law of friction that the model has; empty without one.
Eigen::ArrayXd friction_along(const Model& model, const Signals& s) {
  const auto law = std::find_if(model.effects.begin(), model.effects.end(),
                                [](const Effect& e) { return is_friction_law(e.kind); });
  if (law == model.effects.end()) return {};
  EffectMemory<double> memory;
  start_memory<double>(law->kind, law->shape.data(), memory);
  Eigen::ArrayXd out(s.size());
  std::array<double, kMaxCoefficients> force{};
  Motion m;
  m.step_s = s.h;
  for (Eigen::Index k = 0; k < s.size(); ++k) {
    m.position = s.position(k);
    m.velocity = s.velocity(k);
    m.displacement = k > 0 ? s.position(k) - s.position(k - 1) : 0.0;
    unit_forces<double>(law->kind, law->shape.data(), memory, m, force.data());
    out(k) = friction_of(*law, force.data());
  }
  return out;
}

}  // namespace

void add_drive(const Model& model, Signals& s) {
  s.friction = friction_along(model, s);
  const auto& c = model.loop.numerator;
  const auto& a = model.loop.denominator;
  const Spline command = Spline::through(s.command.delayed(model.command_delay_s()), s.h);
  const Eigen::ArrayXd error = command.value - s.position;
  s.demand = (1.0 - c[0]) * command.second - c[1] * command.first +
             a[0] * (command.first - s.velocity) + a[1] * error;
  s.demand_rate = s.demand_damping = Eigen::ArrayXd::Zero(s.size());
  if (model.loop.order != 3) return;
  s.demand_damping = a[0] * (command.first - s.velocity);
  s.demand_rate = a[2] * error - c[2] * command.first;
  double integral = 0.0;
  for (Eigen::Index k = 1; k < s.size(); ++k) {
    integral += 0.5 * s.h * (s.demand_rate(k - 1) + s.demand_rate(k));
    s.demand(k) += integral;
  }
}

Signals signals_of(const Segment& segment) {
  Signals s;
  s.h = segment.sample_time_s;
  const auto half_window = std::min(5, static_cast<int>(0.5 * kVelocityMean_s / s.h));
  s.command = Spline::through(segment.command, s.h);
  s.error = segment.command - segment.actual;
  s.position = segment.actual;
  s.velocity = measured_velocity(segment.actual, s.h, half_window);
  s.acceleration = measured_velocity(s.velocity, s.h, 0);
  s.lead = segment.lead;
  s.length_scale = segment.length_scale;
  s.start_s = segment.start_s;
  s.in_cut = segment.in_cut;
  s.neighbour_acceleration = neighbour_acceleration(segment, false);
  s.neighbour_motion_acceleration = neighbour_acceleration(segment, true);
  return s;
}

void set_motion(Signals& signals, Eigen::ArrayXd position) {
  signals.position = std::move(position);
  signals.velocity = measured_velocity(signals.position, signals.h, 0);
  signals.acceleration = measured_velocity(signals.velocity, signals.h, 0);
}

// The acceleration of a measured motion is mostly noise at high frequencies, which single samples
// of it would take for motion: its mean over the new step is taken instead.
Signals decimated(const Signals& signals, int every) {
  if (every <= 1) return signals;
  const Eigen::Index n = (signals.size() + every - 1) / every;
  const auto thin = [&](const Eigen::ArrayXd& full) -> Eigen::ArrayXd {
    if (full.size() == 0) return full;
    Eigen::ArrayXd out(n);
    for (Eigen::Index i = 0; i < n; ++i) out(i) = full(i * every);
    return out;
  };
  Signals s;
  s.h = signals.h * every;
  s.command = Spline::through(thin(signals.command.value), s.h);
  s.error = thin(signals.error);
  s.position = thin(signals.position);
  s.velocity = thin(signals.velocity);
  s.acceleration = thin(signals.acceleration);
  s.start_s = signals.start_s;
  s.loop_position = thin(signals.loop_position);
  s.in_cut = thin(signals.in_cut);
  s.neighbour_acceleration = thin(signals.neighbour_acceleration);
  s.neighbour_motion_acceleration = thin(mean_over(signals.neighbour_motion_acceleration, every));
  s.demand = thin(signals.demand);
  s.friction = thin(signals.friction);
  s.demand_rate = thin(signals.demand_rate);
  s.demand_damping = thin(signals.demand_damping);
  s.lead = (signals.lead + every - 1) / every;
  s.length_scale = signals.length_scale;
  return s;
}

}  // namespace servotwin
