// Several inputs and outputs with common poles, against machines that share no code with them.
#include "identification/multivariable.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "tests/support/coupled_machine.h"
#include "tests/support/expect_error.h"
#include "tests/virtual_machine/trajectory.h"
#include "twin/hold.h"

namespace servotwin {
namespace {

Eigen::ArrayXd array(const std::vector<double>& v) {
  return Eigen::Map<const Eigen::ArrayXd>(v.data(), static_cast<Eigen::Index>(v.size()));
}

/// The noise of an encoder and its steps.
double floor_of(const hidden_effects::Rig& rig) {
  return std::hypot(rig.reading.noise, rig.reading.step / std::sqrt(12.0));
}

/// Both axes of a machine: from the velocity of both commands, and the elements of both frictions,
/// to both tracking errors and the force of X's motor.
MultivariableData recorded(const test::CoupledMachine& machine,
                           const std::vector<double>& break_distances = {}) {
  const auto traces = test::simulate(machine, test::production_of_both());
  MultivariableData out;
  out.sample_time_s = machine.axes[0].reading.sample_time;
  MultivariableRecord record;
  const auto add = [&](Eigen::ArrayXd input, bool smooth, int source) {
    record.inputs.push_back(std::move(input));
    out.smooth.push_back(smooth);
    out.source.push_back(source);
  };
  int source = 0;
  for (const auto& trace : traces)
    add(Spline::through(array(trace.command), out.sample_time_s).first, true, source++);
  for (const auto& trace : traces) {
    for (const double distance : break_distances)
      add(friction_input(array(trace.actual), distance), false, source);
    ++source;
  }
  for (const auto& trace : traces)
    record.outputs.push_back(array(trace.command) - array(trace.actual));
  record.outputs.push_back(array(traces[0].force));
  out.records = {record};
  return out;
}

/// Two axes that push each other and both vibrate, with viscous friction alone.
test::CoupledMachine linear_machine() {
  test::CoupledMachine machine = test::coupled_machine(62.0);
  for (hidden_effects::Rig& axis : machine.axes) axis.friction.level = 0.0;
  return machine;
}

/// Both modes of the machine are among the poles.
void expect_modes(const MultivariableFit& fit, const test::CoupledMachine& machine,
                  double frequency, double damping) {
  for (const std::complex<double> mode : test::modes_of(machine)) {
    const double omega = std::abs(mode), zeta = -mode.real() / omega;
    const auto nearest =
        std::min_element(fit.poles.begin(), fit.poles.end(), [&](const auto& l, const auto& r) {
          return std::abs(l.omega - omega) < std::abs(r.omega - omega);
        });
    EXPECT_NEAR(nearest->omega, omega, frequency * omega);
    EXPECT_NEAR(nearest->zeta, zeta, damping * zeta);
    EXPECT_TRUE(nearest->determined());
  }
}

TEST(Multivariable, FindsTheModesOfTwoAxesFromBothCommandsAndThreeOutputs) {
  const test::CoupledMachine machine = linear_machine();
  const MultivariableFit fit = identify_multivariable(recorded(machine));
  expect_modes(fit, machine, 1e-3, 0.02);
  for (int axis = 0; axis < 2; ++axis) {
    const double floor = floor_of(machine.axes[static_cast<std::size_t>(axis)]);
    EXPECT_LT(fit.holdout(axis), 1.05 * floor);
    EXPECT_GT(fit.holdout(axis),
              0.95 * floor);  // below it, it would have seen what it is judged by
    EXPECT_GT(fit.parts(axis, axis), 100.0 * fit.parts(axis, 1 - axis));
    EXPECT_GT(fit.parts(axis, 1 - axis), 10.0 * floor);  // the other axis' push
  }
  EXPECT_LT(fit.holdout(2), 1e-4 * fit.holdout_outputs(2));
  // W: what is left of each, metres and newtons.
  EXPECT_NEAR(fit.scale(0), fit.training(0), 0.05 * fit.training(0));
  EXPECT_NEAR(fit.scale(2), fit.training(2), 0.5 * fit.training(2));
  EXPECT_EQ(1, std::count_if(fit.trials.begin(), fit.trials.end(),
                             [](const MultivariableTrial& trial) { return trial.chosen; }));
}

TEST(Multivariable, UnitsOfTheOutputsDoNotMatter) {
  MultivariableData data = recorded(linear_machine());
  const MultivariableFit before = identify_multivariable(data, {.order = 6});
  data.records[0].outputs[1] *= 1e6;
  data.records[0].outputs[2] *= 1e-3;
  const MultivariableFit after = identify_multivariable(data, {.order = 6});
  ASSERT_EQ(before.poles.size(), after.poles.size());
  for (std::size_t k = 0; k < before.poles.size(); ++k)
    EXPECT_NEAR(after.poles[k].omega, before.poles[k].omega, 1e-3 * before.poles[k].omega);
  EXPECT_NEAR(after.holdout(1), 1e6 * before.holdout(1), 1e3 * before.holdout(1));
}

TEST(Multivariable, FrictionOfBothAxesBesideBothModes) {
  const test::CoupledMachine machine = test::coupled_machine(62.0);
  const MultivariableFit without = identify_multivariable(recorded(machine), {.order = 6});
  const MultivariableFit coulomb =
      identify_multivariable(recorded(machine, {0.1e-6}), {.order = 6});
  const MultivariableFit slip =
      identify_multivariable(recorded(machine, {1e-6, 4e-6, 10e-6, 20e-6}), {.order = 6});
  for (int axis = 0; axis < 2; ++axis) {
    EXPECT_LT(slip.holdout(axis), 0.25 * coulomb.holdout(axis));
    EXPECT_LT(coulomb.holdout(axis), 0.6 * without.holdout(axis));
    EXPECT_LT(slip.holdout(axis), 2e-3 * slip.holdout_outputs(axis));
    EXPECT_GT(slip.parts(axis, 2 + axis), 2.0 * slip.parts(axis, 3 - axis));
  }
  expect_modes(slip, machine, 0.01, 0.1);
}

TEST(Multivariable, AnswersAtAFrequencyAsTheMachineDoes) {
  // A real pole, a pair and a part that passes at once, in closed form.
  constexpr double kPole = 30.0, kOmega = 80.0, kZeta = 0.2;
  const auto truth = [&](double w) {
    const std::complex<double> s(0.0, w);
    return 0.5 + 2.0 / (s + kPole) +
           (3.0 * s + 400.0) / (s * s + 2.0 * kZeta * kOmega * s + kOmega * kOmega);
  };
  const double h = 1e-3;
  Eigen::ArrayXd u = Eigen::ArrayXd::Zero(4000), y = u;
  for (const double w : {5.0, 12.0, 40.0, 75.0, 110.0, 170.0}) {
    for (Eigen::Index k = 0; k < u.size(); ++k) {
      const double t = h * static_cast<double>(k);
      u(k) += std::sin(w * t);
      y(k) += std::abs(truth(w)) * std::sin(w * t + std::arg(truth(w)));
    }
  }
  const MultivariableFit fit = identify_multivariable({h, {true}, {}, {{{u}, {y}}}}, {.order = 3});
  ASSERT_EQ(fit.poles.size(), 2U);
  EXPECT_NEAR(fit.poles[0].omega, kPole, 1e-3 * kPole);
  EXPECT_NEAR(fit.poles[1].omega, kOmega, 1e-3 * kOmega);
  EXPECT_NEAR(fit.poles[1].zeta, kZeta, 1e-3);
  for (const double w : {0.0, 12.0, 100.0, 300.0})
    EXPECT_LT(std::abs(fit.at(0, 0, w) - truth(w)), 2e-3 * std::abs(truth(w))) << w;
}

TEST(Multivariable, AnElementOfFrictionSlidesAfterItsDistanceAndRemembersWhereItTurned) {
  Eigen::ArrayXd x(5);
  x << 0.0, 3.0, 9.0, 4.0, 4.0;
  Eigen::ArrayXd expected(5);
  expected << 0.0, 0.6, 1.0, 0.0, 0.0;
  EXPECT_TRUE(friction_input(x, 5.0).isApprox(expected, 1e-12));
}

TEST(Multivariable, SaysWhatItCannotUse) {
  const Eigen::ArrayXd u = Eigen::ArrayXd::LinSpaced(1000, 0.0, 9.0).sin(), still = 0.0 * u;
  const MultivariableData good{1e-3, {true}, {}, {{{u}, {u.square()}}}};
  MultivariableData data = good;
  data.records[0].inputs = {still};
  test::expect_error<std::runtime_error>([&] { (void)identify_multivariable(data); },
                                         {"input 1 never changes"});
  data = good;
  data.records[0] = {{u.head(12)}, {u.head(12)}};
  test::expect_error<std::runtime_error>([&] { (void)identify_multivariable(data); },
                                         {"too short"});
  test::expect_error<std::runtime_error>(
      [&] { (void)identify_multivariable(good, {.order = kMostPoles + 1}); }, {"between 1 and 16"});
  test::expect_error<std::runtime_error>(
      [&] { (void)identify_multivariable(good, {.training_share = 1.0}); }, {"training share"});
  test::expect_error<std::runtime_error>(
      [] {
        (void)identify_multivariable({1e-3, {}, {}, {}});
      },
      {"needs a record"});
}

}  // namespace
}  // namespace servotwin
