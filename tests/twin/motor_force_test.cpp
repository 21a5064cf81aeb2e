// The force of the motor that a twin gives beside the position: acceleration and forces on the
// axis, whatever the control does to make it.
#include <gtest/gtest.h>

#include <cmath>
#include <string_view>

#include "twin/twin.h"
#include "twin/two_pi.h"

namespace servotwin {
namespace {

Model axis_with(std::string_view id) {
  Model model;
  model.sample_time_s = 1e-3;
  model.loop.order = 3;
  model.loop.denominator = {200.0, 14000.0, 240000.0};
  model.loop.numerator = {0.7, 100.0, 3000.0};
  Effect effect;
  effect.kind = kind_of(id);
  std::size_t i = 0;
  for (const Parameter& p : shapes_of(effect.kind)) effect.shape[i++] = p.start;
  i = 0;
  for (const Parameter& p : coefficients_of(effect.kind))
    effect.coefficient[i++] = p.start != 0.0 ? p.start : 0.1;
  if (limits_motor(effect.kind)) {
    effect.shape[0] = 0.5;  // of 2 m/s^2 that the motion asks for
    effect.coefficient[0] = 1.0;
  }
  model.effects.push_back(effect);
  return model;
}

/// The largest of motor force minus acceleration, and of all disturbances.
struct Largest {
  double force = 0.0, disturbance = 0.0;
};
Largest largest_of(const Model& model) {
  Twin twin(model);
  twin.start(0.0);
  Largest out;
  for (int k = 1; k < 2000; ++k) {
    const double t = 1e-3 * k, w = kTwoPi * 1.3;
    (void)twin.follow(0.015 * (1.0 - std::cos(w * t)) / 2.0 * (t < 1.0 ? t : 1.0));
    out.force = std::max(out.force, std::abs(twin.motor_force() - twin.acceleration()));
    out.disturbance = std::max(out.disturbance, std::abs(twin.demand() - twin.acceleration()));
  }
  return out;
}

TEST(MotorForce, OfWhatTheControlDoesIsTheAccelerationAlone) {
  for (const char* id :
       {"control_filter", "gain_change", "feedforward_mismatch", "torque_saturation",
        "torque_saturation_holding", "torque_saturation_back_calculation"}) {
    const Largest largest = largest_of(axis_with(id));
    EXPECT_GT(largest.disturbance, 1e-6) << id;  // or it shows nothing
    EXPECT_LT(largest.force, 1e-9 * largest.disturbance) << id;
  }
}

TEST(MotorForce, CarriesEveryForceOnTheAxis) {
  for (const char* id : {"coulomb_friction", "gravity_offset", "cogging", "inertia_change",
                         "asymmetric_friction", "periodic_disturbance"}) {
    const Largest largest = largest_of(axis_with(id));
    EXPECT_GT(largest.disturbance, 1e-4) << id;
    EXPECT_NEAR(largest.force / largest.disturbance, 1.0, 1e-12) << id;
  }
}

}  // namespace
}  // namespace servotwin
