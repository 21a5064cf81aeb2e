#include "ilc/learn.h"

#include <gmock/gmock.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "ilc/feedforward.h"
#include "ilc/uncertainty.h"
#include "tests/ilc/study.h"
#include "tests/virtual_machine/program.h"
#include "twin/twin.h"

namespace servotwin {
namespace {

using study::axis_of;
using study::machine;
using study::mismatched;
using study::moves;
using study::plant;
using study::rms_um;

/// One case of the reference experiment: RMS of the error per trial [um].
struct LearnCase {
  std::string name;
  double bandwidth_hz, friction, gain;
  bool exact_model;
  std::vector<double> rms;
};

void PrintTo(const LearnCase& one, std::ostream* out) { *out << one.name; }

class Reference : public testing::TestWithParam<LearnCase> {};

TEST_P(Reference, TrialByTrial) {
  const LearnCase& expected = GetParam();
  const Model truth = plant(expected.friction);
  LearnAxis axis = axis_of(expected.exact_model ? truth : mismatched(), expected.bandwidth_hz);
  axis.law.gain = expected.gain;
  LearnOptions options;
  options.trials = static_cast<int>(expected.rms.size()) - 1;
  const Learned learned = learn({axis}, machine(truth, axis.path), options);
  const std::vector<double> found = rms_um(learned);
  ASSERT_GE(found.size(), 3U);
  for (std::size_t trial = 0; trial < found.size(); ++trial) {
    if (trial <= 2) {
      EXPECT_NEAR(found[trial], expected.rms[trial], 0.05 * expected.rms[trial]) << trial;
    } else {
      EXPECT_LT(found[trial], 2.0 * expected.rms[trial]) << trial;
      EXPECT_GT(found[trial], 0.5 * expected.rms[trial]) << trial;
    }
  }
}

INSTANTIATE_TEST_SUITE_P(
    Learning, Reference,
    testing::Values(
        LearnCase{"fc50_exact",
                  50.0,
                  0.286,
                  1.0,
                  true,
                  {516.434, 1.00333, 0.336607, 0.281333, 0.258516, 0.247353, 0.238828, 0.233576}},
        LearnCase{"fc50_mismatch",
                  50.0,
                  0.286,
                  1.0,
                  false,
                  {516.434, 1.75959, 0.364547, 0.304537, 0.265796, 0.245435, 0.235635, 0.227953}},
        LearnCase{"fc100_mismatch",
                  100.0,
                  0.286,
                  1.0,
                  false,
                  {516.434, 1.7963, 0.11888, 0.057578, 0.047014, 0.044393, 0.041375, 0.038116}},
        LearnCase{"fc100_mismatch_without_friction",
                  100.0,
                  0.0,
                  1.0,
                  false,
                  {516.204, 1.2976, 0.024679, 0.022222, 0.02151, 0.021531}},
        LearnCase{"fc200_mismatch",
                  200.0,
                  0.286,
                  1.0,
                  false,
                  {516.434, 1.8000, 0.1006, 0.023823, 0.010731, 0.0096536}},
        LearnCase{"fc100_mismatch_half_gain",
                  100.0,
                  0.286,
                  0.5,
                  false,
                  {516.434, 258.04, 128.95, 64.443, 32.205, 16.094, 8.0434, 4.0202, 2.0099, 1.0054,
                   0.50359, 0.25789}}),
    [](const auto& one) { return one.param.name; });

TEST(Learning, WithAnEncoderOfOneMicrometreIsTheReference) {
  const LearnAxis axis = axis_of(mismatched(), 100.0);
  const Plant exact = machine(plant(), axis.path);
  // Compared with the position before quantisation.
  std::vector<double> found;
  const Plant quantised = [&](const std::vector<Eigen::ArrayXd>& commands) {
    std::vector<Eigen::ArrayXd> out = exact(commands);
    found.push_back(1e6 * size_of(axis.path.command - out[0]).rms);
    out[0] = (out[0] / 1e-6).rint() * 1e-6;
    return out;
  };
  LearnOptions options;
  options.trials = 3;
  (void)learn({axis}, quantised, options);
  ASSERT_EQ(found.size(), 4U);
  EXPECT_NEAR(found[0], 516.434, 0.05 * 516.434);
  EXPECT_NEAR(found[1], 1.79878, 0.05 * 1.79878);
  EXPECT_NEAR(found[2], 0.21156, 0.05 * 0.21156);
  EXPECT_LT(found[3], 2.0 * 0.15948);
}

// The thesis expects two to three orders of magnitude on the twin with GMS friction.
TEST(Learning, IsMonotoneAndAHundredTimesBetterWithinTenTrials) {
  LearnAxis axis = axis_of(plant(), 0.0);
  axis.basis_bandwidth_hz = 200.0;
  const auto models = models_within(axis.law.model, relative_uncertainty(axis.law.model, 0.05));
  axis.law.bandwidth_hz = robust_bandwidth(axis.law, models, study::kStep_s);
  ASSERT_EQ(why_refused(axis.law, models, study::kStep_s), "");
  const Learned learned = learn({axis}, on_twins({axis}));
  const std::vector<double> found = rms_um(learned);
  for (std::size_t trial = 1; trial <= learned.best; ++trial)
    EXPECT_LT(found[trial], found[trial - 1]) << trial;
  EXPECT_GE(found.front() / found[learned.best], 100.0);
  EXPECT_LE(learned.best, 10U);
}

TEST(Learning, KeepsTheBestTrialAndEndsWhenErrorsGrow) {
  // Without Q, in proportion to the error: beyond the loop's bandwidth the correction acts too
  // late, and small errors there grow from trial to trial.
  LearnAxis axis = axis_of(plant(), std::numeric_limits<double>::infinity());
  axis.law.law = Law::kP;
  LearnOptions options;
  options.trials = 40;
  const Learned learned = learn({axis}, machine(plant(), axis.path), options);
  EXPECT_EQ(learned.ending, Ending::kGrew);
  EXPECT_EQ(learned.trials.size(), learned.best + 3);
  const std::vector<double> found = rms_um(learned);
  EXPECT_EQ(found[learned.best], *std::min_element(found.begin(), found.end()));
  EXPECT_NEAR(1e6 * size_of(learned.axes[0].error_after).rms, found[learned.best], 1e-9);
  EXPECT_GT(found.back(), found[learned.best]);
}

// e_inf = (1 - Q) / (1 - Q (1 - L T)) e_0, of a plant that is linear.
TEST(Learning, EndsAtTheLimitOfTheory) {
  LearnAxis axis = axis_of(mismatched(0.0), 20.0);
  const Model truth = plant(0.0);
  LearnOptions options;
  options.trials = 12;
  const Learned learned = learn({axis}, machine(truth, axis.path), options);
  ZeroPhase filter(axis.path.size(), study::kStep_s);
  const Transfer t = transfer_of(truth);
  const Eigen::ArrayXcd limit = filter.omega().unaryExpr([&](double w) {
    const double q = axis.law.q(w);
    return (1.0 - q) / (1.0 - q * (1.0 - axis.law.l(w) * t.at(w)));
  });
  const Eigen::ArrayXd expected = filter.filtered(learned.axes[0].error_before, limit);
  EXPECT_LT(size_of(learned.axes[0].error_after - expected).rms, 0.002 * size_of(expected).rms);
}

TEST(Learning, StartsAndEndsWithNothingAndObeysTheLimits) {
  LearnAxis axis = axis_of(plant(), 80.0);
  axis.basis_bandwidth_hz = 200.0;
  axis.limits = {200e-6, 5e-3};
  for (const Law law : {Law::kInverse, Law::kNormOptimal, Law::kP, Law::kPd}) {
    axis.law.law = law;
    axis.law.derivative_s = axis.law.model.lag_s();
    LearnOptions options;
    options.trials = 3;
    const Learned learned = learn({axis}, on_twins({axis}), options);
    const Eigen::ArrayXd& u = learned.axes[0].correction;
    EXPECT_GT(learned.best, 0U);
    EXPECT_EQ(u(0), 0.0);
    EXPECT_EQ(u(u.size() - 1), 0.0);
    EXPECT_LE(u.abs().maxCoeff(), 200e-6);
    const Eigen::ArrayXd steps = u.tail(u.size() - 1) - u.head(u.size() - 1);
    EXPECT_LE(steps.abs().maxCoeff(), 5e-3 * study::kStep_s * (1.0 + 1e-9));
    EXPECT_GT(learned.axes[0].at_limit_share, 0.1);
  }
}

// Beyond Q nothing is learned; the correction from the model without a trial has that bandwidth
// too.
TEST(Learning, FromWhatTheModelSaysIsBetterThanQAlone) {
  for (const Model& model : {plant(), mismatched()}) {
    LearnAxis axis = axis_of(model, 50.0);
    const Learned without = learn({axis}, machine(plant(), axis.path));
    axis.basis_bandwidth_hz = 200.0;
    const Learned with = learn({axis}, machine(plant(), axis.path));
    EXPECT_LT(rms_um(with)[with.best], 0.5 * rms_um(without)[without.best]);
  }
}

/// RMS of the error of the position before quantisation [um], of learning on a
/// machine with an encoder of 1 um; over several trials, since rounding makes single ones scatter.
double behind_an_encoder_um(double bandwidth_hz, double reversal_hz, double basis_hz) {
  LearnAxis axis = axis_of(mismatched(), bandwidth_hz, study::circles());
  axis.reversal_bandwidth_hz = reversal_hz;
  axis.basis_bandwidth_hz = basis_hz;
  const Plant exact = machine(plant(), axis.path);
  double sum = 0.0;
  int count = 0;
  const Plant quantised = [&](const std::vector<Eigen::ArrayXd>& commands) {
    std::vector<Eigen::ArrayXd> out = exact(commands);
    if (++count > 4) sum += 1e6 * size_of(axis.path.command - out[0]).rms;
    out[0] = (out[0] / 1e-6).rint() * 1e-6;
    return out;
  };
  LearnOptions options;
  options.trials = 10;
  options.patience = 10;
  (void)learn({axis}, quantised, options);
  return sum / (count - 4);
}

// A wide Q passes encoder noise, a narrow Q leaves the effect of friction: the best fixed bandwidth
// is a compromise. A bandwidth that changes in time, or the correction from the model as a basis,
// avoids it.
TEST(Learning, BandwidthAtReversalsAloneBeatsTheBestFixedOne) {
  double fixed = 1e300;
  for (const double bandwidth_hz : {25.0, 35.0, 50.0, 70.0, 85.0, 100.0, 120.0, 140.0, 200.0})
    fixed = std::min(fixed, behind_an_encoder_um(bandwidth_hz, 0.0, 0.0));
  EXPECT_LT(behind_an_encoder_um(50.0, 100.0, 0.0), 0.92 * fixed);
  EXPECT_LT(behind_an_encoder_um(25.0, 0.0, 200.0), 0.75 * fixed);
}

/// A diamond of 20 mm sides on two axes with different loops.
std::vector<LearnAxis> diamond(double peak) {
  virtual_machine::PlanePath path(0.0, 0.0);
  const virtual_machine::Limits limits{0.096, 1.5, 60.0};
  const double half = 0.02 / std::numbers::sqrt2;
  path.dwell(0.3);
  path.line_by(half, half, limits);
  path.line_by(-half, half, limits);
  path.line_by(-half, -half, limits);
  path.line_by(half, -half, limits);
  path.dwell(0.4);
  LearnAxis x = axis_of(plant(), 60.0, study::sampled(path.x(), study::kStep_s)),
            y = axis_of(mismatched(), 60.0, study::sampled(path.y(), study::kStep_s));
  y.model.loop = study::loop_of(8.0, 25.0, 0.6, 60.0);
  y.law.model = transfer_of(y.model);
  y.name = "Y";
  x.limits.peak = y.limits.peak = peak;
  return {x, y};
}

// The lag is 1.2 mm and more. If the correction is limited to much less, it is more effective
// across the path.
TEST(CrossCoupled, UnderLimitsMakesTheContourBetterThanAxisByAxis) {
  const std::vector<LearnAxis> axes = diamond(150e-6);
  LearnOptions options;
  const Learned alone = learn(axes, on_twins(axes), options);
  options.aim = Aim::kContour;
  const Learned together = learn(axes, on_twins(axes), options);
  const double before = together.trials.front().contour.rms,
               after = together.trials[together.best].contour.rms;
  EXPECT_LT(after, 0.2 * before);
  EXPECT_LT(after, 0.5 * alone.trials[alone.best].contour.rms);
  EXPECT_GT(together.trials[together.best].axis[0].rms, 0.5 * together.trials.front().axis[0].rms)
      << "the lag is left to itself";
}

// Nothing can be moved across the path by more than n_x peak + n_y peak.
TEST(CrossCoupled, UnderLimitsItReachesWhatTheyAllow) {
  constexpr double kPeak = 20e-6;
  const std::vector<LearnAxis> axes = diamond(kPeak);
  LearnOptions options;
  options.aim = Aim::kContour;
  const Learned learned = learn(axes, on_twins(axes), options);
  Eigen::ArrayXd least = learned.before->distance.abs();
  for (Eigen::Index k = 0; k < least.size(); ++k) {
    const PathPoint& away = learned.before->away[static_cast<std::size_t>(k)];
    const double reach =
        kPeak * (std::abs(away[0]) + std::abs(away[1])) / std::max(least(k), 1e-12);
    least(k) = std::max(0.0, least(k) - reach);
  }
  const double allowed = size_of(least).rms, found = learned.trials[learned.best].contour.rms;
  EXPECT_GT(allowed, 0.2 * learned.trials.front().contour.rms) << "the limits do bind";
  EXPECT_GT(found, 0.95 * allowed);
  EXPECT_LT(found, 1.1 * allowed);
}

TEST(CrossCoupled, WithoutLimitsBothReachTheContour) {
  const std::vector<LearnAxis> axes = diamond(std::numeric_limits<double>::infinity());
  for (const Aim aim : {Aim::kTracking, Aim::kContour}) {
    LearnOptions options;
    options.aim = aim;
    const Learned learned = learn(axes, on_twins(axes), options);
    EXPECT_LT(learned.trials[learned.best].contour.rms, 0.02 * learned.trials.front().contour.rms);
  }
}

// Axis by axis, what one axis may correct and the other may not turns into an error across the
// path.
TEST(CrossCoupled, NothingIsKeptThatLeavesThePathWorse) {
  std::vector<LearnAxis> axes = diamond(1e-3);
  axes[1].limits.peak = 1e-6;
  const Learned learned = learn(axes, on_twins(axes), {});
  for (std::size_t trial = 1; trial < learned.trials.size(); ++trial)
    EXPECT_GT(learned.trials[trial].contour.rms, learned.trials.front().contour.rms);
  EXPECT_EQ(learned.best, 0U);
  EXPECT_EQ(learned.axes[0].correction.abs().maxCoeff(), 0.0);
}

// One axis at rest, one moving: nanometres of additional contour error are no reason to reject the
// correction of the moving axis; micrometres are.
TEST(CrossCoupled, AContourErrorOfNothingTakesNothingBack) {
  std::vector<LearnAxis> axes{axis_of(plant(), 100.0), axis_of(plant(), 100.0)};
  axes[1].path.command.setZero();
  for (const auto& [grows, best] : {std::pair{1e-9, true}, std::pair{1e-6, false}}) {
    int trial = 0;
    const Plant twins = on_twins(axes);
    const Learned learned = learn(axes, [&, by = grows](const auto& commands) {
      auto positions = twins(commands);
      positions[1] += by * ++trial;
      return positions;
    });
    EXPECT_EQ(learned.best > 0, best) << grows;
  }
}

TEST(CrossCoupled, NeedsTwoLinearAxes) {
  std::vector<LearnAxis> axes = diamond(1e-3);
  axes[1].rotary = true;
  LearnOptions options;
  options.aim = Aim::kContour;
  EXPECT_THROW((void)learn(axes, on_twins(axes), options), std::invalid_argument);
  axes.pop_back();
  EXPECT_THROW((void)learn(axes, on_twins(axes), options), std::invalid_argument);
}

/// X feels half of the acceleration of Y, which circles while X moves to and fro.
std::vector<LearnAxis> coupled_axes() {
  Model pushed = plant();
  Effect coupling = make_effect<CrossCoupling>();
  coupling.coefficient[0] = -0.5;
  pushed.effects.push_back(coupling);
  Segment x = moves(), y = study::circles();
  const Eigen::Index size = std::min(x.size(), y.size());
  x.command.conservativeResize(size);
  y.command.conservativeResize(size);
  LearnAxis first = axis_of(pushed, 50.0, x), second = axis_of(plant(), 50.0, y);
  second.name = "Y";
  return {first, second};
}

TEST(CoupledAxes, LearnFromWhatTheOtherDoes) {
  std::vector<LearnAxis> blind = coupled_axes(), seeing = blind;
  EXPECT_TRUE(find_neighbours(seeing, {"", ""}).empty());
  ASSERT_EQ(seeing[0].neighbour, 1U);
  EXPECT_FALSE(seeing[1].neighbour.has_value()) << "its model contains no other axis";
  const auto left_on_machine = [&](const std::vector<LearnAxis>& axes) {
    const Learned learned = learn(axes, on_twins(axes));
    std::vector<Eigen::ArrayXd> commands;
    for (std::size_t i = 0; i < axes.size(); ++i)
      commands.push_back(axes[i].path.command + learned.axes[i].correction);
    Segment segment = axes[0].path;
    segment.command = commands[0];
    segment.neighbour = commands[1];
    segment.actual.resize(0);
    const Eigen::ArrayXd reading = commands[0] - simulate(axes[0].model, segment);
    return size_of(axes[0].path.command - reading).rms;
  };
  EXPECT_LT(3.0 * left_on_machine(seeing), left_on_machine(blind));
}

// X feels the motion of Y, which its own twin predicts from the corrected command of Y.
TEST(CoupledAxes, MoveTogetherOnTheirTwins) {
  std::vector<LearnAxis> axes = coupled_axes();
  axes[0].model.effects.back() = make_effect<CrossCouplingByMotion>();
  axes[0].model.effects.back().coefficient[0] = -0.5;
  EXPECT_TRUE(find_neighbours(axes, {"Y", ""}).empty());
  std::vector<Eigen::ArrayXd> commands{axes[0].path.command, 1.1 * axes[1].path.command};
  const std::vector<Eigen::ArrayXd> moved = on_twins(axes)(commands);
  Segment x = axes[0].path, y = axes[1].path;
  x.actual.resize(0);
  y.actual.resize(0);
  x.command = commands[0];
  y.command = commands[1];
  EXPECT_EQ((moved[1] - (y.command - simulate(axes[1].model, y))).abs().maxCoeff(), 0.0);
  x.neighbour = y.command;
  x.neighbour_motion = moved[1];
  EXPECT_EQ((moved[0] - (x.command - simulate(axes[0].model, x))).abs().maxCoeff(), 0.0);
  x.neighbour_motion.resize(0);
  EXPECT_GT((moved[0] - (x.command - simulate(axes[0].model, x))).abs().maxCoeff(), 1e-6)
      << "the command of Y is not its motion";
}

TEST(CoupledAxes, WithoutTheOtherAxisAreNamed) {
  std::vector<LearnAxis> axes = coupled_axes();
  EXPECT_THAT(find_neighbours(axes, {"Z", ""}), testing::ElementsAre(0U));
  EXPECT_EQ(without_neighbour("X", "Z"),
            "the model of X contains the acceleration of axis Z, which has no path here: what it "
            "does is not corrected");
  EXPECT_TRUE(find_neighbours(axes, {"Y", ""}).empty());
}

TEST(Feedforward, OfTheRightModelLeavesWhatQLeaves) {
  for (const double friction : {0.0, 0.286}) {
    LearnAxis axis = axis_of(plant(friction), 100.0);
    axis.basis_bandwidth_hz = 100.0;
    LearnOptions options;
    options.feedforward_only = true;
    const Learned learned = learn({axis}, on_twins({axis}), options);
    ASSERT_EQ(learned.trials.size(), 2U);
    EXPECT_EQ(learned.best, 1U);
    const std::vector<double> found = rms_um(learned);
    // 0.0221: of the linear plant, the limit of learning with this Q (reference).
    EXPECT_LT(found[1], friction > 0.0 ? 0.1 : 0.0225) << friction;
  }
}

}  // namespace
}  // namespace servotwin
