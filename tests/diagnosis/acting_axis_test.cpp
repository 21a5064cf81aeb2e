// Of several axes the one that acts on another one is found, on a machine that shares no code with
// the twin.
#include "diagnosis/search/acting_axis.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "identification/loop/identify.h"
#include "identification/recording/segments.h"
#include "tests/support/coupled_machine.h"

namespace servotwin {
namespace {

/// X and Y that push each other, and between them A and B, which move as much and touch nobody.
Recording four_axes(double common_mass) {
  test::CoupledMachine machine = test::coupled_machine(0.0);
  machine.common_mass = common_mass;
  const auto coupled = test::recorded(machine, test::production_of_both());
  const Segment& x = coupled[0].segments[0];
  const Eigen::Index n = std::lround(12.0 / x.sample_time_s);
  Recording out;
  out.source = "coupled";
  for (Eigen::Index k = 0; k < n; ++k) out.time.push_back(x.sample_time_s * static_cast<double>(k));
  const auto add = [&](const std::string& name, const Eigen::ArrayXd& command,
                       const Eigen::ArrayXd& actual) {
    out.axes.push_back(
        {name, false, {command.begin(), command.end()}, {actual.begin(), actual.end()}, {}, {}});
  };
  add("X", x.command.head(n), x.actual.head(n));
  std::uint64_t seed = 20;
  for (const char* name : {"A", "B"}) {
    hidden_effects::Motion motion;
    motion.limits = {0.25, 5.0, 200.0};
    hidden_effects::Random random(seed++);
    const auto trace =
        hidden_effects::simulate(machine.axes[1], hidden_effects::motion_of(motion, random));
    Eigen::ArrayXd command(n), actual(n);
    for (Eigen::Index k = 0; k < n; ++k) {
      const auto at = std::min(static_cast<std::size_t>(k), trace.command.size() - 1);
      command(k) = trace.command[at];
      actual(k) = trace.actual[at];
    }
    add(name, command, actual);
  }
  const Segment& y = coupled[1].segments[0];
  add("Y", y.command.head(n), y.actual.head(n));
  return out;
}

TEST(ActingAxis, IsTheOneThatPushesAndNotTheFirstOtherOne) {
  const Recording machine = four_axes(4.0);
  const ActingAxis of_x = acting_axis(machine, "X"), of_y = acting_axis(machine, "Y");
  EXPECT_EQ(of_x.name, "Y") << "whose spring hides it until it is in the model";
  EXPECT_EQ(of_y.name, "X");
  EXPECT_GT(of_x.share, 0.5);
  EXPECT_GT(of_y.share, 0.5);
  EXPECT_EQ(segment_axis(machine, "X").neighbour, "A") << "what would be taken without asking";
}

TEST(ActingAxis, NeedsNoChoiceBetweenTwoAxes) {
  Recording machine = four_axes(4.0);
  machine.axes.erase(machine.axes.begin() + 1, machine.axes.begin() + 3);
  const ActingAxis none = acting_axis(machine, "X");
  EXPECT_FALSE(none.sought);
  EXPECT_EQ(none.name, "");
}

TEST(ActingAxis, IsNotLookedForInCommandsOfOtherTimes) {
  Recording machine = four_axes(4.0);
  std::fill_n(machine.axes[3].command.begin() + 5000, 1000, kAbsent);
  machine.axes[0].actual = machine.axes[0].command;  // no model: nothing more is looked for
  const ActingAxis none = acting_axis(machine, "X");
  EXPECT_TRUE(none.sought);
  EXPECT_THAT(none.apart, testing::ElementsAre("Y"));
  EXPECT_EQ(none.name, "");
}

TEST(ActingAxis, IsNoneWhereNobodyPushes) {
  const Recording machine = four_axes(0.0);
  const ActingAxis none = acting_axis(machine, "Y");
  EXPECT_TRUE(none.sought);
  EXPECT_EQ(none.name, "");
  IdentifyOptions options;
  options.method = Method::kJoint;
  options.friction = kind_of<Presliding>();
  const SegmentedAxis axis = segment_axis(machine, "Y", {}, "X");
  EXPECT_LT(share_of_neighbour(identify(axis, options).record.model, axis.segments), 0.01)
      << "it was looked at, and explains nothing";
}

// What a model contains already must not make another axis look better.
TEST(ActingAxis, IsSoughtBesideAModelWithoutItsCoupling) {
  const SegmentedAxis axis = segment_axis(four_axes(4.0), "Y", {}, "X");
  Model model = identify(axis, {}).record.model;
  const double share = share_of_neighbour(model, axis.segments);
  EXPECT_GT(share, 0.1);
  model.effects.push_back(make_effect<CrossCoupling>());
  model.effects.back().coefficient[0] = -0.13;
  EXPECT_EQ(share_of_neighbour(model, axis.segments), share);
  std::vector<Segment> alone = axis.segments;
  alone[0].neighbour.resize(0);
  EXPECT_EQ(share_of_neighbour(model, alone), 0.0);
  EXPECT_EQ(share_of_neighbour(model, {}), 0.0);
}

}  // namespace
}  // namespace servotwin
