// Of several axes the one that acts on another one is found, on a machine that shares no code with
// the twin.
#include "diagnosis/search/acting_axis.h"

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
  EXPECT_EQ(acting_axis(machine, "X"), "Y") << "whose spring hides it until it is in the model";
  EXPECT_EQ(acting_axis(machine, "Y"), "X");
  EXPECT_EQ(segment_axis(machine, "X").neighbour, "A") << "what would be taken without asking";
}

TEST(ActingAxis, NeedsNoChoiceBetweenTwoAxes) {
  Recording machine = four_axes(4.0);
  machine.axes.erase(machine.axes.begin() + 1, machine.axes.begin() + 3);
  EXPECT_EQ(acting_axis(machine, "X"), "");
}

TEST(ActingAxis, IsNoneWhereNobodyPushes) { EXPECT_EQ(acting_axis(four_axes(0.0), "Y"), ""); }

TEST(ActingAxis, ComparesTheSameMotionOnly) {
  const Recording machine = four_axes(4.0);
  const SegmentedAxis axis = segment_axis(machine, "Y", {}, "X");
  const Model model = identify(axis, {}).record.model;
  std::vector<Segment> alone = axis.segments;
  alone[0].neighbour.resize(0);
  EXPECT_EQ(share_of_neighbour(model, axis.segments, alone), 0.0);
  EXPECT_EQ(share_of_neighbour(model, axis.segments, {}), 0.0);
  EXPECT_GT(share_of_neighbour(model, alone, axis.segments), 0.1)
      << "the model has no coupling, so its own neighbour does not matter";
}

}  // namespace
}  // namespace servotwin
