#include "daemon/identify/evidence_memory.h"

#include <gtest/gtest.h>

#include <cmath>

namespace servotwin::daemon {
namespace {

constexpr double kStep_s = 1e-3;
constexpr EvidenceBounds kBounds{5.0, 3.0, 2.0, 100.0};
constexpr double kNever = -1.0;

/// A command for a time span: fast if requested, else reversals at 1 mm/s.
Segment motion(double from_s, double to_s, bool fast) {
  Segment s;
  s.start_s = from_s;
  s.sample_time_s = kStep_s;
  const auto n = static_cast<Eigen::Index>(std::lround((to_s - from_s) / kStep_s));
  s.command.resize(n);
  for (Eigen::Index i = 0; i < n; ++i) {
    const double t = from_s + static_cast<double>(i) * kStep_s;
    const double phase = std::fmod(t, 1.0);
    s.command(i) = fast ? 0.05 * std::sin(8.0 * t) : 1e-3 * (phase < 0.5 ? phase : 1.0 - phase);
  }
  s.actual = s.command + 1e-6;
  return s;
}
Segment fast(double from_s, double to_s) { return motion(from_s, to_s, true); }
Segment slow(double from_s, double to_s) { return motion(from_s, to_s, false); }

TEST(EvidenceMemory, KeepsTheNewestSecondsOfEveryClass) {
  EvidenceMemory memory(kBounds);
  for (int i = 0; i < 20; ++i) {
    const double t = 10.0 * i;
    memory.take({fast(t, t + 4.0), slow(t + 5.0, t + 9.0)}, kNever, 1.0);
    EXPECT_LE(memory.seconds().of(Evidence::kFastMotion), 5.0 + 1e-9);
    EXPECT_LE(memory.seconds().of(Evidence::kSlowReversals), 3.0 + 1e-9);
  }
  const std::vector<Segment> fast_kept = memory.kept({Evidence::kFastMotion});
  ASSERT_EQ(fast_kept.size(), 2U);
  EXPECT_NEAR(fast_kept[0].start_s, 183.0, 2 * kStep_s);
  EXPECT_NEAR(fast_kept[1].start_s, 190.0, 2 * kStep_s);
  EXPECT_NEAR(fast_kept[1].end_s(), 194.0, 2 * kStep_s);
  const std::vector<Segment> slow_kept = memory.kept({Evidence::kSlowReversals});
  ASSERT_EQ(slow_kept.size(), 1U);
  EXPECT_NEAR(slow_kept[0].start_s, 196.0, 2 * kStep_s);
  EXPECT_GT(slow_kept[0].lead, 0) << "what friction remembers is not known there";
  EXPECT_EQ(fast_kept[0].lead, 0);
  // In order of time.
  const auto both = memory.kept({Evidence::kFastMotion, Evidence::kSlowReversals});
  ASSERT_EQ(both.size(), 3U);
  EXPECT_LT(both[1].end_s(), both[2].start_s);
}

// A coupling is fitted where the other axis' command is known all the time.
TEST(EvidenceMemory, KeepsTheOtherAxisBesideStretchesThatFollowEachOther) {
  EvidenceMemory memory(kBounds);
  for (const auto& [from_s, to_s] : {std::pair{0.0, 2.0}, std::pair{2.0, 4.0}}) {
    Segment s = fast(from_s, to_s);
    s.neighbour = 2.0 * s.command;
    s.neighbour_motion = 3.0 * s.command;
    memory.take({s}, kNever, 1.0);
  }
  const std::vector<Segment> kept = memory.kept({Evidence::kFastMotion});
  ASSERT_EQ(kept.size(), 1U);
  ASSERT_EQ(kept[0].neighbour.size(), kept[0].size());
  EXPECT_TRUE((kept[0].neighbour == 2.0 * kept[0].command).all());
  ASSERT_EQ(kept[0].neighbour_motion.size(), kept[0].size());
  EXPECT_TRUE((kept[0].neighbour_motion == 3.0 * kept[0].command).all());
  Segment alone = fast(4.0, 5.0);
  memory.take({alone}, kNever, 1.0);
  EXPECT_EQ(memory.kept({Evidence::kFastMotion}).size(), 2U) << "there nothing is beside it";
  memory.forget_all();
  EXPECT_TRUE(memory.kept({Evidence::kFastMotion}).empty());
}

TEST(EvidenceMemory, ForgetsWhatIsTooOldInMotion) {
  EvidenceMemory memory(kBounds);
  memory.take({fast(0.0, 4.0)}, kNever, 10.0);
  memory.take({slow(1000.0, 1002.0)}, kNever, 109.0);
  EXPECT_NEAR(memory.seconds().of(Evidence::kFastMotion), 4.0, 1e-9) << "standing ages nothing";
  memory.take({slow(1010.0, 1012.0)}, kNever, 111.0);
  EXPECT_EQ(memory.seconds().of(Evidence::kFastMotion), 0.0);
  // The peak of earlier fast motion still separates fast from slow.
  EXPECT_GT(memory.seconds().of(Evidence::kSlowReversals), 2.9);
}

TEST(EvidenceMemory, MotionThatIsTakenTwiceIsKeptOnceAndWithoutASeam) {
  EvidenceMemory memory(kBounds);
  memory.take({fast(0.0, 2.0)}, kNever, 2.0);
  const EvidenceSeconds fresh = memory.take({fast(1.0, 4.0)}, 2.0, 4.0);
  EXPECT_NEAR(fresh.of(Evidence::kFastMotion), 2.0, 2 * kStep_s);
  const std::vector<Segment> kept = memory.kept({Evidence::kFastMotion});
  ASSERT_EQ(kept.size(), 1U);
  const Segment whole = fast(0.0, 4.0);
  ASSERT_EQ(kept[0].size(), whole.size());
  EXPECT_LT((kept[0].command - whole.command).abs().maxCoeff(), 1e-9);
  EXPECT_LT((kept[0].actual - whole.actual).abs().maxCoeff(), 1e-9);
}

}  // namespace
}  // namespace servotwin::daemon
