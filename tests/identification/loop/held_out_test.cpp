// Held-out data that begin where only the motion before them tells what friction holds.
#include <gtest/gtest.h>

#include <Eigen/Core>

#include "identification/loop/identify.h"
#include "identification/recording/segments.h"
#include "tests/hidden_effects/rig.h"
#include "twin/twin.h"

namespace servotwin {
namespace {

using hidden_effects::Friction;
using hidden_effects::Rig;

/// An axis without integral action, which friction of 60 N holds up to 15 um from its command.
Rig held_by_friction() {
  Rig rig;
  rig.body.mass = 200.0;
  rig.drive.position_gain = 80.0;
  rig.drive.velocity_gain = 200.0 * 250.0;
  rig.friction.family = Friction::Family::kMaxwell;
  rig.friction.level = 60.0;
  rig.friction.presliding_distance = 1.5e-5;
  rig.friction.viscous = 200.0;
  rig.reading.noise = 3e-8;
  return rig;
}

/// Ten seconds of moves; from 5.4 s to 6.6 s, about 0.6 of the time, the command rests.
Segment recorded(const Rig& rig) {
  constexpr virtual_machine::Limits kBrisk{.velocity = 0.2, .acceleration = 4.0, .jerk = 150.0};
  constexpr double kRestBegins_s = 5.4, kRest_s = 1.2, kEnds_s = 10.0;
  virtual_machine::Trajectory path(0.0);
  path.dwell(0.2);
  for (int i = 0; path.duration() < kEnds_s; ++i) {
    path.move_to((i % 2 == 0 ? 0.02 : -0.015) * (1 + i % 3), kBrisk);
    const bool rests =
        path.duration() > kRestBegins_s - 0.4 && path.duration() < kRestBegins_s + 0.4;
    path.dwell(rests ? kRest_s : 0.05 + 0.03 * (i % 4));
  }
  const auto trace = hidden_effects::simulate(rig, path);
  const auto rows = static_cast<Eigen::Index>(trace.command.size());
  Segment out;
  out.sample_time_s = rig.reading.sample_time;
  out.command = Eigen::Map<const Eigen::ArrayXd>(trace.command.data(), rows);
  out.actual = Eigen::Map<const Eigen::ArrayXd>(trace.actual.data(), rows);
  return out;
}

TEST(HeldOut, ThatBeginInARestAreJudgedWithTheMotionBefore) {
  SegmentedAxis axis;
  axis.axis = "X";
  axis.segments = {recorded(held_by_friction())};
  axis.sample_time_s = axis.segments.front().sample_time_s;
  IdentifyOptions options;
  options.method = Method::kJoint;
  const auto [training, holdout] = split(axis.segments, training_share_of(axis.segments));
  const Segment& rest = holdout.front();
  ASSERT_EQ(rest.command.head(200).maxCoeff(), rest.command.head(200).minCoeff()) << "a rest";
  ASSERT_GT(std::abs(rest.command(0) - rest.actual(0)), 5e-6) << "away from the command";
  const ModelRecord record = identify(axis, options).record;
  EXPECT_LT(record.holdout.rms, 2.0 * record.training.rms);
  EXPECT_LT(record.holdout.max, 5e-6);
  EXPECT_GT(judge(record.model, holdout).rms, 5.0 * record.training.rms) << "without lead-in";
}

}  // namespace
}  // namespace servotwin
