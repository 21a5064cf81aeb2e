// A cause that is not observable in a recording is listed with its reason; an observable one is
// not listed.
#include "diagnosis/search/observability.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>

namespace servotwin {
namespace {

constexpr double kSeenStep_s = 1e-3;

/// Strokes in both directions with rests, or in one direction only, for `duration_s`.
SegmentedAxis axis(double duration_s, bool one_way) {
  const auto n = static_cast<Eigen::Index>(duration_s / kSeenStep_s);
  Segment s;
  s.sample_time_s = kSeenStep_s;
  s.command.resize(n);
  for (Eigen::Index k = 0; k < n; ++k) {
    const double t = kSeenStep_s * static_cast<double>(k), u = t - std::floor(t);
    const double move = 0.05 * (1.0 - std::cos(std::numbers::pi * std::min(1.0, u / 0.8)));
    const bool back = static_cast<int>(t) % 2 == 1 && !one_way;
    s.command(k) = one_way ? 0.1 * std::floor(t) + move : (back ? 0.1 - move : move);
  }
  s.actual = s.command;
  SegmentedAxis out;
  out.axis = "X";
  out.sample_time_s = kSeenStep_s;
  out.segments = {s};
  return out;
}

bool says(const std::vector<NotObservable>& all, const std::string& id) {
  return std::any_of(all.begin(), all.end(), [&](const auto& one) { return one.id == id; });
}

TEST(NotObservable, WithoutItsSensor) {
  SegmentedAxis plain = axis(20.0, false);
  const auto all = not_observable(plain, {});
  EXPECT_TRUE(says(all, "cross_coupling"));
  EXPECT_TRUE(says(all, "cutting_force"));
  EXPECT_TRUE(says(all, "feedforward_mismatch"));
  EXPECT_EQ(all.size(), 3U);
  for (const NotObservable& one : all) EXPECT_FALSE(one.why.empty());

  plain.segments.front().neighbour = plain.segments.front().command;
  EXPECT_TRUE(not_observable(plain, {.earlier_model = true, .cuts_heard = true}).empty());
}

TEST(NotObservable, BehindTheLoop) {
  SegmentedAxis plain = axis(20.0, false);
  const auto in_loop = not_observable(plain, {.encoder_in_loop = true, .integrator = true});
  EXPECT_TRUE(says(in_loop, "lead_error"));
  EXPECT_TRUE(says(in_loop, "thermal_growth"));
  EXPECT_TRUE(says(in_loop, "gravity_offset"));
  EXPECT_FALSE(says(in_loop, "encoder_error")) << "the loop follows it";
  EXPECT_FALSE(says(in_loop, "cogging"));
  plain.segments.front().torque = plain.segments.front().command;
  EXPECT_FALSE(says(not_observable(plain, {.integrator = true}), "gravity_offset"))
      << "the torque shows it";
}

TEST(NotObservable, WithoutItsMotion) {
  const auto one_way = not_observable(axis(20.0, true), {});
  for (const char* id : {"presliding", "backlash", "asymmetric_friction"})
    EXPECT_TRUE(says(one_way, id)) << id;
  EXPECT_FALSE(says(one_way, "dwell_stiction"));
  // The same motion without rests: the reason must name the rests.
  SegmentedAxis restless = axis(20.0, false);
  for (Eigen::Index k = 0; k < restless.segments[0].size(); ++k)
    restless.segments[0].command(k) =
        0.05 * std::sin(std::numbers::pi * kSeenStep_s * static_cast<double>(k));
  const auto all = not_observable(restless, {});
  const auto dwell = std::find_if(all.begin(), all.end(),
                                  [](const auto& one) { return one.id == "dwell_stiction"; });
  ASSERT_NE(dwell, all.end());
  EXPECT_NE(dwell->why.find("rests"), std::string::npos) << dwell->why;
  EXPECT_FALSE(says(all, "presliding"));
  const auto brief = not_observable(axis(6.0, false), {});
  EXPECT_TRUE(says(brief, "viscous_drift"));
  EXPECT_TRUE(says(brief, "thermal_growth"));
  EXPECT_FALSE(says(brief, "presliding"));
}

}  // namespace
}  // namespace servotwin
