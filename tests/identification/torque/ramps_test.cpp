// Ramps of constant velocity, and friction models fitted to them.
#include "identification/torque/ramps.h"

#include <gmock/gmock.h>

#include <cmath>
#include <numbers>

#include "identification/torque/friction_from_torque.h"
#include "tests/virtual_machine/friction_rigs.h"

namespace servotwin {
namespace {

namespace vm = virtual_machine;

/// Rests and ramps of these velocities in turn, 0.5 s each, with a torque that is known.
Segment ramps_and_rests(const std::vector<double>& velocities, double command_step) {
  Segment s;
  s.sample_time_s = 1e-3;
  std::vector<double> x, torque;
  double at = 0.0;
  for (const double v : velocities) {
    for (int k = 0; k < 500; ++k, x.push_back(at)) torque.push_back(0.0);
    for (int k = 0; k < 500; ++k, x.push_back(at)) {
      at += v * s.sample_time_s;
      torque.push_back(std::copysign(3.0, v) + 20.0 * v);
    }
  }
  s.command = Eigen::Map<Eigen::ArrayXd>(x.data(), static_cast<Eigen::Index>(x.size()));
  if (command_step > 0.0) s.command = (s.command / command_step).round() * command_step;
  s.actual = s.command;
  s.torque = Eigen::Map<Eigen::ArrayXd>(torque.data(), static_cast<Eigen::Index>(torque.size()));
  return s;
}

TEST(Ramps, AreFoundWithTheirVelocityAndMeanTorque) {
  const std::vector<double> velocities{1e-4, -1e-4, 2e-3, -2e-3, 0.1, -0.1};
  for (const double step : {0.0, 1e-9, 1e-7}) {  // of the command: exact, 1 nm, 0.1 um
    const auto ramps = ramps_of({ramps_and_rests(velocities, step)});
    ASSERT_EQ(ramps.size(), velocities.size()) << step;
    for (std::size_t i = 0; i < ramps.size(); ++i) {
      EXPECT_NEAR(ramps[i].velocity, velocities[i], std::max(1e-9, step)) << step;
      EXPECT_NEAR(ramps[i].torque, std::copysign(3.0, velocities[i]) + 20.0 * velocities[i], 1e-9);
      EXPECT_FALSE(ramps[i].stick_slip);
      // The middle 60 % of half a second that begins half a second after the one before.
      EXPECT_NEAR(ramps[i].begin_s, 0.6 + static_cast<double>(i), 0.011);
      EXPECT_NEAR(ramps[i].end_s, 0.9 + static_cast<double>(i), 0.011);
    }
  }
}

TEST(Ramps, AreAveragedWithinTheBand) {
  RampOptions options;
  options.centre = 0.025;
  options.band = 0.01;
  const auto ramps = ramps_of({ramps_and_rests({0.1}, 0.0)}, options);
  ASSERT_EQ(ramps.size(), 1U);
  EXPECT_NEAR(ramps[0].begin_s, 0.5 + 0.2, 0.002);
  EXPECT_NEAR(ramps[0].end_s, 0.5 + 0.3, 0.002);
}

// The drive chain of paper 001 with a loop too soft for its falling friction: at 1.9 mm/s, where
// friction falls most, it sticks and slips; at 20 mm/s it moves steadily.
TEST(Ramps, AnAxisThatWaitsAndJumpsHasStickSlip) {
  vm::Axis axis = vm::drive_chain_axis();
  for (double* gain : {&axis.drive.velocity_gain, &axis.drive.integral_gain}) *gain *= 0.3;
  const std::vector<double> velocities{1.9e-3, 20e-3}, bands{5e-3, 10e-3};
  const auto motion = vm::drive_chain_motion(velocities, bands);
  const vm::AxisRecord record = vm::record(axis, motion.command(), motion.duration());
  Segment s;
  s.sample_time_s = record.sample_time;
  s.command = record.command;
  s.actual = record.actual;
  s.torque = record.torque;
  const auto ramps = ramps_of({s});
  ASSERT_EQ(ramps.size(), 4U);
  for (const Ramp& ramp : ramps) {
    if (std::abs(ramp.velocity) < 5e-3) {
      EXPECT_TRUE(ramp.stick_slip) << ramp.velocity << ", ripple " << ramp.ripple;
    } else {
      EXPECT_FALSE(ramp.stick_slip) << ramp.velocity << ", ripple " << ramp.ripple;
    }
  }
  EXPECT_NEAR(stick_slip_below(ramps), 1.9e-3, 0.1e-3);
}

// Table 1 of paper 001 from what the virtual machine recorded on its motion, without the slowest
// velocities, which take ten minutes.
TEST(FrictionOnRamps, RecoversTheStribeckParametersOfTheDriveChain) {
  const auto velocities = vm::drive_chain_velocities();
  const auto bands = vm::drive_chain_bands();
  std::vector<double> v, b;
  for (std::size_t i = 9; i < velocities.size(); i += 2) {
    v.push_back(velocities[i]);
    b.push_back(bands[i]);
  }
  const vm::AxisRecord record = vm::drive_chain_record(v, b);
  Segment segment;
  segment.sample_time_s = record.sample_time;
  segment.command = record.command;
  segment.actual = record.actual;
  segment.torque = record.torque * (2.0 * std::numbers::pi / 0.04);  // N m to N over the lead
  const auto ramps = ramps_of({segment});
  ASSERT_EQ(ramps.size(), 2 * v.size());
  EXPECT_EQ(stick_slip_below(ramps), 0.0);

  const auto trials = compare_on_ramps(ramps);
  ASSERT_EQ(trials.size(), 4U);
  EXPECT_FALSE(trials[0].chosen);  // Coulomb and viscous alone
  const FrictionTrial& stribeck = trials[1];
  ASSERT_EQ(stribeck.structure.effects.front(), kind_of<Stribeck>());
  const Effect& found = stribeck.fit.model.effects[0];
  EXPECT_NEAR(found.coefficient[0], 611.18, 2.0);                         // Fc+
  EXPECT_NEAR(found.coefficient[1], 750.9, 2.0);                          // Fc-
  EXPECT_NEAR(found.coefficient[0] + found.coefficient[2], 944.2, 2.0);   // Fs+
  EXPECT_NEAR(found.coefficient[1] + found.coefficient[3], 1049.2, 2.0);  // Fs-
  EXPECT_NEAR(found.coefficient[4], 1904.2, 60.0);                        // Fv+
  EXPECT_NEAR(found.coefficient[5], 2565.0, 60.0);                        // Fv-
  EXPECT_NEAR(found.shape[0], 0.0065, 1e-4);                              // vs+
  EXPECT_NEAR(found.shape[1], 0.0074, 1e-4);                              // vs-
  EXPECT_NEAR(found.shape[2], 1.26, 0.01);                                // delta
  // On held-out data Stribeck, with nine physical parameters, is better than the network, because
  // it is the true law.
  const FrictionTrial& network = trials.back();
  ASSERT_EQ(network.structure.effects.front(), kind_of<FrictionMap>());
  EXPECT_LT(stribeck.held_out.rms, network.held_out.rms);
  EXPECT_LT(network.held_out.relative, 0.01);
}

TEST(FrictionOnRamps, NeedsEnoughVelocitiesInBothDirections) {
  const auto ramps =
      ramps_of({ramps_and_rests({1e-3, 2e-3, 5e-3, 0.01, 0.02, 0.05, 0.1, 0.2, -1e-3}, 0.0)});
  try {
    (void)compare_on_ramps(ramps);
    FAIL() << "one velocity in the negative direction was enough";
  } catch (const std::runtime_error& error) {
    EXPECT_THAT(error.what(), testing::HasSubstr("1 steady ramps in the negative direction"));
  }
}

}  // namespace
}  // namespace servotwin
