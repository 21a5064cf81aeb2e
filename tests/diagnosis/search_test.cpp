// The statistics by which candidates are judged, in closed form.
#include "diagnosis/search/search.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

namespace servotwin {
namespace {

/// Mean squares of intervals whose differences have the ranks 1 to n; those listed are negative.
struct Pieces {
  std::vector<double> before, after;
  Pieces(int n, const std::vector<int>& worse) {
    for (int i = 1; i <= n; ++i) {
      before.push_back(100.0);
      after.push_back(100.0 - i);
    }
    for (const int i : worse) after[static_cast<std::size_t>(i - 1)] = 100.0 + i;
  }
};

TEST(SignedRankZ, OfTenThatAllFall) {
  const Pieces all(10, {});
  EXPECT_DOUBLE_EQ(signed_rank_z(all.before, all.after), 55.0 / std::sqrt(385.0));
  EXPECT_DOUBLE_EQ(signed_rank_z(all.after, all.before), -55.0 / std::sqrt(385.0));
  const Pieces most(10, {2, 7});
  EXPECT_DOUBLE_EQ(signed_rank_z(most.before, most.after), (55.0 - 2.0 * 9.0) / std::sqrt(385.0));
}

TEST(SignedRankZ, DoesNotSeeHowLargeTheLargestIs) {
  Pieces pieces(12, {3});
  const double z = signed_rank_z(pieces.before, pieces.after);
  const double mean = paired_z(pieces.before, pieces.after);
  pieces.after.back() = -1e6;
  EXPECT_DOUBLE_EQ(signed_rank_z(pieces.before, pieces.after), z);
  // One interval with nearly all of the error makes the mean uncertain: z of one in n is sqrt(n).
  EXPECT_LT(paired_z(pieces.before, pieces.after), mean);
  EXPECT_NEAR(paired_z(pieces.before, pieces.after), 1.0, 1e-2);
}

TEST(SignedRankZ, PiecesThatAreAlikeSayNothing) {
  Pieces pieces(10, {});
  pieces.before.push_back(3.0), pieces.after.push_back(3.0);
  EXPECT_DOUBLE_EQ(signed_rank_z(pieces.before, pieces.after), 55.0 / std::sqrt(385.0));
  pieces.after[4] = pieces.before[4];  // nine are left
  EXPECT_EQ(signed_rank_z(pieces.before, pieces.after), 0.0);
}

}  // namespace
}  // namespace servotwin
