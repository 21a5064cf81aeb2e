// Axes that act on others in the real-time loop: by their commands, and by the motion that their
// own twins predict.
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <vector>

#include "tests/daemon/loop/loop_with_rings.h"
#include "twin/neighbour.h"

namespace servotwin::daemon {
namespace {

/// X feels the acceleration of Y, which moves twice as far.
Model coupled_drive() {
  Model model = drive();
  Effect coupling = make_effect<CrossCoupling>();
  coupling.coefficient[0] = -0.1;
  model.effects.push_back(coupling);
  return model;
}
TwinInForce coupled(int version = 1) {
  TwinInForce out = twin_in_force(coupled_drive(), version);
  out.neighbour = 1;
  return out;
}

TEST(ActingAxes, AnotherAxisActsOnAnAxisAsInTheSimulation) {
  constexpr std::uint64_t kCycles = 3000, kSwap = 1500;
  LoopWithRings loop(2), later(2);
  loop.models[0].publish(coupled());
  later.models[0].publish(twin_in_force(drive()));
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

TEST(ActingAxes, WhatIsPredictedAheadBesideAnotherAxisComesTrue) {
  constexpr int kAhead = 8;
  LoopWithRings loop(2);
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
  TwinInForce out = twin_in_force(pushed(ratio, vibrates));
  out.neighbour = neighbour;
  out.by_motion = true;
  return out;
}

// The truth is the simulation of the whole motion (tests/twin/neighbour_test.cpp).
TEST(ActingAxes, AxesThatPushEachOtherArePredictedTogether) {
  constexpr std::uint64_t kCycles = 3000;
  constexpr Eigen::Index kSettled = 500;
  for (const bool mutual : {false, true}) {
    const std::array<double, 2> ratio{-0.13, mutual ? -0.04 : 0.0};
    LoopWithRings loop(2);
    std::array<Segment, 2> axis;
    std::array<Eigen::ArrayXd, 2> predicted;
    for (std::size_t i = 0; i < 2; ++i) {
      loop.models[i].publish(i == 0 || mutual ? pushed_by(i == 0 ? 1 : 0, ratio[i], i == 0)
                                              : twin_in_force(drive()));
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

TEST(ActingAxes, WhatIsPredictedAheadOfAxesThatPushEachOtherComesTrue) {
  constexpr int kAhead = 8;
  LoopWithRings loop(3);  // the third is pushed by the first, whose turn comes before
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
TEST(ActingAxes, AFaultOfOneAxisDoesNotReachTheOtherByItsMotion) {
  constexpr std::uint64_t kFault = 1000, kEnd = 2000;
  for (const double wrong : {static_cast<double>(NAN), 5.0, 40.0}) {
    for (const std::size_t faulty : {0U, 1U}) {
      const std::size_t healthy = 1 - faulty;
      const auto of_healthy = [&](bool fault) {
        LoopWithRings loop(2);
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
TEST(ActingAxes, ATakeoverAmongAxesThatPushEachOtherIsSmooth) {
  LoopWithRings loop(2), same(2);
  for (LoopWithRings* one : {&loop, &same}) {
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
TEST(ActingAxes, TheCommandStandsInForAMotionThatNobodyPredicts) {
  LoopWithRings blind(2), by_command(2);
  blind.models[0].publish(pushed_by(1, -0.13));
  TwinInForce same = pushed_by(1, -0.13);
  same.by_motion = false;
  by_command.models[0].publish(same);
  for (std::uint64_t k = 0; k < 300; ++k)
    ASSERT_EQ(blind.put(k).axes[0].predicted_error, by_command.put(k).axes[0].predicted_error);
  blind.models[1].publish(twin_in_force(drive()));
  double apart = 0.0;
  for (std::uint64_t k = 300; k < 900; ++k)
    apart = std::max(apart, std::abs(blind.put(k).axes[0].predicted_error -
                                     by_command.put(k).axes[0].predicted_error));
  EXPECT_GT(apart, 1e-7);
}

TEST(ActingAxes, ANeighbourWithoutACommandActsOnNobody) {
  LoopWithRings loop(2), alone(1);
  loop.models[0].publish(coupled());
  alone.models[0].publish(twin_in_force(coupled_drive()));
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

}  // namespace
}  // namespace servotwin::daemon
