// The thesis study against closed forms and against the project's reference study, an independent
// implementation in Python of the same equations and the same scheme.
#include "tests/support/thesis_study.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <stdexcept>

namespace servotwin {
namespace {

const ThesisStudy& study() {
  static const ThesisStudy s = thesis_study();
  return s;
}

Eigen::ArrayXd error_um(const ThesisStudy& s) { return 1e3 * (s.command_mm - s.actual_mm); }
double rms(const Eigen::ArrayXd& a) { return std::sqrt(a.square().mean()); }

TEST(ThesisStudy, HasTheLengthOfTheThesisRecord) {
  EXPECT_EQ(study().command_mm.size(), 10915);
  EXPECT_EQ(study().actual_mm.size(), 10915);
  EXPECT_EQ(study().velocity.size(), 10915);
  EXPECT_EQ(study().friction_mm_s2.size(), 10915);
  EXPECT_DOUBLE_EQ(study().sample_time_s, 0.6e-3);
}

TEST(ThesisStudy, FrictionElementsMeetTheClosedForms) {
  const ThesisFriction f = thesis_friction();
  EXPECT_NEAR(f.level.sum(), 286.0, 1e-10);
  // All elements have yielded at the breakaway distance, and the last one just there.
  EXPECT_LT((f.level / f.stiffness).maxCoeff(), 0.02 * (1.0 + 1e-12));
  EXPECT_NEAR(f.level[9] / f.stiffness[9], 0.02, 1e-14);
  // The virgin curve passes its midpoint: at (1 - 0.7)/2 of the distance, (1 + 0.7)/2 of the force.
  const double at_midpoint = (f.stiffness * 0.02 * 0.15).min(f.level).sum();
  EXPECT_NEAR(at_midpoint, 286.0 * 0.85, 1e-9);
  EXPECT_GT(f.stiffness.minCoeff(), 0.0);
}

TEST(ThesisStudy, FrictionElementsMeetTheReferenceStudy) {
  const ThesisFriction f = thesis_friction();
  EXPECT_NEAR(f.stiffness[0], 2223924.2966751894, 1e-10 * 2223924.0);
  EXPECT_NEAR(f.stiffness[9], 80.4168044988439, 1e-10 * 80.0);
  EXPECT_NEAR(f.stiffness.sum(), 2542876.4705882324, 1e-10 * 2542876.0);
  EXPECT_NEAR(f.level[0], 60.49074086956517, 1e-10 * 60.0);
  EXPECT_NEAR(f.level[9], 1.6083360899768782, 1e-10 * 1.6);
}

TEST(ThesisStudy, ErrorMeetsTheReferenceStudy) {
  const Eigen::ArrayXd e = error_um(study());
  EXPECT_NEAR(rms(e), 540.875338769068, 1e-6);
  EXPECT_NEAR(e.abs().maxCoeff(), 1239.6144678308624, 1e-6);
}

TEST(ThesisStudy, SamplesMeetTheReferenceStudy) {
  struct Row {
    Eigen::Index index;
    double error, actual, friction;
  };
  constexpr std::array<Row, 10> kReference{
      {{500, 0.00481680967771525, 0.590204494923426, 286.0},
       {1000, 0.06587522901597631, 1.7672710540256054, 286.0},
       {2000, -0.6121147246901588, -1.0856675493781895, -286.0},
       {4000, -0.769635382959462, -2.2736719651002435, -286.0},
       {6000, 0.14674474122833203, 7.767029201241741, 286.0},
       {8000, -0.29622643149816597, -9.186492117010305, -286.0},
       // within reversals
       {504, -0.0051325893659689426, 0.5904892453256726, 150.47411124521184},
       {2656, -0.004672132634716775, 4.253029237237804, 198.42013944085207},
       {6057, -0.006297496508776312, 7.919631199445216, 136.96264282308084},
       {9580, 0.043894537130709566, -10.970018472520392, 185.05522134161353}}};
  for (const Row& row : kReference) {
    SCOPED_TRACE(row.index);
    EXPECT_NEAR(study().command_mm[row.index] - study().actual_mm[row.index], row.error, 1e-9);
    EXPECT_NEAR(study().actual_mm[row.index], row.actual, 1e-9);
    EXPECT_NEAR(study().friction_mm_s2[row.index], row.friction, 1e-6);
  }
}

TEST(ThesisStudy, FrictionIsThatOfTheMotion) {
  // With one internal step per sample the elements can be replayed from the recorded position.
  const ThesisStudy s = thesis_study(0.6e-3);
  const ThesisFriction f = thesis_friction();
  Eigen::ArrayXd force = Eigen::ArrayXd::Zero(f.level.size());
  for (Eigen::Index n = 1; n < s.actual_mm.size(); ++n) {
    force += f.stiffness * (s.actual_mm[n] - s.actual_mm[n - 1]);
    force = force.min(f.level).max(-f.level);
    ASSERT_NEAR(s.friction_mm_s2[n], force.sum(), 1e-5) << n;
  }
}

TEST(ThesisStudy, VelocityIsTheDerivativeOfThePosition) {
  const Eigen::Index n = study().actual_mm.size();
  const Eigen::ArrayXd difference =
      (study().actual_mm.tail(n - 2) - study().actual_mm.head(n - 2)) /
      (2.0 * study().sample_time_s);
  // Central difference: T^2/6 times the jerk, which is largest while friction reverses.
  EXPECT_LT(rms(difference - study().velocity.segment(1, n - 2)), 0.01);
}

TEST(ThesisStudy, InternalStepDoesNotMatter) {
  const Eigen::ArrayXd fine = error_um(thesis_study(25e-6));
  EXPECT_LT(rms(error_um(thesis_study(0.6e-3)) - fine), 0.004);
  EXPECT_LT(rms(error_um(study()) - fine), 0.001);
}

TEST(ThesisStudy, RefusesAnInternalStepThatDoesNotDivideTheSamplingTime) {
  EXPECT_THROW((void)thesis_study(2.5e-4), std::invalid_argument);
  EXPECT_THROW((void)thesis_study(0.0), std::invalid_argument);
  EXPECT_THROW((void)thesis_study(1e-3), std::invalid_argument);
}

TEST(Quantised, RoundsToTheNearestStep) {
  const Eigen::ArrayXd x = (Eigen::ArrayXd(5) << 0.0, 0.0012, -0.0017, 0.0024, 11.0004).finished();
  const Eigen::ArrayXd q = quantised(x, 1e-3);
  const Eigen::ArrayXd expected = (Eigen::ArrayXd(5) << 0.0, 0.001, -0.002, 0.002, 11.0).finished();
  EXPECT_LT((q - expected).abs().maxCoeff(), 1e-15);
  EXPECT_EQ((quantised(q, 1e-3) - q).abs().maxCoeff(), 0.0);
  EXPECT_EQ((quantised(x, 0.0) - x).abs().maxCoeff(), 0.0);
}

TEST(Quantised, ErrorIsUniform) {
  // Uniform within half a step: RMS step / sqrt(12). Only where the axis moves, a standing axis has
  // one error.
  const double step = 1e-3;
  const Eigen::ArrayXd difference = quantised(study().actual_mm, step) - study().actual_mm;
  EXPECT_LE(difference.abs().maxCoeff(), step / 2.0 * (1.0 + 1e-9));
  const Eigen::ArrayXd moving = (study().velocity.abs() > 5.0).select(difference, 0.0);
  const double count = static_cast<double>((study().velocity.abs() > 5.0).count());
  EXPECT_NEAR(std::sqrt(moving.square().sum() / count), step / std::sqrt(12.0), 0.03 * step);
}

TEST(Quantised, RefusesANegativeStep) {
  EXPECT_THROW((void)quantised(study().actual_mm, -1.0), std::invalid_argument);
}

}  // namespace
}  // namespace servotwin
