// Detection of cuts: an intermittent tone is a cut, a permanent tone is not.
#include "diagnosis/evidence/cuts.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

namespace servotwin {
namespace {

constexpr double kCutStep_s = 1e-3, kTone_hz = 61.7;
constexpr Eigen::Index kSamples = 12000;

bool cutting(double t) { return std::fmod(t, 3.0) > 1.0 && std::fmod(t, 3.0) < 2.2; }

/// Noise of 0.2, and a tone of 1 while `on` is true.
template <class On>
std::vector<Eigen::ArrayXd> heard(const On& on) {
  std::mt19937_64 random(2);
  std::normal_distribution<> noise(0.0, 0.2);
  Eigen::ArrayXd out(kSamples);
  for (Eigen::Index k = 0; k < kSamples; ++k) {
    const double t = kCutStep_s * static_cast<double>(k);
    out(k) = noise(random) + (on(t) ? std::sin(2.0 * M_PI * kTone_hz * t) : 0.0);
  }
  return {out};
}

std::vector<Segment> segments() {
  Segment s;
  s.sample_time_s = kCutStep_s;
  s.command = s.actual = Eigen::ArrayXd::Zero(kSamples);
  return {s};
}

TEST(Cuts, AreWhereTheToneIs) {
  std::vector<Segment> all = segments();
  ASSERT_TRUE(find_cuts(all, heard(cutting)));
  Eigen::Index wrong = 0;
  for (Eigen::Index k = 0; k < kSamples; ++k)
    wrong += (all[0].in_cut(k) > 0.5) != cutting(kCutStep_s * static_cast<double>(k)) ? 1 : 0;
  EXPECT_LT(wrong, 8 * 20);  // 20 ms at each of the eight edges
}

// The integrator of a control compensates the mean cutting force: what remains are transients of
// thirty times the tone as the tool enters and leaves.
TEST(Cuts, AreHeardHoweverHardTheToolEntersAndLeaves) {
  std::vector<Eigen::ArrayXd> left = heard(cutting);
  double push = 0.0;
  for (Eigen::Index k = 1; k < kSamples; ++k) {
    const double t = kCutStep_s * static_cast<double>(k);
    push *= std::exp(-kCutStep_s / 0.03);
    if (cutting(t) != cutting(t - kCutStep_s)) push += cutting(t) ? -30.0 : 30.0;
    left[0](k) += push;
  }
  std::vector<Segment> all = segments();
  ASSERT_TRUE(find_cuts(all, left));
  Eigen::Index wrong = 0;
  for (Eigen::Index k = 0; k < kSamples; ++k)
    wrong += (all[0].in_cut(k) > 0.5) != cutting(kCutStep_s * static_cast<double>(k)) ? 1 : 0;
  EXPECT_LT(wrong, 8 * 80);  // 80 ms at each of the eight edges
}

TEST(Cuts, AToneThatStaysIsNone) {
  std::vector<Segment> all = segments();
  EXPECT_FALSE(find_cuts(all, heard([](double) { return true; })));
  EXPECT_EQ(all[0].in_cut.size(), 0);
}

TEST(Cuts, NoiseIsNone) {
  std::vector<Segment> all = segments();
  EXPECT_FALSE(find_cuts(all, heard([](double) { return false; })));
}

TEST(Lines, OfTwoTonesAreFoundToAQuarterOfALine) {
  Eigen::VectorXd x(8000);
  std::mt19937_64 random(3);
  std::normal_distribution<> noise;
  for (Eigen::Index k = 0; k < x.size(); ++k) {
    const double t = kCutStep_s * static_cast<double>(k);
    x(k) =
        noise(random) + std::sin(2.0 * M_PI * 23.4 * t) + 2.0 * std::cos(2.0 * M_PI * 140.15 * t);
  }
  const std::vector<double> lines = lines_of(x, kCutStep_s, 2);
  ASSERT_EQ(lines.size(), 2U);
  EXPECT_NEAR(std::max(lines[0], lines[1]), 140.15, 0.25 / 8.0);
  EXPECT_NEAR(std::min(lines[0], lines[1]), 23.4, 0.25 / 8.0);
}

}  // namespace
}  // namespace servotwin
