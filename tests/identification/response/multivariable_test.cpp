// Several inputs and outputs with common poles, against machines that share no code with them.
#include "identification/response/multivariable.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

#include "identification/response/multivariable_problem.h"
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
  const auto add = [&](Eigen::ArrayXd input, MultivariableInput what) {
    record.inputs.push_back(std::move(input));
    out.inputs.push_back(what);
  };
  int source = 0;
  for (const auto& trace : traces)
    add(Spline::through(array(trace.command), out.sample_time_s).first, {true, source++});
  for (const auto& trace : traces) {
    for (const double distance : break_distances)
      add(array(trace.actual), {false, source, distance});
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
  const MultivariableFit fit = identify_multivariable(recorded(machine), {.most = 7});
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

TEST(LongMultivariable, FrictionOfBothAxesBesideBothModes) {
  const test::CoupledMachine machine = test::coupled_machine(62.0);
  const MultivariableFit without = identify_multivariable(recorded(machine), {.order = 6});
  const MultivariableFit coulomb =
      identify_multivariable(recorded(machine, {0.1e-6}), {6, 6, 0.7, false});
  const MultivariableFit slip =
      identify_multivariable(recorded(machine, {1e-6, 4e-6, 10e-6, 20e-6}), {6, 6, 0.7, false});
  for (int axis = 0; axis < 2; ++axis) {
    EXPECT_LT(slip.holdout(axis), 0.25 * coulomb.holdout(axis));
    EXPECT_LT(coulomb.holdout(axis), 0.6 * without.holdout(axis));
    EXPECT_LT(slip.holdout(axis), 2e-3 * slip.holdout_outputs(axis));
    EXPECT_GT(slip.parts(axis, 2 + axis), 2.0 * slip.parts(axis, 3 - axis));
  }
  expect_modes(slip, machine, 0.01, 0.1);
}

TEST(Multivariable, FindsWhereAFrictionBreaksAway) {
  const hidden_effects::Rig rig = test::coupled_machine(62.0).axes[0];
  const auto trace = hidden_effects::simulate(rig, test::production_of_both()[0]);
  const double h = rig.reading.sample_time;
  MultivariableData data{h, {{true, 0}}, {{}}};
  MultivariableRecord& record = data.records[0];
  record.inputs = {Spline::through(array(trace.command), h).first};
  for (const double distance : {1e-6, 2e-6, 5e-6, 10e-6, 30e-6}) {
    record.inputs.push_back(array(trace.actual));
    data.inputs.push_back({false, 1, distance});
  }
  record.outputs = {array(trace.command) - array(trace.actual)};
  const MultivariableFit held = identify_multivariable(data, {4, 4, 0.7, false});
  EXPECT_NEAR(held.break_distances[2], 2e-6, 1e-12);
  EXPECT_EQ(held.break_deviations[2], 0.0);
  const MultivariableFit fit = identify_multivariable(data, {.order = 4});
  EXPECT_LT(fit.holdout(0), 0.5 * held.holdout(0));
  // Its elements break away after (i / 5)^2 of the presliding distance (gms_with_curve). The first
  // one does so within eight steps of the encoder, whose noise makes it look longer.
  EXPECT_TRUE(fit.distances.taken);
  EXPECT_LT(fit.distances.left_found, 0.5 * fit.distances.left_given);
  std::vector<std::pair<double, double>> found;
  for (std::size_t i = 1; i < 6; ++i)
    found.emplace_back(fit.break_distances[i], fit.break_deviations[i]);
  std::sort(found.begin(), found.end());
  for (std::size_t i = 1; i < 5; ++i) {
    const double truth =
        rig.friction.presliding_distance * std::pow(static_cast<double>(i + 1) / 5.0, 2.0);
    EXPECT_NEAR(found[i].first, truth, 0.1 * truth) << i;
    EXPECT_GT(found[i].second, 1e-4 * truth);
    EXPECT_LT(found[i].second, 0.1 * truth);
  }
}

// An element that does not slide is the position, and with it the error an identity.
TEST(Multivariable, NoElementBreaksAwayBeyondAQuarterOfTheTravel) {
  const hidden_effects::Rig rig = test::coupled_machine(62.0).axes[0];
  hidden_effects::Command command;
  hidden_effects::Random random(7);
  while (command.duration() < 8.0)
    command.move_to(60e-6 * random.between(-1.0, 1.0), {0.01, 2.0, 200.0});
  const auto trace = hidden_effects::simulate(rig, command);
  const double h = rig.reading.sample_time;
  MultivariableData data{h, {{true, 0}, {false, 1, 2e-6}, {false, 1, 15e-6}}, {{}}};
  data.records[0].inputs = {Spline::through(array(trace.command), h).first, array(trace.actual),
                            array(trace.actual)};
  data.records[0].outputs = {array(trace.command) - array(trace.actual)};
  const double longest = longest_break_distance(data, 2);
  // Its friction has elements beyond what is left to seek.
  data.inputs[1].break_distance = 0.2 * longest;
  data.inputs[2].break_distance = 0.4 * longest;
  const MultivariableFit fit = identify_multivariable(data, {.order = 4});
  const Eigen::ArrayXd first = array(trace.actual).head(std::ssize(trace.actual) * 7 / 15);
  EXPECT_NEAR(longest, 0.25 * (first.maxCoeff() - first.minCoeff()), 1e-7);
  EXPECT_LT(longest, 60e-6);
  EXPECT_TRUE(fit.distances.taken);
  for (const double distance : fit.break_distances) EXPECT_LE(distance, 1.0001 * longest);
  EXPECT_GT(fit.holdout(0), 0.9 * floor_of(rig));
  data.inputs[2].break_distance = 2.0 * longest;
  test::expect_error<std::runtime_error>([&] { (void)identify_multivariable(data); },
                                         {"input 3", "equals the position", "at most"});
}

TEST(Multivariable, DerivativesByBreakDistancesAreThoseOfTheCost) {
  // Kaufman's Jacobian is not the residual's, but its gradient is exact.
  const MultivariableData data = recorded(test::coupled_machine(62.0), {2e-6, 15e-6});
  MultivariableProblem problem(data, 0.2);
  MultivariablePlace at{
      {true, false},
      {std::log(250.0), std::log(0.1), std::log(40.0)},
      // No multiples of the encoder's step: an element that just reaches its
      // level has two derivatives.
      {std::log(2.03e-6), std::log(15.17e-6), std::log(3.07e-6), std::log(11.13e-6)}};
  const auto here = problem.solve(at, {false, true});
  const Eigen::Map<const Eigen::VectorXd> residual(here.residual.data(), here.residual.size());
  const Eigen::VectorXd gradient = here.by_distances.transpose() * residual;
  for (std::size_t e = 0; e < at.log_distances.size(); ++e) {
    constexpr double kStep = 1e-4;
    const auto cost = [&](double by) {
      MultivariablePlace moved = at;
      moved.log_distances[e] += by;
      return 0.5 * problem.solve(moved, {}).residual.squaredNorm();
    };
    const double difference = (cost(kStep) - cost(-kStep)) / (2.0 * kStep);
    EXPECT_NEAR(gradient(static_cast<Eigen::Index>(e)), difference,
                1e-3 * gradient.cwiseAbs().maxCoeff());
  }
}

TEST(Multivariable, MatricesAndAnswersAreTheFit) {
  const MultivariableData data = recorded(test::coupled_machine(62.0), {2e-6, 15e-6});
  const MultivariableFit fit = identify_multivariable(data, {5, 5, 0.7, false});
  const MultivariableMatrices m = matrices_of(fit);
  ASSERT_EQ(m.a.rows(), 15);
  for (const double w : {1.0, 60.0, 280.0, 900.0}) {
    const Eigen::MatrixXcd s =
        std::complex<double>(0.0, w) * Eigen::MatrixXcd::Identity(m.a.rows(), m.a.rows());
    const Eigen::MatrixXcd answer =
        m.c * (s - m.a).partialPivLu().solve(m.b.cast<std::complex<double>>()) + m.d;
    for (std::size_t j = 0; j < 3; ++j) {
      for (std::size_t i = 0; i < data.inputs.size(); ++i)
        EXPECT_LT(std::abs(answer(static_cast<Eigen::Index>(j), static_cast<Eigen::Index>(i)) -
                           fit.at(j, i, w)),
                  1e-9 * std::abs(fit.at(j, i, w)));
    }
  }
  // Of all inputs, what is left of the outputs where the start is forgotten is the hold-out's.
  const MultivariableRecord& record = data.records[0];
  const Eigen::MatrixXd answers =
      answer_of(fit, data, record, std::vector<bool>(data.inputs.size(), true));
  const Eigen::Index held = record.outputs[0].size() * 3 / 10;
  for (std::size_t j = 0; j < 3; ++j) {
    const auto row = static_cast<Eigen::Index>(j);
    Eigen::ArrayXd left = record.outputs[j].tail(held) - answers.col(row).tail(held).array();
    left -= left.mean();
    EXPECT_NEAR(std::sqrt(left.square().mean()), fit.holdout(row), 0.05 * fit.holdout(row)) << j;
  }
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
  const MultivariableFit fit = identify_multivariable({h, {{}}, {{{u}, {y}}}}, {.order = 3});
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
  const MultivariableData good{1e-3, {{}}, {{{u}, {u.square()}}}};
  MultivariableData data = good;
  data.records[0].inputs = {still};
  test::expect_error<std::runtime_error>([&] { (void)identify_multivariable(data); },
                                         {"input 1 never changes"});
  data = good;
  data.records[0] = {{u.head(12)}, {u.head(12)}};
  test::expect_error<std::runtime_error>([&] { (void)identify_multivariable(data); },
                                         {"too short"});
  test::expect_error<std::runtime_error>(
      [&] { (void)identify_multivariable(good, {.order = kMaxPoles + 1}); }, {"between 1 and 16"});
  test::expect_error<std::runtime_error>(
      [&] { (void)identify_multivariable(good, {.training_share = 1.0}); }, {"training share"});
  test::expect_error<std::runtime_error>(
      [] {
        (void)identify_multivariable({1e-3, {}, {}});
      },
      {"needs a record"});
}

}  // namespace
}  // namespace servotwin
