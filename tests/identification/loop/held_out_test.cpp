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

constexpr double kRestBegins_s = 5.4, kRest_s = 1.2, kEnds_s = 10.0;

struct Recorded {
  Segment segment;
  double rest_begins_s = 0.0;
};

/// Moves, a rest, and moves again.
Recorded recorded(const Rig& rig) {
  constexpr virtual_machine::Limits kBrisk{.velocity = 0.2, .acceleration = 4.0, .jerk = 150.0};
  virtual_machine::Trajectory path(0.0);
  path.dwell(0.2);
  int moves = 0;
  const auto move_until = [&](double end_s) {
    for (; path.duration() < end_s; ++moves) {
      path.dwell(0.05 + 0.03 * (moves % 4));
      path.move_to((moves % 2 == 0 ? 0.02 : -0.015) * (1 + moves % 3), kBrisk);
    }
  };
  Recorded out;
  move_until(kRestBegins_s);
  out.rest_begins_s = path.duration();
  path.dwell(kRest_s);
  move_until(kEnds_s);
  const auto trace = hidden_effects::simulate(rig, path);
  const auto rows = static_cast<Eigen::Index>(trace.command.size());
  out.segment.sample_time_s = rig.reading.sample_time;
  out.segment.command = Eigen::Map<const Eigen::ArrayXd>(trace.command.data(), rows);
  out.segment.actual = Eigen::Map<const Eigen::ArrayXd>(trace.actual.data(), rows);
  return out;
}

TEST(HeldOut, ThatBeginInARestAreJudgedWithTheMotionBefore) {
  SegmentedAxis axis;
  axis.axis = "X";
  const Recorded all = recorded(held_by_friction());
  axis.segments = {all.segment};
  axis.sample_time_s = all.segment.sample_time_s;
  IdentifyOptions options;
  options.method = Method::kJoint;
  options.order = 2;  // Coulomb friction alone chooses another one here
  options.training_share = (all.rest_begins_s + 0.3 * kRest_s) / all.segment.end_s();
  const auto [training, holdout] = split(axis.segments, *options.training_share);
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
