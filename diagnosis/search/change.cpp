#include "diagnosis/search/change.h"

#include <algorithm>
#include <cmath>

#include "identification/loop/joint.h"
#include "twin/two_mass_axis.h"

namespace servotwin {

namespace {

constexpr double kRatioStep = 1e-6;  // of a relative quantity

bool is_force(const Effect& effect) { return identity_of(effect.kind).acts == Acts::kForce; }

ChangedQuantity ratio(const char* name) { return {name, "1", 0.0, kRatioStep, true}; }

/// Sets Kp and 1/Ti of the loop; k = a1 and the feed-forward stay.
void set_gains(Loop& loop, const Gains& gains) {
  const double k = loop.denominator[0];
  if (loop.order == 2) {
    loop.denominator[1] = k * gains.position;
    return;
  }
  loop.denominator[1] = k * (gains.integral + gains.position);
  loop.denominator[2] = k * gains.position * gains.integral;
}

void scale_forces(Model& model, double factor) {
  for (Effect& effect : model.effects) {
    if (!is_force(effect)) continue;
    for (double& c : effect.coefficient) c *= factor;
  }
}

void scale_mass(Model& model, double by) {
  Loop& loop = model.loop;
  for (double& a : loop.denominator) a /= by;
  loop.numerator[0] = 1.0 - (1.0 - loop.numerator[0]) / by;
  for (std::size_t i = 1; i < kMaxOrder; ++i) loop.numerator[i] /= by;
  scale_forces(model, 1.0 / by);
}

}  // namespace

Gains gains_of(const Loop& loop) {
  const double k = loop.denominator[0];
  if (loop.order == 2) return {loop.denominator[1] / k, 0.0};
  // Kp and 1/Ti are the roots of z^2 - (a2/k) z + a3/k. The numerator tells which of them is 1/Ti:
  // c2 / c1 = 1/Ti.
  const double sum = loop.denominator[1] / k, product = loop.denominator[2] / k;
  const double root = std::sqrt(std::max(0.0, 0.25 * sum * sum - product));
  const double large = 0.5 * sum + root, small = product > 0.0 ? product / large : 0.0;
  const double told = loop.numerator[1] != 0.0 ? loop.numerator[2] / loop.numerator[1] : 0.0;
  return std::abs(told - large) < std::abs(told - small) ? Gains{small, large}
                                                         : Gains{large, small};
}

std::vector<Change> changes_of(const Model& model) {
  std::vector<Change> out;
  out.push_back({"inertia_change", {ratio("mass")}, [](Model& m, std::span<const double> v) {
                   scale_mass(m, 1.0 + v[0]);
                 }});
  // With a complex pair of roots there are no real Kp and 1/Ti to scale separately.
  const Loop& loop = model.loop;
  const bool apart = loop.order == 2 || loop.denominator[1] * loop.denominator[1] >
                                            4.0 * loop.denominator[0] * loop.denominator[2];
  if (apart)
    out.push_back(
        {"gain_change", {ratio("position_loop_gain")}, [](Model& m, std::span<const double> v) {
           Gains gains = gains_of(m.loop);
           gains.position *= 1.0 + v[0];
           set_gains(m.loop, gains);
         }});
  out.push_back(
      {"gain_change", {ratio("velocity_loop_gain")}, [](Model& m, std::span<const double> v) {
         for (double& a : m.loop.denominator) a *= 1.0 + v[0];
         for (std::size_t i = 1; i < kMaxOrder; ++i) m.loop.numerator[i] *= 1.0 + v[0];
       }});
  if (model.loop.order == 3 && apart)
    out.push_back(
        {"gain_change", {ratio("integral_gain")}, [](Model& m, std::span<const double> v) {
           Gains gains = gains_of(m.loop);
           gains.integral *= 1.0 + v[0];
           set_gains(m.loop, gains);
           m.loop.numerator[2] *= 1.0 + v[0];
         }});
  const auto feedforward = [](Model& m, double velocity, double acceleration) {
    const double k = m.loop.denominator[0];
    m.loop.numerator[0] -= acceleration;
    m.loop.numerator[1] -= k * velocity;
    if (m.loop.order == 3) m.loop.numerator[2] -= k * gains_of(m.loop).integral * velocity;
  };
  out.push_back({"feedforward_mismatch",
                 {{"velocity_feedforward", "1", 0.0, kRatioStep, false}},
                 [=](Model& m, std::span<const double> v) { feedforward(m, v[0], 0.0); }});
  out.push_back({"feedforward_mismatch",
                 {{"acceleration_feedforward", "1", 0.0, kRatioStep, false}},
                 [=](Model& m, std::span<const double> v) { feedforward(m, 0.0, v[0]); }});
  out.push_back({"added_friction",
                 {{"viscous", "1/s", 0.0, 1e-6, false}},
                 [](Model& m, std::span<const double> v) {
                   m.loop.denominator[0] += v[0];
                   m.loop.numerator[1] += v[0];
                 }});
  bool has_friction = false, has_constant = false, has_delay = false;
  for (std::size_t i = 0; i < model.effects.size(); ++i) {
    const std::size_t kind = model.effects[i].kind;
    const std::string cause(identity_of(kind).cause);
    // A law of friction, or asymmetric friction, which replaces one.
    const bool friction = is_friction_law(kind) || kind == kind_of<AsymmetricFriction>();
    has_friction = has_friction || friction;
    has_constant = has_constant || kind == kind_of<ConstantForce>();
    if (kind == kind_of<TimeDelay>()) {
      has_delay = true;
      out.push_back({"time_delay",
                     {{"delay_s", "s", 0.0, 1e-8, false}},
                     [i](Model& m, std::span<const double> v) { m.effects[i].shape[0] += v[0]; }});
    } else if (kind == kind_of<ConstantForce>()) {
      out.push_back(
          {"gravity_offset",
           {{"offset_mps2", "m/s^2", 0.0, 1e-6, false}},
           [i](Model& m, std::span<const double> v) { m.effects[i].coefficient[0] += v[0]; }});
    } else if (acts_on_axis(kind)) {
      const bool plays = two_mass_parameters(model.effects[i]).width > 0.0;
      std::size_t shape = 0;
      for (std::size_t k = 0; k < shapes_of(kind).size(); ++k) {
        if (shapes_of(kind)[k].name == (plays ? "width" : "frequency_hz")) shape = k;
      }
      out.push_back({cause,
                     {ratio(plays ? "width" : "frequency")},
                     [i, shape](Model& m, std::span<const double> v) {
                       m.effects[i].shape[shape] *= 1.0 + v[0];
                     }});
    } else if (friction || !cause.empty()) {
      out.push_back({friction ? "added_friction" : cause,
                     {ratio(friction ? "friction" : "size")},
                     [i](Model& m, std::span<const double> v) {
                       for (double& c : m.effects[i].coefficient) c *= 1.0 + v[0];
                     }});
    }
  }
  const auto append = [&](const char* cause, ChangedQuantity quantity, Effect effect, bool shape) {
    out.push_back({cause, {std::move(quantity)}, [=](Model& m, std::span<const double> v) {
                     m.effects.push_back(effect);
                     (shape ? m.effects.back().shape[0] : m.effects.back().coefficient[0]) = v[0];
                   }});
  };
  if (!has_friction) {
    Effect coulomb = make_effect<CoulombFriction>();
    append("added_friction", {"coulomb", "m/s^2", 0.0, 1e-6, false}, coulomb, false);
  }
  if (!has_constant && model.loop.order == 2)
    append("gravity_offset", {"offset_mps2", "m/s^2", 0.0, 1e-6, false},
           make_effect<ConstantForce>(), false);
  if (!has_delay)
    append("time_delay", {"delay_s", "s", 1e-4, 1e-8, false}, make_effect<TimeDelay>(), true);
  return out;
}

Change addition_to(const Model& model, std::size_t kind, const std::vector<double>& shapes) {
  constexpr double kStepShare = 1e-9;     // of the physical range,
  constexpr double kWidestRange = 200.0;  // at most of so many units
  Effect effect;
  effect.kind = kind;
  std::copy(shapes.begin(), shapes.end(), effect.shape.begin());
  const std::size_t replaced = kind_of(identity_of(kind).replaces);
  if (const Effect* old = model.find(replaced); old != nullptr)
    effect.coefficient[0] = old->coefficient[0];
  // Saturation removes all of the torque above the limit: its coefficient is 1 and not fitted.
  const bool known = limits_motor(kind);
  if (known) effect.coefficient[0] = 1.0;
  Change out;
  out.cause = identity_of(kind).cause;
  out.kind = kind;
  std::size_t i = 0;
  for (const Parameter& p : coefficients_of(kind)) {
    if (known) break;
    out.quantities.push_back({std::string(p.name), std::string(p.unit), effect.coefficient[i++],
                              kStepShare * std::min(p.upper - p.lower, kWidestRange), false});
  }
  // The velocity limit is that of the friction in the model and is not fitted.
  std::vector<std::size_t> free;
  for (std::size_t k = 0; k < shapes_of(kind).size(); ++k) {
    const Parameter& p = shapes_of(kind)[k];
    if (p.name == "velocity_limit") continue;
    free.push_back(k);
    out.quantities.push_back({std::string(p.name), std::string(p.unit), effect.shape[k],
                              1e-5 * std::max(std::abs(effect.shape[k]), 1e-6), false});
  }
  const std::size_t count = out.quantities.size() - free.size();  // of coefficients
  out.apply = [effect, replaced, free, count](Model& m, std::span<const double> v) {
    Effect added = effect;
    for (std::size_t c = 0; c < v.size(); ++c)
      (c < count ? added.coefficient[c] : added.shape[free[c - count]]) = v[c];
    const auto at = std::find_if(m.effects.begin(), m.effects.end(),
                                 [&](const Effect& e) { return e.kind == replaced; });
    if (at != m.effects.end()) {
      *at = added;
    } else {
      m.effects.push_back(added);
    }
  };
  return out;
}

}  // namespace servotwin
