// Held-out data that begin where only the motion before them tells what friction holds.
#include <gtest/gtest.h>

#include <Eigen/Core>

#include "identification/loop/identify.h"
#include "identification/recording/segments.h"
#include "tests/identification/loop/held_by_friction.h"

namespace servotwin {
namespace {

TEST(HeldOut, ThatBeginInARestAreJudgedWithTheMotionBefore) {
  const HeldAxis held = axis_held_by_friction();
  IdentifyOptions options;
  options.method = Method::kJoint;
  options.training_share = held.in_rest_s / held.segment().end_s();
  const auto [training, holdout] = split(held.axis.segments, *options.training_share);
  const Segment& rest = holdout.front();
  ASSERT_EQ(rest.command.head(200).maxCoeff(), rest.command.head(200).minCoeff()) << "a rest";
  ASSERT_GT(std::abs(rest.command(0) - rest.actual(0)), 5e-6) << "away from the command";
  const ModelRecord record = identify(held.axis, options).record;
  EXPECT_EQ(record.model.loop.order, 2) << "no integrator, though Coulomb friction alone wants one";
  EXPECT_LT(record.holdout.rms, 2.0 * record.training.rms);
  EXPECT_LT(record.holdout.max, 5e-6);
  EXPECT_GT(judge(record.model, holdout).rms, 5.0 * record.training.rms) << "without lead-in";
}

}  // namespace
}  // namespace servotwin
