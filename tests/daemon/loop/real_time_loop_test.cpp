#include "daemon/loop/real_time_loop.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <complex>
#include <utility>
#include <vector>

#include "daemon/between/clock.h"
#include "tests/daemon/support.h"
#include "twin/neighbour.h"

namespace servotwin::daemon {
namespace {

TwinInForce in_force(const Model& model, int version = 1) {
  return {Twin(model), version, 1.3e-6, settling_cycles(model)};
}

/// A loop with its rings, and frames to put in.
class Loop {
 public:
  explicit Loop(std::size_t axes = 1, std::size_t row_room = 16'384,
                const std::vector<std::vector<std::size_t>>& paths = {})
      : models(axes), rows(row_room), loop(kCycle_s, models, predictions, rows, wake_up, paths) {}

  [[nodiscard]] MachineFrame frame(std::uint64_t k) const {
    MachineFrame out;
    out.sequence = k;
    out.time_ns = static_cast<std::int64_t>(k) * 1'000'000;
    out.axis_count = static_cast<int>(models.size());
    for (std::size_t i = 0; i < models.size(); ++i) {
      const double command =
          command_at(static_cast<double>(k) * kCycle_s) * static_cast<double>(i + 1);
      out.axes[i] = {command, command - 2e-6, kAbsent};
    }
    return out;
  }
  MachinePrediction put(const MachineFrame& frame) {
    loop.on_frame(frame, {});
    MachinePrediction out;
    EXPECT_TRUE(predictions.pop(out));
    return out;
  }
  MachinePrediction put(std::uint64_t k) { return put(frame(k)); }
  CycleRow newest_row() {
    CycleRow row;
    while (rows.pop(row)) {
    }
    return row;
  }

  std::vector<LatestValue<TwinInForce>> models;
  Ring<MachinePrediction> predictions{16};
  Ring<CycleRow> rows;
  WakeUp wake_up;
  RealTimeLoop loop;
};

/// The twin alone, along the same commands from the first one.
std::vector<double> twin_alone(const Model& model, std::uint64_t cycles) {
  Twin twin(model);
  std::vector<double> out;
  for (std::uint64_t k = 0; k < cycles; ++k) {
    const double command = command_at(static_cast<double>(k) * kCycle_s);
    if (k == 0) {
      twin.start(command);
      out.push_back(command - twin.position());
    } else {
      out.push_back(twin.follow(command));
    }
  }
  return out;
}

TEST(RealTimeLoop, PredictsWhatTheTwinSays) {
  Loop loop;
  loop.models[0].publish(in_force(drive(), 7));
  const std::vector<double> truth = twin_alone(drive(), 3000);
  for (std::uint64_t k = 0; k < 3000; ++k) {
    const MachinePrediction prediction = loop.put(k);
    const AxisPrediction& axis = prediction.axes[0];
    ASSERT_EQ(axis.predicted_error, truth[k]) << k;
    ASSERT_EQ(axis.model_version, 7);
    ASSERT_EQ(axis.standard_deviation, 1.3e-6);
    ASSERT_NEAR(axis.measured_error, 2e-6, 1e-15);
    ASSERT_EQ(axis.residual, axis.measured_error - axis.predicted_error);
    ASSERT_EQ(prediction.sequence, k);
    ASSERT_EQ(prediction.time_ns, static_cast<std::int64_t>(k) * 1'000'000);
  }
}

TEST(RealTimeLoop, EveryAxisHasItsOwnTwin) {
  Loop loop(2);
  loop.models[1].publish(in_force(drive()));
  for (std::uint64_t k = 0; k < 500; ++k) {
    const MachinePrediction prediction = loop.put(k);
    ASSERT_EQ(prediction.axis_count, 2);
    ASSERT_EQ(prediction.axes[0].state, AxisState::kNoModel);
    ASSERT_TRUE(std::isnan(prediction.axes[0].predicted_error));
    ASSERT_NEAR(prediction.axes[0].measured_error, 2e-6, 1e-15);
    ASSERT_TRUE(std::isfinite(prediction.axes[1].predicted_error));
  }
}

// The prediction of a cycle is made before its encoder value is used: it cannot depend on it.
TEST(RealTimeLoop, ThePredictionDoesNotDependOnAnyEncoderValue) {
  Loop with, without, wrong;
  for (Loop* loop : {&with, &without, &wrong}) loop->models[0].publish(in_force(drive()));
  for (std::uint64_t k = 0; k < 500; ++k) {
    MachineFrame none = without.frame(k), bad = wrong.frame(k);
    none.axes[0].actual = kAbsent;
    bad.axes[0].actual = k % 2 == 0 ? INFINITY : 1e9;
    const AxisPrediction a = with.put(k).axes[0], b = without.put(none).axes[0],
                         c = wrong.put(bad).axes[0];
    ASSERT_EQ(a.predicted_error, b.predicted_error);
    ASSERT_EQ(a.predicted_error, c.predicted_error);
    ASSERT_EQ(a.state, b.state);
    ASSERT_TRUE(std::isnan(b.measured_error) && std::isnan(b.residual));
  }
  EXPECT_EQ(without.loop.counters().not_finite, 0U) << "no encoder value is not a wrong one";
  EXPECT_EQ(wrong.loop.counters().not_finite, 250U);
}

TEST(RealTimeLoop, WhatIsPredictedAheadComesTrue) {
  constexpr int kAhead = 8;
  Loop loop;
  loop.models[0].publish(in_force(drive()));
  std::vector<MachinePrediction> all;
  for (std::uint64_t k = 0; k < 400; ++k) {
    MachineFrame frame = loop.frame(k);
    frame.ahead_count = kAhead;
    for (std::uint64_t i = 0; i < kAhead; ++i)
      frame.ahead[0][i] = loop.frame(k + 1 + i).axes[0].command;
    all.push_back(loop.put(frame));
  }
  for (std::size_t k = 0; k + kAhead < all.size(); ++k) {
    ASSERT_EQ(all[k].ahead_count, kAhead);
    for (std::size_t i = 0; i < kAhead; ++i) {
      ASSERT_EQ(all[k].ahead[0][i], all[k + 1 + i].axes[0].predicted_error) << k << " + " << i + 1;
    }
  }
}

/// X feels the acceleration of Y, which moves twice as far.
Model coupled_drive() {
  Model model = drive();
  Effect coupling = make_effect<CrossCoupling>();
  coupling.coefficient[0] = -0.1;
  model.effects.push_back(coupling);
  return model;
}
TwinInForce coupled(int version = 1) {
  TwinInForce out = in_force(coupled_drive(), version);
  out.neighbour = 1;
  return out;
}

TEST(RealTimeLoop, AnotherAxisActsOnAnAxisAsInTheSimulation) {
  constexpr std::uint64_t kCycles = 3000, kSwap = 1500;
  Loop loop(2), later(2);
  loop.models[0].publish(coupled());
  later.models[0].publish(in_force(drive()));
  Segment segment;
  segment.sample_time_s = kCycle_s;
  segment.command = segment.neighbour = Eigen::ArrayXd(static_cast<Eigen::Index>(kCycles));
  Eigen::ArrayXd predicted(segment.command.size());
  double apart = 0.0;
  for (std::uint64_t k = 0; k < kCycles; ++k) {
    if (k == kSwap) later.models[0].publish(coupled(2));
    const auto at = static_cast<Eigen::Index>(k);
    const MachineFrame frame = loop.frame(k);
    segment.command(at) = frame.axes[0].command;
    segment.neighbour(at) = frame.axes[1].command;
    predicted(at) = loop.put(frame).axes[0].predicted_error;
    const AxisPrediction of_later = later.put(frame).axes[0];
    if (of_later.model_version == 2) apart = std::abs(of_later.predicted_error - predicted(at));
  }
  EXPECT_LT(apart, 1e-9) << "a new model gets the history of the other axis as well";
  Segment alone = segment;
  alone.neighbour.resize(0);
  segment.actual = alone.actual = segment.command;
  const Model model = coupled_drive();
  constexpr Eigen::Index kSettled = 500;
  const Eigen::Index count = predicted.size() - kSettled;
  const Eigen::ArrayXd whole = simulate(model, segment).tail(count),
                       without = simulate(model, alone).tail(count);
  const double by_other = std::sqrt((whole - without).square().mean());
  const double wrong = std::sqrt((predicted.tail(count) - whole).square().mean());
  EXPECT_GT(by_other, 1e-6);
  EXPECT_LT(wrong, 0.03 * by_other) << "from the commands of the past alone";
}

TEST(RealTimeLoop, WhatIsPredictedAheadBesideAnotherAxisComesTrue) {
  constexpr int kAhead = 8;
  Loop loop(2);
  loop.models[0].publish(coupled());
  std::vector<MachinePrediction> all;
  for (std::uint64_t k = 0; k < 400; ++k) {
    MachineFrame frame = loop.frame(k);
    frame.ahead_count = kAhead;
    for (std::uint64_t i = 0; i < kAhead; ++i) {
      for (std::size_t axis = 0; axis < 2; ++axis)
        frame.ahead[axis][i] = loop.frame(k + 1 + i).axes[axis].command;
    }
    all.push_back(loop.put(frame));
  }
  for (std::size_t k = 0; k + kAhead < all.size(); ++k) {
    for (std::size_t i = 0; i < kAhead; ++i) {
      ASSERT_EQ(all[k].ahead[0][i], all[k + 1 + i].axes[0].predicted_error) << k << " + " << i + 1;
    }
  }
}

/// An axis that another one pushes by its motion; with a vibration of 45 Hz, as one of 30 of 100 kg
/// on a spring.
Model pushed(double ratio, bool vibrates = false) {
  Model model = drive();
  if (vibrates) model.loop.modes.push_back({281.0, 0.03, -0.022, 39.0, 8e-5, 0.97});
  model.effects.push_back(make_effect<CrossCouplingByMotion>());
  model.effects.back().coefficient[0] = ratio;
  return model;
}
TwinInForce pushed_by(int neighbour, double ratio, bool vibrates = false) {
  TwinInForce out = in_force(pushed(ratio, vibrates));
  out.neighbour = neighbour;
  out.by_motion = true;
  return out;
}

// The truth is the simulation of the whole motion (tests/twin/neighbour_test.cpp).
TEST(RealTimeLoop, AxesThatPushEachOtherArePredictedTogether) {
  constexpr std::uint64_t kCycles = 3000;
  constexpr Eigen::Index kSettled = 500;
  for (const bool mutual : {false, true}) {
    const std::array<double, 2> ratio{-0.13, mutual ? -0.04 : 0.0};
    Loop loop(2);
    std::array<Segment, 2> axis;
    std::array<Eigen::ArrayXd, 2> predicted;
    for (std::size_t i = 0; i < 2; ++i) {
      loop.models[i].publish(i == 0 || mutual ? pushed_by(i == 0 ? 1 : 0, ratio[i], i == 0)
                                              : in_force(drive()));
      axis[i].sample_time_s = kCycle_s;
      axis[i].command = predicted[i] = Eigen::ArrayXd(static_cast<Eigen::Index>(kCycles));
    }
    for (std::uint64_t k = 0; k < kCycles; ++k) {
      const MachineFrame frame = loop.frame(k);
      const MachinePrediction prediction = loop.put(frame);
      for (std::size_t i = 0; i < 2; ++i) {
        axis[i].command(static_cast<Eigen::Index>(k)) = frame.axes[i].command;
        predicted[i](static_cast<Eigen::Index>(k)) = prediction.axes[i].predicted_error;
      }
    }
    for (std::size_t i = 0; i < (mutual ? 2U : 1U); ++i) {
      const std::array models{pushed(ratio[0], true), mutual ? pushed(ratio[1]) : drive()};
      const Model& model = models[i];
      axis[i].neighbour = axis[1 - i].command;
      Segment by_command = axis[i], without = axis[i];
      without.neighbour.resize(0);
      predict_neighbour(axis[i], model, models[1 - i], mutual);
      const auto apart = [&](const Eigen::ArrayXd& error) {
        return std::sqrt(
            (predicted[i] - error).tail(predicted[i].size() - kSettled).square().mean());
      };
      const double wrong = apart(simulate(model, axis[i]));
      EXPECT_LT(wrong, 0.03 * apart(simulate(model, without))) << i << ", mutual " << mutual;
      EXPECT_LT(wrong, 0.02 * apart(simulate(model, by_command))) << i << ", mutual " << mutual;
    }
  }
}

TEST(RealTimeLoop, WhatIsPredictedAheadOfAxesThatPushEachOtherComesTrue) {
  constexpr int kAhead = 8;
  Loop loop(3);  // the third is pushed by the first, whose turn comes before
  loop.models[0].publish(pushed_by(1, -0.13, true));
  loop.models[1].publish(pushed_by(0, -0.04));
  loop.models[2].publish(pushed_by(0, 0.2));
  std::vector<MachinePrediction> all;
  for (std::uint64_t k = 0; k < 700; ++k) {
    MachineFrame frame = loop.frame(k);
    frame.ahead_count = kAhead;
    for (std::uint64_t i = 0; i < kAhead; ++i) {
      for (std::size_t axis = 0; axis < 3; ++axis)
        frame.ahead[axis][i] = loop.frame(k + 1 + i).axes[axis].command;
    }
    all.push_back(loop.put(frame));
  }
  constexpr std::size_t kSettled = 350;  // before, the command stands in for the motion
  for (std::size_t k = kSettled; k + kAhead < all.size(); ++k) {
    for (std::size_t i = 0; i < kAhead; ++i) {
      for (std::size_t axis = 0; axis < 3; ++axis)
        ASSERT_EQ(all[k].ahead[axis][i], all[k + 1 + i].axes[axis].predicted_error)
            << k << " + " << i + 1 << ", axis " << axis;
    }
  }
}

// What an axis does after a gap, or after a command that no axis follows, is no motion that others
// should follow; where X and Y push each other, whichever has its turn first.
TEST(RealTimeLoop, AFaultOfOneAxisDoesNotReachTheOtherByItsMotion) {
  constexpr std::uint64_t kFault = 1000, kEnd = 2000;
  for (const double wrong : {static_cast<double>(NAN), 5.0, 40.0}) {
    for (const std::size_t faulty : {0U, 1U}) {
      const std::size_t healthy = 1 - faulty;
      const auto of_healthy = [&](bool fault) {
        Loop loop(2);
        loop.models[healthy].publish(pushed_by(static_cast<int>(faulty), -0.13));
        loop.models[faulty].publish(pushed_by(static_cast<int>(healthy), -0.04));
        std::vector<AxisPrediction> out;
        for (std::uint64_t k = 0; k < kEnd; ++k) {
          MachineFrame frame = loop.frame(k);
          if (fault && k == kFault) frame.axes[faulty].command += wrong;
          out.push_back(loop.put(frame).axes[healthy]);
        }
        return out;
      };
      const std::vector<AxisPrediction> well = of_healthy(false), ill = of_healthy(true);
      double most = 0.0;
      bool waited = false;
      for (std::size_t k = kFault - 100; k < kEnd; ++k) {
        const double off = std::abs(ill[k].predicted_error - well[k].predicted_error);
        most = std::max(most, off);
        waited = waited || ill[k].state == AxisState::kSettling;
        if (ill[k].state == AxisState::kPredicting && k > kFault + 4) {
          ASSERT_LT(off, 1e-6) << wrong << ", axis " << faulty << ", cycle " << k - kFault;
        }
      }
      EXPECT_LT(most, 2e-5) << wrong << ", axis " << faulty << ": as by its command";
      EXPECT_TRUE(waited) << wrong << ", axis " << faulty;
      EXPECT_EQ(ill.back().state, AxisState::kPredicting);
    }
  }
}

// A model that comes into force again, as it is, changes nothing.
TEST(RealTimeLoop, ATakeoverAmongAxesThatPushEachOtherIsSmooth) {
  Loop loop(2), same(2);
  for (Loop* one : {&loop, &same}) {
    one->models[0].publish(pushed_by(1, -0.13));
    one->models[1].publish(pushed_by(0, -0.04));
  }
  for (std::uint64_t k = 0; k < 1500; ++k) {
    if (k == 1000) loop.models[0].publish(pushed_by(1, -0.13));
    const double before = same.put(k).axes[0].predicted_error;
    ASSERT_NEAR(loop.put(k).axes[0].predicted_error, before, 1e-8) << k;
  }
}

// Nothing predicts the motion of an axis without a model: its command stands in for it, then, with
// the model, its motion.
TEST(RealTimeLoop, TheCommandStandsInForAMotionThatNobodyPredicts) {
  Loop blind(2), by_command(2);
  blind.models[0].publish(pushed_by(1, -0.13));
  TwinInForce same = pushed_by(1, -0.13);
  same.by_motion = false;
  by_command.models[0].publish(same);
  for (std::uint64_t k = 0; k < 300; ++k)
    ASSERT_EQ(blind.put(k).axes[0].predicted_error, by_command.put(k).axes[0].predicted_error);
  blind.models[1].publish(in_force(drive()));
  double apart = 0.0;
  for (std::uint64_t k = 300; k < 900; ++k)
    apart = std::max(apart, std::abs(blind.put(k).axes[0].predicted_error -
                                     by_command.put(k).axes[0].predicted_error));
  EXPECT_GT(apart, 1e-7);
}

TEST(RealTimeLoop, ANeighbourWithoutACommandActsOnNobody) {
  Loop loop(2), alone(1);
  loop.models[0].publish(coupled());
  alone.models[0].publish(in_force(coupled_drive()));
  for (std::uint64_t k = 0; k < 300; ++k) {
    MachineFrame frame = loop.frame(k);
    // Absent, from now and then one to four in a row, and mad for fifty cycles.
    frame.axes[1].command = k < 100 || k % 5 == 0 ? NAN : k % 2 == 0 ? 1e300 : -1e300;
    frame.ahead_count = 2;
    for (std::uint64_t i = 0; i < 2; ++i) {
      frame.ahead[0][i] = loop.frame(k + 1 + i).axes[0].command;
      frame.ahead[1][i] = i == 0 ? 0.4 : NAN;
    }
    const MachinePrediction prediction = loop.put(frame);
    MachineFrame own = alone.frame(k);
    own.ahead_count = 2;
    own.ahead[0] = frame.ahead[0];
    const MachinePrediction of_alone = alone.put(own);
    ASSERT_EQ(prediction.axes[0].predicted_error, of_alone.axes[0].predicted_error) << k;
    for (std::size_t i = 0; i < 2; ++i)
      ASSERT_EQ(prediction.ahead[0][i], of_alone.ahead[0][i]) << k;
  }
}

/// A P-P drive without friction, and |T| of it: T = 1 - e / x_command.
Model linear_drive() {
  Model model = drive();
  model.effects.clear();
  return model;
}
double amplification(const Model& model, double omega) {
  const std::complex<double> s(0.0, omega);
  const auto& c = model.loop.numerator;
  const auto& a = model.loop.denominator;
  return std::abs(1.0 - s * (c[0] * s + c[1]) / (s * s + a[0] * s + a[1]));
}

// Linear loops, both alike, on a circle: eps = R (|T(j omega)| - 1).
TEST(RealTimeLoop, TheContourErrorOfACircleIsThatOfTheLoops) {
  constexpr double kRadius = 5e-3, kOmega = 40.0, kChord = 0.2e-3 * 0.2e-3 / (8.0 * kRadius);
  const double expected = kRadius * (amplification(linear_drive(), kOmega) - 1.0);
  ASSERT_GT(std::abs(expected), 5.0 * kChord);
  for (const std::size_t ahead : {0U, 10U}) {
    Loop loop(3, 16'384, {{2, 0}});  // 2 is cosine, 0 is sine: counter-clockwise
    for (const std::size_t axis : {0U, 2U}) loop.models[axis].publish(in_force(linear_drive()));
    const auto angle = [](std::uint64_t k) { return kOmega * static_cast<double>(k) * kCycle_s; };
    for (std::uint64_t k = 0; k < 1500; ++k) {
      MachineFrame frame = loop.frame(k);
      frame.ahead_count = static_cast<int>(ahead);
      frame.axes[2].command = kRadius * std::cos(angle(k));
      frame.axes[0].command = kRadius * std::sin(angle(k));
      for (std::size_t i = 0; i < ahead; ++i) {
        frame.ahead[2][i] = kRadius * std::cos(angle(k + 1 + i));
        frame.ahead[0][i] = kRadius * std::sin(angle(k + 1 + i));
      }
      const double contour_error = loop.put(frame).contour_error;
      if (k < 1000) continue;
      ASSERT_NEAR(contour_error, expected, kChord + 2e-3 * std::abs(expected)) << k;
    }
  }
}

// On a circle run counter-clockwise the contour error is the distance from the centre less the
// radius, of whatever point.
TEST(RealTimeLoop, TheMeasuredContourErrorIsThatOfTheEncoders) {
  constexpr double kRadius = 5e-3, kOmega = 40.0, kChord = 0.2e-3 * 0.2e-3 / (8.0 * kRadius);
  Loop loop(2, 16'384, {{1, 0}});  // without models: nothing is predicted
  for (std::uint64_t k = 0; k < 1000; ++k) {
    const double angle = kOmega * static_cast<double>(k) * kCycle_s;
    // The encoders lag, and the circle that they run on is wider on one side.
    const double radius = kRadius + 3e-6 + 2e-6 * std::sin(3.0 * angle), lagging = angle - 0.02;
    MachineFrame frame = loop.frame(k);
    frame.axes[1].command = kRadius * std::cos(angle);
    frame.axes[0].command = kRadius * std::sin(angle);
    frame.axes[1].actual = radius * std::cos(lagging);
    frame.axes[0].actual = radius * std::sin(lagging);
    const MachinePrediction prediction = loop.put(frame);
    EXPECT_TRUE(std::isnan(prediction.contour_error)) << k;
    if (k < 100) continue;
    ASSERT_NEAR(prediction.measured_contour_error, radius - kRadius, 1.01 * kChord) << k;
  }
  MachineFrame unmeasured = loop.frame(1000);
  unmeasured.axes[0].actual = kAbsent;
  EXPECT_TRUE(std::isnan(loop.put(unmeasured).measured_contour_error));
}

TEST(RealTimeLoop, TheContourErrorIsPredictedAndNotMeasured) {
  Loop with(2, 16'384, {{0, 1}}), without(2, 16'384, {{0, 1}});
  for (Loop* loop : {&with, &without}) {
    for (auto& model : loop->models) model.publish(in_force(drive()));
  }
  for (std::uint64_t k = 0; k < 500; ++k) {
    MachineFrame none = without.frame(k);
    none.axes[0].actual = none.axes[1].actual = kAbsent;
    const double contour_error = with.put(k).contour_error;
    ASSERT_TRUE(std::isfinite(contour_error));
    ASSERT_EQ(contour_error, without.put(none).contour_error);
  }
}

TEST(RealTimeLoop, ThereIsNoContourErrorWithoutAPathAModelOrACommand) {
  Loop none(2), one_model(2, 16'384, {{0, 1}}), both(2, 16'384, {{0, 1}});
  for (Loop* loop : {&none, &one_model, &both}) loop->models[0].publish(in_force(drive()));
  for (Loop* loop : {&none, &both}) loop->models[1].publish(in_force(drive()));
  for (std::uint64_t k = 0; k < 100; ++k) {
    ASSERT_TRUE(std::isnan(none.put(k).contour_error));
    ASSERT_TRUE(std::isnan(one_model.put(k).contour_error));
    ASSERT_TRUE(std::isfinite(both.put(k).contour_error));
  }
  MachineFrame broken = both.frame(100);
  broken.axes[1].command = kAbsent;
  EXPECT_TRUE(std::isnan(both.put(broken).contour_error));
  EXPECT_TRUE(std::isfinite(both.put(101).contour_error)) << "a path of one point";
}

// A constant force deflects the axis from its start position, which after lost cycles is not on the
// line from its earlier position.
TEST(RealTimeLoop, AfterLostCyclesThePathBeginsAgain) {
  Model held = linear_drive();
  Effect force = make_effect<ConstantForce>();
  force.coefficient[0] = 0.5;
  held.effects.push_back(force);
  Loop loop(2, 16'384, {{0, 1}});
  for (auto& model : loop.models) model.publish(in_force(held));
  for (std::uint64_t k = 0; k < 100; ++k) loop.put(k);
  MachineFrame elsewhere = loop.frame(200);
  elsewhere.axes[0].command += 1.0;
  const MachinePrediction prediction = loop.put(elsewhere);
  const double e = prediction.axes[0].predicted_error;
  ASSERT_GT(e, 1e-6);
  EXPECT_DOUBLE_EQ(prediction.contour_error, std::hypot(e, prediction.axes[1].predicted_error));
}

// Axes 0 and 2 draw one path and 1 and 3 another; the first pair has no model at first.
TEST(RealTimeLoop, OfSeveralPathsTheOneWhoseAxesAreFarthestFromItCounts) {
  Loop both(4, 16'384, {{0, 2}, {1, 3}}), first(4, 16'384, {{0, 2}}), second(4, 16'384, {{1, 3}});
  int first_counts = 0, second_counts = 0;
  for (std::uint64_t k = 0; k < 600; ++k) {
    for (Loop* loop : {&both, &first, &second}) {
      if (k == 0) loop->models[1].publish(in_force(drive(30.0)));
      if (k == 0) loop->models[3].publish(in_force(drive(15.0)));
      if (k == 200) loop->models[0].publish(in_force(drive(10.0)));
      if (k == 200) loop->models[2].publish(in_force(drive(20.0)));
    }
    const double of_both = both.put(k).contour_error, of_first = first.put(k).contour_error,
                 of_second = second.put(k).contour_error;
    if (k < 200 || k >= 250) {  // it takes some cycles to catch up
      ASSERT_EQ(std::isnan(of_first), k < 200) << k;
    }
    ASSERT_FALSE(std::isnan(of_second));
    const bool takes_first = std::abs(of_first) > std::abs(of_second);
    ASSERT_EQ(of_both, takes_first ? of_first : of_second) << k;
    (takes_first ? first_counts : second_counts) += k > 200;
  }
  EXPECT_GT(first_counts, 10);
  EXPECT_GT(second_counts, 10);
}

TEST(RealTimeLoop, APathHasTwoToFiveOfTheAxes) {
  for (const std::vector<std::size_t>& path :
       {std::vector<std::size_t>{0}, {0, 6}, {0, 1, 2, 3, 4, 5}})
    EXPECT_THROW(Loop(6, 16, {path}), std::invalid_argument);
  EXPECT_NO_THROW(Loop(6, 16, {{1, 2, 3, 4, 5}}));
}

TEST(RealTimeLoop, SaysWhenTheStartingStateIsForgotten) {
  const Model model = drive();
  Loop loop;
  loop.models[0].publish(in_force(model));
  const auto settling = static_cast<std::uint64_t>(settling_cycles(model));
  ASSERT_GT(settling, 10U);
  for (std::uint64_t k = 0; k < 2 * settling; ++k) {
    const AxisState expected = k < settling ? AxisState::kSettling : AxisState::kPredicting;
    ASSERT_EQ(loop.put(k).axes[0].state, expected) << k;
  }
}

// After settling_cycles the effect of a wrong initial state has decayed to 1 %.
TEST(RealTimeLoop, SettlingIsTheTimeToOnePercentOfTheSlowestMode) {
  Model model = drive();
  model.effects.clear();
  Twin right(model), wrong(model);
  right.start(0.0);
  const std::array<double, 2> state{1e-3, 0.0};
  wrong.start(0.0, state);
  double first = 0.0, difference = 0.0;
  const int settling = settling_cycles(model);
  double rest_of_it = 0.0;
  for (int k = 0; k < 2 * settling; ++k) {
    difference = std::abs(wrong.follow(0.0) - right.follow(0.0));
    if (k == 0) first = difference;
    if (k >= settling) rest_of_it = std::max(rest_of_it, difference);
  }
  EXPECT_LT(rest_of_it, 0.02 * first);
}

TEST(RealTimeLoop, ANewModelTakesOverAsIfItHadRunAllAlong) {
  constexpr std::uint64_t kSwap = 1500;  // within the history
  Loop loop;
  loop.models[0].publish(in_force(drive(15.0), 1));
  const std::vector<double> old = twin_alone(drive(15.0), 3000),
                            newer = twin_alone(drive(25.0), 3000);
  const auto settling = static_cast<std::uint64_t>(settling_cycles(drive(15.0)));
  ASSERT_LT(settling, kSwap);
  std::uint64_t taken_over = 0;
  for (std::uint64_t k = 0; k < 3000; ++k) {
    if (k == kSwap) loop.models[0].publish(in_force(drive(25.0), 2));
    const AxisPrediction axis = loop.put(k).axes[0];
    if (axis.model_version == 2 && taken_over == 0) taken_over = k;
    ASSERT_EQ(axis.predicted_error, axis.model_version == 1 ? old[k] : newer[k]) << k;
    if (k >= settling) {
      ASSERT_EQ(axis.state, AxisState::kPredicting) << "never unsettled again";
    }
  }
  EXPECT_GE(taken_over, kSwap);
  EXPECT_LE(taken_over, kSwap + kSwap / (AxisLoop::kCatchUpCycles - 1) + 1)
      << "a bounded number of cycles";
}

TEST(RealTimeLoop, ANewModelAfterALongRunAgreesOnceItHasSettled) {
  constexpr std::uint64_t kSwap = 10'000;  // long beyond the history
  Loop loop(1, 64);
  const std::vector<double> truth = twin_alone(drive(), 12'000);
  double worst = 0.0;
  for (std::uint64_t k = 0; k < 12'000; ++k) {
    if (k == kSwap) loop.models[0].publish(in_force(drive(), 1));
    const AxisPrediction axis = loop.put(k).axes[0];
    if (axis.state == AxisState::kPredicting)
      worst = std::max(worst, std::abs(axis.predicted_error - truth[k]));
  }
  EXPECT_LT(worst, 1e-12) << "2048 commands are enough for this drive to forget how it was started";
}

TEST(RealTimeLoop, ANewModelIsFedTheHistoryThatThereIsAndNothingElse) {
  constexpr std::uint64_t kSwap = 5000, kFirst = kSwap + 1 - AxisLoop::kHistory;
  const Model slow = drive(0.2);  // forgets nothing within the history
  Loop loop(1, 64);
  std::uint64_t k = 0;
  for (; k < kSwap; ++k) loop.put(k);
  loop.models[0].publish(in_force(slow));
  AxisPrediction axis = loop.put(k).axes[0];
  while (axis.model_version == 0) axis = loop.put(++k).axes[0];
  Twin twin(slow);
  double truth = 0.0;
  for (std::uint64_t fed = kFirst; fed <= k; ++fed) {
    const double command = command_at(static_cast<double>(fed) * kCycle_s);
    if (fed == kFirst) twin.start(command);
    truth = fed == kFirst ? command - twin.position() : twin.follow(command);
  }
  EXPECT_EQ(axis.predicted_error, truth);
  EXPECT_EQ(axis.state, AxisState::kSettling);
}

TEST(RealTimeLoop, AGapWhileANewModelCatchesUpStartsItThere) {
  Loop loop;
  loop.models[0].publish(in_force(drive(15.0), 1));
  std::uint64_t k = 0;
  for (; k < 1500; ++k) loop.put(k);
  loop.models[0].publish(in_force(drive(25.0), 2));
  for (; k < 1503; ++k)
    ASSERT_EQ(loop.put(k).axes[0].model_version, 1) << "it has not caught up yet";
  Twin twin(drive(25.0));
  for (k = 1600; k < 1700; ++k) {
    const double command = command_at(static_cast<double>(k) * kCycle_s);
    if (k == 1600) twin.start(command);
    const double truth = k == 1600 ? command - twin.position() : twin.follow(command);
    const AxisPrediction axis = loop.put(k).axes[0];
    ASSERT_EQ(axis.model_version, 2);
    ASSERT_EQ(axis.predicted_error, truth) << k;
  }
}

TEST(RealTimeLoop, LostCyclesAreCountedAndTheTwinStartsAgain) {
  Loop loop;
  loop.models[0].publish(in_force(drive()));
  for (std::uint64_t k = 0; k < 1000; ++k) loop.put(k);
  const MachinePrediction after = loop.put(1005);
  EXPECT_EQ(loop.loop.counters().lost, 5U);
  EXPECT_EQ(after.axes[0].state, AxisState::kSettling);
  Twin rest(drive());
  rest.start(loop.frame(1005).axes[0].command);
  EXPECT_EQ(after.axes[0].predicted_error, loop.frame(1005).axes[0].command - rest.position());
  EXPECT_EQ(loop.put(1006).axes[0].predicted_error, rest.follow(loop.frame(1006).axes[0].command));
  EXPECT_FALSE(loop.newest_row().after_gap);
}

TEST(RealTimeLoop, RowsSayWhereTheCycleBeforeIsMissing) {
  Loop loop(1, 4);
  CycleRow row;
  loop.put(0);
  loop.put(1);
  loop.put(3);
  std::vector<bool> after_gap;
  while (loop.rows.pop(row)) after_gap.push_back(row.after_gap);
  EXPECT_EQ(after_gap, (std::vector<bool>{true, false, true}));

  // The same if the recorder is too slow: rows 8 and 9 find no room.
  for (std::uint64_t k = 4; k < 10; ++k) loop.put(k);
  EXPECT_EQ(loop.rows.drops(), 2U);
  after_gap.clear();
  while (loop.rows.pop(row)) after_gap.push_back(row.after_gap);
  loop.put(10);
  loop.put(11);
  while (loop.rows.pop(row)) after_gap.push_back(row.after_gap);
  EXPECT_EQ(after_gap, (std::vector<bool>{false, false, false, false, true, false}));
}

TEST(RealTimeLoop, ARepeatedFrameIsIgnored) {
  Loop loop;
  loop.models[0].publish(in_force(drive()));
  const std::vector<double> truth = twin_alone(drive(), 100);
  for (std::uint64_t k = 0; k < 100; ++k) {
    ASSERT_EQ(loop.put(k).axes[0].predicted_error, truth[k]);
    loop.loop.on_frame(loop.frame(k), {});
    MachinePrediction none;
    ASSERT_FALSE(loop.predictions.pop(none));
  }
  EXPECT_EQ(loop.loop.counters().repeated, 100U);
}

TEST(RealTimeLoop, AJumpOfTimeWithoutALossIsCountedAndStartsAgain) {
  Loop loop;
  loop.models[0].publish(in_force(drive()));
  std::uint64_t k = 0;
  for (; k < 500; ++k) loop.put(k);
  for (const std::int64_t jump_ns :
       {std::int64_t{7'720'000'000}, std::int64_t{-5'000'000}, INT64_MAX, INT64_MIN}) {
    const std::uint64_t before = loop.loop.counters().time_jumps;
    MachineFrame frame = loop.frame(k++);
    frame.time_ns = static_cast<std::int64_t>(static_cast<std::uint64_t>(frame.time_ns) +
                                              static_cast<std::uint64_t>(jump_ns));
    EXPECT_EQ(loop.put(frame).axes[0].state, AxisState::kSettling) << jump_ns;
    EXPECT_GT(loop.loop.counters().time_jumps, before) << jump_ns;
    for (int i = 0; i < 300; ++i) loop.put(k++);
  }
  EXPECT_EQ(loop.loop.counters().lost, 0U);
}

TEST(RealTimeLoop, StampsThatScatterAreNoJump) {
  Loop loop;
  for (std::uint64_t k = 0; k < 1000; ++k) {
    MachineFrame frame = loop.frame(k);
    frame.time_ns += (k % 3 == 0) ? 600'000 : -200'000;
    loop.put(frame);
  }
  EXPECT_EQ(loop.loop.counters().time_jumps, 0U);
}

TEST(RealTimeLoop, ASourceThatStartsAgainIsFollowed) {
  Loop loop;
  loop.models[0].publish(in_force(drive()));
  const std::vector<double> truth = twin_alone(drive(), 300);
  for (std::uint64_t k = 0; k < 1000; ++k) loop.put(k);
  for (std::uint64_t k = 0; k < 300; ++k) ASSERT_EQ(loop.put(k).axes[0].predicted_error, truth[k]);
  EXPECT_EQ(loop.loop.counters().time_jumps, 1U);
  EXPECT_EQ(loop.loop.counters().lost, 0U);

  // The same if only the sequence numbers start again and the clock continues.
  MachineFrame frame = loop.frame(0);
  frame.time_ns = loop.frame(300).time_ns;
  EXPECT_EQ(loop.put(frame).axes[0].state, AxisState::kSettling);
  EXPECT_EQ(loop.loop.counters().time_jumps, 2U);
}

TEST(RealTimeLoop, ACommandThatIsNotANumberFlagsItsAxisAloneAndTheTwinStartsAgain) {
  Loop loop(2);
  for (auto& model : loop.models) model.publish(in_force(drive()));
  for (std::uint64_t k = 0; k < 500; ++k) loop.put(k);
  MachineFrame bad = loop.frame(500);
  bad.axes[0].command = kAbsent;
  MachinePrediction prediction = loop.put(bad);
  EXPECT_EQ(prediction.axes[0].state, AxisState::kBadSample);
  EXPECT_TRUE(std::isnan(prediction.axes[0].predicted_error));
  EXPECT_EQ(prediction.axes[1].state, AxisState::kPredicting);
  EXPECT_EQ(loop.loop.counters().not_finite, 1U);
  prediction = loop.put(501);
  EXPECT_EQ(prediction.axes[0].state, AxisState::kSettling);
  EXPECT_EQ(prediction.axes[1].state, AxisState::kPredicting);
  EXPECT_TRUE(std::isfinite(prediction.axes[0].predicted_error));
}

TEST(RealTimeLoop, NoFiniteCommandSpoilsTheTwinForGood) {
  Loop loop;
  loop.models[0].publish(in_force(drive()));
  std::uint64_t k = 0;
  for (; k < 500; ++k) loop.put(k);
  for (const double absurd : {1e308, -1e308, 1e200}) {
    MachineFrame frame = loop.frame(k++);
    frame.axes[0].command = absurd;
    loop.put(frame);
    for (int i = 0; i < 5000; ++i) loop.put(k++);
    loop.put(++k);  // a lost cycle starts it again in any case
    for (int i = 0; i < 500; ++i) loop.put(++k);
    const AxisPrediction after = loop.put(++k).axes[0];
    EXPECT_EQ(after.state, AxisState::kPredicting);
    EXPECT_LT(std::abs(after.predicted_error), 0.1);
    ++k;
  }
}

TEST(RealTimeLoop, AFrameOfAnotherMachineIsRefused) {
  Loop loop;
  MachineFrame frame = loop.frame(0);
  for (const int axes : {0, 2, -1, 1000}) {
    frame.axis_count = axes;
    loop.loop.on_frame(frame, {});
  }
  EXPECT_EQ(loop.loop.counters().malformed, 4U);
  MachinePrediction none;
  EXPECT_FALSE(loop.predictions.pop(none));
}

TEST(RealTimeLoop, PredictionsThatNobodyTakesAreCounted) {
  Loop loop;
  for (std::uint64_t k = 0; k < 20; ++k) loop.loop.on_frame(loop.frame(k), {});
  EXPECT_EQ(loop.predictions.drops(), 4U);
}

/// Gives frames without waiting.
class Frames final : public FrameSource {
 public:
  Frames(const Loop& loop, std::uint64_t count) : loop_(loop), count_(count) {}
  Received receive(MachineFrame& frame, double) noexcept override {
    if (next_ == count_) return Received::kEnd;
    frame = loop_.frame(next_++);
    return Received::kFrame;
  }
  [[nodiscard]] std::int64_t age_ns() const noexcept override { return 5'000; }

 private:
  const Loop& loop_;
  std::uint64_t next_ = 0, count_;
};

TEST(RealTimeLoop, RunsUntilTheSourceEndsAndMeasuresItself) {
  Loop loop;
  Frames frames(loop, 1000);
  const std::atomic<bool> stop{false};
  const std::int64_t before = steady_ns();
  loop.loop.run(frames, stop);
  const std::int64_t after = steady_ns();
  const LoopCounters& counters = loop.loop.counters();
  EXPECT_EQ(counters.frames, 1000U);
  // Every prediction knows when its frame was due.
  MachinePrediction prediction;
  ASSERT_TRUE(loop.predictions.pop(prediction));
  EXPECT_GE(prediction.due_ns, before - 5'000);
  EXPECT_LE(prediction.due_ns, after - 5'000);
  EXPECT_NEAR(counters.wake.quantile_s(0.5), 5e-6, 0.7e-6);
  EXPECT_GT(counters.work.quantile_s(0.5), 0.0);
  EXPECT_GE(counters.work.max_s(), 0.9 * counters.work.quantile_s(0.5));
}

TEST(RealTimeLoop, WorkLongerThanTheCycleIsAnOverrun) {
  std::vector<LatestValue<TwinInForce>> models(1);
  Ring<MachinePrediction> predictions(16);
  Ring<CycleRow> rows(16);
  const WakeUp wake_up;
  RealTimeLoop impatient(1e-9, models, predictions, rows, wake_up);
  const Loop any;
  Frames frames(any, 100);
  const std::atomic<bool> stop{false};
  impatient.run(frames, stop);
  EXPECT_EQ(impatient.counters().overruns, 100U);
}

TEST(RealTimeLoop, ANullSourceEndsAtOnce) {
  Loop loop;
  NullSource nothing;
  const std::atomic<bool> stop{false};
  loop.loop.run(nothing, stop);
  EXPECT_EQ(loop.loop.counters().frames, 0U);
}

TEST(RealTimeLoop, NeedsOneToThirtyTwoAxes) {
  Ring<MachinePrediction> predictions(16);
  Ring<CycleRow> rows(16);
  const WakeUp wake_up;
  std::vector<LatestValue<TwinInForce>> none, many(33);
  EXPECT_THROW(RealTimeLoop(kCycle_s, none, predictions, rows, wake_up), std::invalid_argument);
  EXPECT_THROW(RealTimeLoop(kCycle_s, many, predictions, rows, wake_up), std::invalid_argument);
}

}  // namespace
}  // namespace servotwin::daemon
