#include "identification/recording/evidence.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "drivers/recordings/recording_file.h"
#include "identification/loop/identify.h"
#include "identification/loop/projection.h"
#include "identification/recording/segments.h"
#include "tests/support/real_data.h"

namespace servotwin {
namespace {

constexpr double kStep_s = 1e-3;

/// A command built section by section, from rest; the axis follows it exactly.
class Program {
 public:
  void stand(double seconds) {
    for (int i = 0; i < std::lround(seconds / kStep_s); ++i) command_.push_back(at_);
  }
  /// At constant velocity.
  void run(double velocity, double seconds) {
    for (int i = 0; i < std::lround(seconds / kStep_s); ++i)
      command_.push_back(at_ += velocity * kStep_s);
  }
  /// To another velocity.
  void change(double from, double to, double seconds) {
    const auto steps = std::lround(seconds / kStep_s);
    for (int i = 0; i < steps; ++i) {
      const double share = (i + 0.5) / static_cast<double>(steps);
      command_.push_back(at_ += (from + (to - from) * share) * kStep_s);
    }
  }
  /// Back and forth with 3 m/s^2, reaching 0.3 m/s in 0.1 s.
  void fast_move() {
    for (const double v : {0.3, -0.3}) {
      change(0.0, v, 0.1);
      run(v, 0.1);
      change(v, 0.0, 0.1);
    }
  }
  /// This many legs back and forth.
  void creep(double velocity, double leg_s, int legs) {
    for (int i = 0; i < legs; ++i) run(i % 2 == 0 ? velocity : -velocity, leg_s);
  }
  [[nodiscard]] double now() const { return kStep_s * static_cast<double>(command_.size()); }
  [[nodiscard]] std::vector<Segment> segments() const {
    Segment s;
    s.start_s = 0.0;
    s.sample_time_s = kStep_s;
    s.command = Eigen::Map<const Eigen::ArrayXd>(command_.data(),
                                                 static_cast<Eigen::Index>(command_.size()));
    s.actual = s.command;
    return {s};
  }

 private:
  std::vector<double> command_;
  double at_ = 0.0;
};

struct Found {
  Evidence shows;
  double from_s, to_s;
};

/// The stretches must be these, to within 30 ms, the span of the differences.
void expect_stretches(const std::vector<EvidenceStretch>& got, const std::vector<Found>& wanted) {
  ASSERT_EQ(got.size(), wanted.size());
  for (std::size_t i = 0; i < got.size(); ++i) {
    SCOPED_TRACE(i);
    EXPECT_EQ(got[i].shows, wanted[i].shows);
    EXPECT_NEAR(got[i].segment.start_s, wanted[i].from_s, 0.03);
    EXPECT_NEAR(got[i].segment.end_s(), wanted[i].to_s, 0.03);
  }
}

std::vector<EvidenceStretch> sorted(const std::vector<Segment>& segments) {
  return sorted_by_evidence(segments, motion_scale(segments));
}

TEST(Evidence, FastMotionSlowReversalsAndStandstillAreToldApart) {
  Program program;
  program.stand(1.0);
  const double fast = program.now();
  program.fast_move();
  const double settled = program.now() + 0.5;
  program.stand(4.0);
  const double slow = program.now();
  program.creep(1e-3, 0.4, 6);
  const double stands = program.now();
  program.stand(3.0);
  expect_stretches(sorted(program.segments()), {{Evidence::kFastMotion, fast - 0.5, settled},
                                                {Evidence::kStandstill, settled, slow},
                                                {Evidence::kSlowReversals, slow, stands},
                                                {Evidence::kStandstill, stands, program.now()}});
}

TEST(Evidence, ThePeaksAreThoseOfTheCommand) {
  Program program;
  program.stand(1.0);
  for (int i = 0; i < 20; ++i) program.fast_move();
  const MotionScale scale = motion_scale(program.segments());
  EXPECT_NEAR(scale.velocity, 0.3, 1e-9);
  EXPECT_NEAR(scale.acceleration, 3.0, 1e-6);
  // A jump of the command is not fast motion.
  std::vector<Segment> jump = program.segments();
  jump[0].command.tail(500) += 1.0;
  EXPECT_LT(motion_scale(jump).velocity, 0.31);
  const MotionScale both = wider({1.0, 2.0}, {3.0, 0.5});
  EXPECT_EQ(both.velocity, 3.0);
  EXPECT_EQ(both.acceleration, 2.0);
}

TEST(Evidence, WhatCreepsIsSlowOnlyBesideWhatIsFast) {
  Program program;
  program.creep(1e-3, 0.4, 20);
  // By its own scale it is the fastest motion of this axis.
  for (const EvidenceStretch& s : sorted(program.segments()))
    EXPECT_EQ(s.shows, Evidence::kFastMotion);
  expect_stretches(sorted_by_evidence(program.segments(), {0.3, 3.0}),
                   {{Evidence::kSlowReversals, 0.0, program.now()}});
  // Speed is relative as well.
  EXPECT_TRUE(sorted_by_evidence(program.segments(), {0.009, 3.0}).empty());
}

TEST(Evidence, SteadyMotionAndASingleReversalAreEvidenceOfNothing) {
  const MotionScale scale{0.3, 3.0};
  Program steady;
  steady.run(1e-3, 8.0);
  EXPECT_TRUE(sorted_by_evidence(steady.segments(), scale).empty());
  Program once;
  once.creep(1e-3, 2.0, 2);
  EXPECT_TRUE(sorted_by_evidence(once.segments(), scale).empty());
  Program twice;
  twice.creep(1e-3, 2.0, 3);
  EXPECT_EQ(sorted_by_evidence(twice.segments(), scale).size(), 1U);
}

TEST(Evidence, ReversalsWithinTheBreakawayDisplacementAreNone) {
  const MotionScale scale{0.3, 3.0};
  Program program;
  program.creep(1e-4, 0.15, 20);  // 15 um
  EXPECT_TRUE(sorted_by_evidence(program.segments(), scale).empty());
  EvidenceLimits limits;
  limits.presliding = 10e-6;
  EXPECT_EQ(sorted_by_evidence(program.segments(), scale, limits).size(), 1U);
}

TEST(Evidence, TheStepsOfACommandAreNoAcceleration) {
  Program program;
  program.creep(1e-3, 0.4, 20);
  std::vector<Segment> segments = program.segments();
  // 1 um: between samples of 1 ms an acceleration of 1 m/s^2.
  segments[0].command = (segments[0].command / 1e-6).round() * 1e-6;
  expect_stretches(sorted_by_evidence(segments, {0.3, 3.0}),
                   {{Evidence::kSlowReversals, 0.0, program.now()}});
}

TEST(Evidence, AShortRestDoesNotPartReversalsAndALongOneDoes) {
  const MotionScale scale{0.3, 3.0};
  const auto with_rest = [&](double rest_s) {
    Program program;
    program.creep(1e-3, 0.4, 4);
    program.stand(rest_s);
    program.creep(1e-3, 0.4, 4);
    return sorted_by_evidence(program.segments(), scale);
  };
  EXPECT_EQ(with_rest(1.0).size(), 1U);
  const std::vector<EvidenceStretch> parted = with_rest(2.5);
  ASSERT_EQ(parted.size(), 3U);
  EXPECT_EQ(parted[1].shows, Evidence::kStandstill);
}

TEST(Evidence, EveryStretchIsCutSampleBySampleAndInOrder) {
  Program program;
  for (int i = 0; i < 3; ++i) {
    program.fast_move();
    program.stand(3.0);
    program.creep(2e-3, 0.3, 7);
  }
  std::vector<Segment> segments = program.segments();
  segments[0].start_s = 100.0;
  segments[0].actual += 1e-6;
  segments[0].torque = 2.0 * segments[0].command;
  double end_s = 0.0;
  const std::vector<EvidenceStretch> found = sorted(segments);
  ASSERT_GE(found.size(), 9U);
  for (const EvidenceStretch& stretch : found) {
    const Segment& s = stretch.segment;
    EXPECT_GT(s.start_s, end_s);
    end_s = s.end_s();
    const auto at = static_cast<Eigen::Index>(std::lround((s.start_s - 100.0) / kStep_s));
    EXPECT_TRUE((s.command == segments[0].command.segment(at, s.size())).all());
    EXPECT_TRUE((s.actual == segments[0].actual.segment(at, s.size())).all());
    EXPECT_TRUE((s.torque == segments[0].torque.segment(at, s.size())).all());
  }
}

TEST(Evidence, NothingIsFoundInWhatIsTooShortOrStandsStill) {
  Segment s;
  s.sample_time_s = kStep_s;
  EXPECT_TRUE(sorted({s}).empty());
  s.command = s.actual = Eigen::ArrayXd::Zero(30);
  EXPECT_TRUE(sorted({s}).empty());
  s.command = s.actual = Eigen::ArrayXd::Zero(5000);
  expect_stretches(sorted({s}), {{Evidence::kStandstill, 0.0, 5.0}});
}

TEST(Evidence, SlowReversalsLeadInUntilALongLegHasWipedOutWhatWasBefore) {
  Program program;
  program.run(1e-3, 0.1);  // the end of a leg that began before
  for (int i = 0; i < 3; ++i) {
    program.run(-1e-3, 0.6);
    program.run(1e-3, 0.6);
  }
  EXPECT_NEAR(static_cast<double>(lead_in(program.segments()[0])), 700.0, 2.0);
  // Never less than the response time of the loop.
  EvidenceLimits limits;
  limits.forgets = 50e-6;
  EXPECT_EQ(lead_in(program.segments()[0], limits), 500);
}

TEST(Evidence, WhatALeadInHoldsCountsInNoFit) {
  Program program;
  for (int i = 0; i < 3; ++i) program.fast_move();
  Segment s = program.segments()[0];
  // Friction, so that no coefficient is 0.
  for (Eigen::Index i = 1; i < s.size(); ++i)
    s.actual(i) -= 1e-5 * (s.command(i) > s.command(i - 1) ? 1.0 : -1.0);
  Segment led = s;
  led.lead = 300;
  const Structure structure{2, {kind_of<Presliding>(), kind_of<TimeDelay>()}, true};
  const Point point{denominator_of({0.0, 100.0, 0.8}, 2), {2e-5, 0.4, 1e-3}};
  Signals other = signals_of(led);
  other.error.head(300) += 1.0;
  // The one in the middle, between two that count as a whole.
  const auto with = [&](const Signals& middle) {
    return Projection({signals_of(s), middle, signals_of(s)}, structure);
  };
  const Projection data = with(signals_of(led)), same = with(other);
  EXPECT_EQ(data.solve(point).cost, same.solve(point).cost);
  EXPECT_EQ(data.solve(point).linear, same.solve(point).linear);
  const auto at = data.linearise(point);
  EXPECT_EQ(at.at.cost, same.linearise(point).at.cost);
  EXPECT_EQ(at.jacobian.middleRows(s.size(), 300).cwiseAbs().maxCoeff(), 0.0);
  const Eigen::VectorXd ones = Eigen::VectorXd::Ones(at.at.linear.size());
  const Eigen::MatrixXd all = data.full_jacobian(point, ones);
  EXPECT_EQ(all.middleRows(s.size(), 300).cwiseAbs().maxCoeff(), 0.0);
  EXPECT_GT(all.middleRows(s.size() + 300, 300).cwiseAbs().maxCoeff(), 0.0);
  EXPECT_NE(data.solve(point).cost, with(signals_of(s)).solve(point).cost);
  // A cut keeps the rest of the lead-in.
  EXPECT_EQ(cut({led}, 0.1, 10.0)[0].lead, 200);
  EXPECT_EQ(cut({led}, 0.5, 10.0)[0].lead, 0);
}

// Two parts of work with slow reversals (examples/README.md). Those of the first take less than
// half a second between moves that accelerate; those of the second, which runs slower, are at 19.6
// to 21.1 s.
TEST(Evidence, TheExampleMachineShowsItsSlowReversals) {
  const std::vector<Segment> segments =
      segment_axis(read_recording(std::filesystem::path(SERVOTWIN_SOURCE_DIR) /
                                  "examples/axis_production.csv"),
                   "X")
          .segments;
  double fast_s = 0.0;
  std::vector<Segment> slow;
  for (const EvidenceStretch& stretch : sorted(segments)) {
    EXPECT_NE(stretch.shows, Evidence::kStandstill);
    const Segment& s = stretch.segment;
    if (stretch.shows == Evidence::kFastMotion) fast_s += s.end_s() - s.start_s;
    if (stretch.shows == Evidence::kSlowReversals) slow.push_back(s);
  }
  EXPECT_GT(fast_s, 20.0);
  ASSERT_EQ(slow.size(), 1U);
  EXPECT_GT(slow[0].start_s, 19.6);
  EXPECT_LT(slow[0].end_s(), 21.1);
  int turns = 0;
  double direction = 0.0;
  for (Eigen::Index i = 1; i < slow[0].size(); ++i) {
    const double step = slow[0].command(i) - slow[0].command(i - 1);
    if (step * direction < 0.0) ++turns;
    if (step != 0.0) direction = step;
  }
  EXPECT_GE(turns, 5);
}

// Eight strokes at the axis's own speed, with nothing slow between them.
TEST(RealRecording, EmpsIsFastMotionFromBeginningToEnd) {
  SERVOTWIN_REAL_DATA(file, "emps/DATA_EMPS.mat");
  ReadOptions read;
  read.columns = "X.command=qg[m],X.actual=qm[m],X.torque=vir[V]";
  const std::vector<Segment> segments = segment_axis(read_recording(file, read), "X").segments;
  const std::vector<EvidenceStretch> found = sorted(segments);
  ASSERT_EQ(found.size(), 1U);
  EXPECT_EQ(found[0].shows, Evidence::kFastMotion);
  EXPECT_GT(found[0].segment.size(), segments[0].size() - 400);
}

}  // namespace
}  // namespace servotwin
