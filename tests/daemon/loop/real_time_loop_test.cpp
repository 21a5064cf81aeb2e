#include "daemon/loop/real_time_loop.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <complex>
#include <utility>
#include <vector>

#include "daemon/between/clock.h"
#include "tests/daemon/loop/loop_with_rings.h"

namespace servotwin::daemon {
namespace {

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
  LoopWithRings loop;
  loop.models[0].publish(twin_in_force(drive(), 7));
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
  LoopWithRings loop(2);
  loop.models[1].publish(twin_in_force(drive()));
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
  LoopWithRings with, without, wrong;
  for (LoopWithRings* loop : {&with, &without, &wrong})
    loop->models[0].publish(twin_in_force(drive()));
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
  LoopWithRings loop;
  loop.models[0].publish(twin_in_force(drive()));
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
    LoopWithRings loop(3, 16'384, {{2, 0}});  // 2 is cosine, 0 is sine: counter-clockwise
    for (const std::size_t axis : {0U, 2U})
      loop.models[axis].publish(twin_in_force(linear_drive()));
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
  LoopWithRings loop(2, 16'384, {{1, 0}});  // without models: nothing is predicted
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
  LoopWithRings with(2, 16'384, {{0, 1}}), without(2, 16'384, {{0, 1}});
  for (LoopWithRings* loop : {&with, &without}) {
    for (auto& model : loop->models) model.publish(twin_in_force(drive()));
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
  LoopWithRings none(2), one_model(2, 16'384, {{0, 1}}), both(2, 16'384, {{0, 1}});
  for (LoopWithRings* loop : {&none, &one_model, &both})
    loop->models[0].publish(twin_in_force(drive()));
  for (LoopWithRings* loop : {&none, &both}) loop->models[1].publish(twin_in_force(drive()));
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
  LoopWithRings loop(2, 16'384, {{0, 1}});
  for (auto& model : loop.models) model.publish(twin_in_force(held));
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
  LoopWithRings both(4, 16'384, {{0, 2}, {1, 3}}), first(4, 16'384, {{0, 2}}),
      second(4, 16'384, {{1, 3}});
  int first_counts = 0, second_counts = 0;
  for (std::uint64_t k = 0; k < 600; ++k) {
    for (LoopWithRings* loop : {&both, &first, &second}) {
      if (k == 0) loop->models[1].publish(twin_in_force(drive(30.0)));
      if (k == 0) loop->models[3].publish(twin_in_force(drive(15.0)));
      if (k == 200) loop->models[0].publish(twin_in_force(drive(10.0)));
      if (k == 200) loop->models[2].publish(twin_in_force(drive(20.0)));
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
    EXPECT_THROW(LoopWithRings(6, 16, {path}), std::invalid_argument);
  EXPECT_NO_THROW(LoopWithRings(6, 16, {{1, 2, 3, 4, 5}}));
}

TEST(RealTimeLoop, SaysWhenTheStartingStateIsForgotten) {
  const Model model = drive();
  LoopWithRings loop;
  loop.models[0].publish(twin_in_force(model));
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
  LoopWithRings loop;
  loop.models[0].publish(twin_in_force(drive(15.0), 1));
  const std::vector<double> old = twin_alone(drive(15.0), 3000),
                            newer = twin_alone(drive(25.0), 3000);
  const auto settling = static_cast<std::uint64_t>(settling_cycles(drive(15.0)));
  ASSERT_LT(settling, kSwap);
  std::uint64_t taken_over = 0;
  for (std::uint64_t k = 0; k < 3000; ++k) {
    if (k == kSwap) loop.models[0].publish(twin_in_force(drive(25.0), 2));
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
  LoopWithRings loop(1, 64);
  const std::vector<double> truth = twin_alone(drive(), 12'000);
  double worst = 0.0;
  for (std::uint64_t k = 0; k < 12'000; ++k) {
    if (k == kSwap) loop.models[0].publish(twin_in_force(drive(), 1));
    const AxisPrediction axis = loop.put(k).axes[0];
    if (axis.state == AxisState::kPredicting)
      worst = std::max(worst, std::abs(axis.predicted_error - truth[k]));
  }
  EXPECT_LT(worst, 1e-12) << "2048 commands are enough for this drive to forget how it was started";
}

TEST(RealTimeLoop, ANewModelIsFedTheHistoryThatThereIsAndNothingElse) {
  constexpr std::uint64_t kSwap = 5000, kFirst = kSwap + 1 - AxisLoop::kHistory;
  const Model slow = drive(0.2);  // forgets nothing within the history
  LoopWithRings loop(1, 64);
  std::uint64_t k = 0;
  for (; k < kSwap; ++k) loop.put(k);
  loop.models[0].publish(twin_in_force(slow));
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
  LoopWithRings loop;
  loop.models[0].publish(twin_in_force(drive(15.0), 1));
  std::uint64_t k = 0;
  for (; k < 1500; ++k) loop.put(k);
  loop.models[0].publish(twin_in_force(drive(25.0), 2));
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
  LoopWithRings loop;
  loop.models[0].publish(twin_in_force(drive()));
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
  LoopWithRings loop(1, 4);
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
  LoopWithRings loop;
  loop.models[0].publish(twin_in_force(drive()));
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
  LoopWithRings loop;
  loop.models[0].publish(twin_in_force(drive()));
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
  LoopWithRings loop;
  for (std::uint64_t k = 0; k < 1000; ++k) {
    MachineFrame frame = loop.frame(k);
    frame.time_ns += (k % 3 == 0) ? 600'000 : -200'000;
    loop.put(frame);
  }
  EXPECT_EQ(loop.loop.counters().time_jumps, 0U);
}

TEST(RealTimeLoop, ASourceThatStartsAgainIsFollowed) {
  LoopWithRings loop;
  loop.models[0].publish(twin_in_force(drive()));
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
  LoopWithRings loop(2);
  for (auto& model : loop.models) model.publish(twin_in_force(drive()));
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
  LoopWithRings loop;
  loop.models[0].publish(twin_in_force(drive()));
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
  LoopWithRings loop;
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
  LoopWithRings loop;
  for (std::uint64_t k = 0; k < 20; ++k) loop.loop.on_frame(loop.frame(k), {});
  EXPECT_EQ(loop.predictions.drops(), 4U);
}

/// Gives frames without waiting.
class Frames final : public FrameSource {
 public:
  Frames(const LoopWithRings& loop, std::uint64_t count) : loop_(loop), count_(count) {}
  Received receive(MachineFrame& frame, double) noexcept override {
    if (next_ == count_) return Received::kEnd;
    frame = loop_.frame(next_++);
    return Received::kFrame;
  }
  [[nodiscard]] std::int64_t age_ns() const noexcept override { return 5'000; }

 private:
  const LoopWithRings& loop_;
  std::uint64_t next_ = 0, count_;
};

TEST(RealTimeLoop, RunsUntilTheSourceEndsAndMeasuresItself) {
  LoopWithRings loop;
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
  const LoopWithRings any;
  Frames frames(any, 100);
  const std::atomic<bool> stop{false};
  impatient.run(frames, stop);
  EXPECT_EQ(impatient.counters().overruns, 100U);
}

TEST(RealTimeLoop, ANullSourceEndsAtOnce) {
  LoopWithRings loop;
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
