// The term for the unexplained residual: it finds the variable that the residual depends on and
// predicts held-out motion. The true force is smooth, not a table like the term.
#include "diagnosis/search/unexplained.h"

#include <gtest/gtest.h>

#include <cmath>

#include "identification/loop/identify.h"
#include "twin/twin.h"

namespace servotwin {
namespace {

constexpr double kRestStep_s = 2e-3;

Model axis() {
  Model model;
  model.sample_time_s = kRestStep_s;
  model.loop.order = 2;
  model.loop.denominator = {400.0, 40'000.0, 0.0};
  model.loop.numerator = {1.0, 400.0, 0.0};
  Effect friction = make_effect<CoulombFriction>();
  friction.coefficient[0] = 0.3;
  model.effects = {friction};
  return model;
}

/// Strokes of varying length, and the response of an axis with this model.
Segment recorded(const Model& truth, double begin_s, double length_s) {
  Segment s;
  s.start_s = begin_s;
  s.sample_time_s = kRestStep_s;
  const auto n = static_cast<Eigen::Index>(length_s / kRestStep_s);
  s.command.resize(n);
  for (Eigen::Index k = 0; k < n; ++k) {
    const double t = begin_s + kRestStep_s * static_cast<double>(k);
    s.command(k) = 0.08 * std::sin(2.1 * t) + 0.05 * std::sin(0.83 * t + 1.0);
  }
  s.actual = s.command - simulate(truth, s);
  return s;
}

TEST(Unexplained, FindsAForceOverPositionAndPredictsWithIt) {
  Model truth = axis();
  Effect wave = make_effect<Cogging>();
  wave.shape = {0.4};
  wave.coefficient = {0.5, 0.2, 0.0, 0.0};
  truth.effects.push_back(wave);
  const std::vector<Segment> training{recorded(truth, 0.0, 16.0)},
      unseen{recorded(truth, 40.0, 8.0)};
  const auto better = with_unexplained(axis(), training);
  ASSERT_TRUE(better);
  EXPECT_EQ(better->effects.back().kind, kind_of<UnexplainedOverPosition>());
  EXPECT_LT(judge(*better, unseen).rms, 0.2 * judge(axis(), unseen).rms);
}

TEST(Unexplained, FindsAForceOverVelocity) {
  Model truth = axis();
  truth.loop.denominator[0] += 3.0;  // viscous friction
  truth.loop.numerator[1] += 3.0;
  const std::vector<Segment> training{recorded(truth, 0.0, 16.0)};
  const auto better = with_unexplained(axis(), training);
  ASSERT_TRUE(better);
  EXPECT_EQ(better->effects.back().kind, kind_of<UnexplainedOverVelocity>());
}

TEST(Unexplained, FindsNothingWhereNothingIsLeft) {
  Segment s = recorded(axis(), 0.0, 16.0);
  for (Eigen::Index k = 0; k < s.size(); ++k)
    s.actual(k) += 1e-7 * std::sin(1e4 * static_cast<double>(k * k % 7919));
  EXPECT_FALSE(with_unexplained(axis(), {s}));
}

}  // namespace
}  // namespace servotwin
