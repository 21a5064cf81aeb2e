// The feed axis from its parts. Numbers are from the project's reference study, an independent
// Python implementation (docs/theory.md 7 and 15), or closed forms.
#include "twin/feed_axis/feed_axis.h"

#include <gtest/gtest.h>

#include <cmath>
#include <complex>
#include <numbers>

#include "twin/feed_axis/reversing_motion.h"
#include "twin/feed_axis/velocity_loop.h"

namespace servotwin {
namespace {

constexpr double kRadius = 0.032 / (2.0 * std::numbers::pi);
constexpr double kInertia = 0.004177060429152165;  // of everything, at the motor

/// The rig of paper 002; the control is the reference study's.
FeedAxisParts rig() {
  FeedAxisParts parts;
  parts.screw = {.diameter = 0.032,
                 .lead = 0.032,
                 .length = 0.85,
                 .end_diameter = 0.025,
                 .end_length = 0.112,
                 .axial = {1.0, 5e-6},
                 .torsional = {1.0, 5e-6}};
  parts.bearing = {19e8, 3.8e4};
  parts.coupling = {{17800.0, 0.36}, 114e-6};
  parts.nut = {{3e8, 6e3}, 0.20, 0.65, 0.22};
  parts.motor_inertia = 593e-6;
  parts.table_mass = 106.0;
  parts.control.position_gain = 60.0;
  parts.control.velocity_gain = kInertia * 2.0 * std::numbers::pi * 60.0;
  parts.control.reset_time = 0.01;
  parts.friction = LuGreParts{200.0, 163.0, 2.53e-3, 9.37e6, 4.45e4, 530.0};
  return parts;
}

LuGreParts cover() { return {49.6, 106.0, 5.3e-4, 1.92e6, 5.78e3, 86.2}; }

/// The reference study's motion: velocities summed up, so that it is this to the last digit.
Eigen::ArrayXd reference_motion() {
  constexpr double kRate = 16000.0;
  std::vector<double> acceleration;
  for (const double sign : {1.0, -1.0}) {
    for (const auto& [seconds, level] : {std::pair{0.02, 10.0},
                                         {0.06, 0.0},
                                         {0.02, 10.0},
                                         {0.1, 0.0},
                                         {0.02, -10.0},
                                         {0.06, 0.0},
                                         {0.02, -10.0},
                                         {0.2, 0.0}})
      acceleration.insert(acceleration.end(), std::lround(seconds * kRate), sign * level);
  }
  Eigen::ArrayXd out(static_cast<Eigen::Index>(acceleration.size()));
  double velocity = 0.0, position = 0.0;
  for (Eigen::Index k = 0; k < out.size(); ++k) {
    velocity += acceleration[k] / kRate;
    position += velocity / kRate;
    out(k) = position;
  }
  return out;
}

/// The reference's motion is one step on where it begins.
template <class Mechanics>
FeedAxisRun run_from_0(FeedAxis<Mechanics>& axis, const Eigen::ArrayXd& command) {
  FeedAxisRun out{.torque = command,
                  .motor_position = {},
                  .table_position = command,
                  .friction = {},
                  .cover = {}};
  axis.start(0.0);
  for (Eigen::Index k = 0; k < command.size(); ++k) {
    const FeedAxisSample sample = axis.step(command(k));
    out.torque(k) = sample.torque;
    out.table_position(k) = sample.table_position;
  }
  return out;
}

double rms(const Eigen::ArrayXd& values) { return std::sqrt(values.square().mean()); }

struct Modes {
  double nut;
  std::array<double, 6> remeshed, fixed16, fixed64;
  double highest_remeshed, highest_fixed16;
};

TEST(BallScrew, ModesAreThoseOfTheReference) {
  const Modes all[] = {{0.225,
                        {334.44684212109667, 798.2387109205144, 1549.947677218077,
                         2061.523000531445, 3510.809087656826, 4506.010164769615},
                        {336.66207928323297, 797.8048372721388, 1547.6358339868302,
                         2050.7646634674584, 3439.0605025463683, 4412.075562930827},
                        {334.59537279409943, 797.1761763536806, 1544.4602680078492,
                         2046.8083144055663, 3428.8993999813533, 4392.932544256861},
                        50464.780411351334,
                        54469.7644431789},
                       {0.425,
                        {299.7148460427308, 809.6454913749695, 1800.080588789698,
                         1993.3424293918933, 3503.2589752821023, 4291.216685306036},
                        {299.7073920050406, 809.2172020106669, 1796.8429549145735,
                         1984.6773511895208, 3472.6705319093026, 4251.136647381493},
                        {299.70506196236073, 809.0834375822915, 1795.832627997394,
                         1981.9661263663443, 3462.7240560097835, 4238.6898213740005},
                        28283.182653174703,
                        54465.3251864685},
                       {0.625,
                        {272.60183539323367, 812.8803618379918, 1870.8804426455783,
                         2174.7680738726854, 3480.5941707819684, 4285.709355242854},
                        {273.79439960367193, 812.6252961259611, 1865.302744049952,
                         2171.6419130907534, 3429.6053238684854, 4225.723287197481},
                        {272.68068684154736, 812.12002980542, 1860.3910422529916, 2161.961470526571,
                         3419.6717007701777, 4212.702743067772},
                        48329.12214930006,
                        54454.282574544915}};
  FeedAxisParts fine = rig();
  fine.screw.elements = 64;
  const auto expect = [](const Eigen::VectorXd& got, const std::array<double, 6>& want) {
    EXPECT_LT(got(0), 0.01);  // the rigid motion
    for (Eigen::Index i = 0; i < 6; ++i) EXPECT_NEAR(got(i + 1), want[i], 1e-6 * want[i]) << i;
  };
  for (const Modes& modes : all) {
    SCOPED_TRACE(modes.nut);
    const Eigen::VectorXd remeshed =
                              mode_frequencies(BallScrew::remeshed(rig(), modes.nut), modes.nut),
                          fixed = mode_frequencies(BallScrew(rig()), modes.nut);
    expect(remeshed, modes.remeshed);
    expect(fixed, modes.fixed16);
    expect(mode_frequencies(BallScrew(fine), modes.nut), modes.fixed64);
    EXPECT_NEAR(remeshed.maxCoeff(), modes.highest_remeshed, 1e-6 * modes.highest_remeshed);
    EXPECT_NEAR(fixed.maxCoeff(), modes.highest_fixed16, 1e-6 * modes.highest_fixed16);
  }
}

TEST(BallScrew, StaticStiffnessIsItsSpringsInSeries) {
  const FeedAxisParts parts = rig();
  const double area = std::numbers::pi * 0.032 * 0.032 / 4.0,
               thread = std::numbers::pi * std::pow(0.032, 4) / 32.0,
               end = std::numbers::pi * std::pow(0.025, 4) / 32.0, e = 2.1e11, g = 8.1e10;
  for (const double nut : {0.2125, 0.425, 0.6375}) {  // on nodes: an element is straight between
    const double series =
        1.0 / 19e8 + nut / (e * area) + 1.0 / 3e8 +
        kRadius * kRadius * (1.0 / 17800.0 + 0.112 / (g * end) + nut / (g * thread));
    EXPECT_NEAR(static_stiffness(BallScrew(parts), nut) * series, 1.0, 1e-9) << nut;
    EXPECT_NEAR(static_stiffness(BallScrew::remeshed(parts, nut), nut) * series, 1.0, 1e-9) << nut;
  }
}

TEST(BallScrew, MovesRigidlyWithoutForceAndWithAllItsInertia) {
  FeedAxisParts parts = rig();
  parts.added_mass = AddedMass{38.0, {1e9, 0.0}};
  const BallScrew screw(parts);
  const double most = screw.stiffness_at(0.3).norm() * screw.rigid.norm();
  EXPECT_LT((screw.stiffness_at(0.3) * screw.rigid).norm(), 1e-12 * most);
  const double mass = screw.rigid.dot(screw.mass * screw.rigid);
  EXPECT_NEAR(mass * kRadius * kRadius, kInertia + 38.0 * kRadius * kRadius, 1e-9 * kInertia);
}

TEST(BallScrew, AnAddedMassOnAStiffSpringIsAHeavierTable) {
  FeedAxisParts heavy = rig(), added = rig();
  heavy.table_mass = 144.0;
  added.added_mass = AddedMass{38.0, {1e13, 0.0}};
  const Eigen::VectorXd one = mode_frequencies(BallScrew(heavy), 0.4),
                        other = mode_frequencies(BallScrew(added), 0.4);
  for (Eigen::Index i = 1; i < 5; ++i) EXPECT_NEAR(other(i), one(i), 1e-4 * one(i)) << i;
  EXPECT_GT(std::abs(mode_frequencies(BallScrew(rig()), 0.4)(1) - one(1)), 10.0);
}

TEST(BallScrew, TheSameInOtherCoordinates) {
  const BallScrew screw(rig());
  const Eigen::MatrixXd basis = modal_basis(screw, 0.2, 0.65, 3);
  const BallScrew reduced = screw.in(basis);
  EXPECT_TRUE(reduced.mass.isIdentity(1e-9));
  EXPECT_LT(reduced.size(), 20);
  const Eigen::VectorXd full = mode_frequencies(screw, 0.425),
                        few = mode_frequencies(reduced, 0.425);
  for (Eigen::Index i = 1; i < 4; ++i) EXPECT_NEAR(few(i), full(i), 1e-8 * full(i)) << i;
}

struct At {
  Eigen::Index k;
  double torque, table;
};

TEST(FeedAxis, InFullIsTheReference) {
  FullAxis axis = full_axis(rig());
  const FeedAxisRun got = run_from_0(axis, reference_motion());
  EXPECT_NEAR(got.torque.abs().maxCoeff(), 7.909422018651382, 1e-6);
  for (const auto& [k, torque, table] : {At{800, 2.0942776461369226, 0.005027011363033839},
                                         {1600, 7.828238821787811, 0.015232459137387255},
                                         {3200, 1.9850358254504457, 0.05337647748648261},
                                         {5000, -1.6713112598722843, 0.0791194698774685},
                                         {8000, 0.9637902959430201, 0.07999824873057322}}) {
    EXPECT_NEAR(got.torque(k), torque, 1e-6) << k;
    EXPECT_NEAR(got.table_position(k), table, 1e-9) << k;
  }
}

TEST(FeedAxis, TheCoverTakesWhatItTakesInTheReference) {
  FeedAxisParts parts = rig();
  parts.cover = cover();
  constexpr auto kSteady = static_cast<Eigen::Index>((0.02 + 0.06 + 0.02 + 0.09) * 16000.0);
  FullAxis bare = full_axis(rig()), covered = full_axis(parts);
  EXPECT_NEAR(run_from_0(bare, reference_motion()).torque(kSteady), 1.9982618028247285, 1e-6);
  EXPECT_NEAR(run_from_0(covered, reference_motion()).torque(kSteady), 2.713256125816591, 1e-6);
}

TEST(FeedAxis, SteadyFrictionIsThatOfTable1) {
  for (const auto& [speed, drive, part] : {std::tuple{0.05, 189.50000009667338, 110.31},
                                           {0.2, 269.0, 123.24000000000001},
                                           {0.4, 375.0, 140.48000000000002}}) {
    EXPECT_NEAR(steady_force(*rig().friction, speed), drive, 1e-9 * drive);
    EXPECT_NEAR(steady_force(cover(), speed), part, 1e-9 * part);
  }
  // Long after a start the bristle has the steady force.
  for (const LuGreParts& parts : {*rig().friction, cover()}) {
    TableFriction friction(parts, 1e-3);
    double force = 0.0;
    for (int k = 0; k < 1000; ++k) force = friction.step(-3e-3);
    EXPECT_NEAR(force, -steady_force(parts, 3e-3), 1e-9 * std::abs(force));
  }
}

// What is left is that the nut stands at places of the grid; between them the full one
// interpolates.
TEST(FeedAxis, ReducedItStaysTheAxis) {
  const Eigen::ArrayXd command = reference_motion();
  FeedAxisParts parts = rig();
  parts.cover = cover();
  FullAxis full = full_axis(parts);
  ReducedAxis reduced = reduced_axis(parts), fine = reduced_axis(parts, {5e-4, 3});
  const FeedAxisRun want = run_from_0(full, command), got = run_from_0(reduced, command),
                    finer = run_from_0(fine, command);
  EXPECT_LT(rms(got.torque - want.torque), 1e-3);  // of 2.6 RMS
  EXPECT_LT((got.table_position - want.table_position).abs().maxCoeff(), 0.1e-6);
  EXPECT_LT(rms(finer.torque - want.torque), 0.6 * rms(got.torque - want.torque));
}

TEST(FeedAxis, InAllItsModesAndOnThePlaceItIsTheFullOne) {
  FeedAxisParts parts = rig();
  parts.screw.elements = 4;
  parts.nut.at_zero = 0.30;  // a place of both grids
  const Eigen::ArrayXd command = 1e-4 * Eigen::ArrayXd::LinSpaced(800, 0.0, 20.0).sin();
  FullAxis full = full_axis(parts, {0.05});
  ReducedAxis reduced = reduced_axis(parts, {0.05, 99});
  const FeedAxisRun want = run_from_0(full, command), got = run_from_0(reduced, command);
  EXPECT_GT(want.torque.abs().maxCoeff(), 1.0);
  EXPECT_LT((got.torque - want.torque).abs().maxCoeff(), 1e-4);
}

TEST(FeedAxis, StandsWhereItIsStarted) {
  ReducedAxis axis = reduced_axis(rig());
  axis.start(0.1);
  for (int k = 0; k < 100; ++k) {
    const FeedAxisSample sample = axis.step(0.1);
    EXPECT_EQ(sample.torque, 0.0);
    EXPECT_EQ(sample.table_position, 0.1);
  }
}

/// The amplitude of a motion at a frequency, over whole periods at the end.
std::complex<double> amplitude(const Eigen::ArrayXd& signal, double hz, double rate,
                               Eigen::Index last) {
  std::complex<double> sum = 0.0;
  for (Eigen::Index k = signal.size() - last; k < signal.size(); ++k)
    sum += signal(k) * std::polar(2.0 / static_cast<double>(last),
                                  -2.0 * std::numbers::pi * hz * static_cast<double>(k) / rate);
  return sum;
}

TEST(VelocityLoop, AnswersAsTheSimulatedAxisDoes) {
  FeedAxisParts parts = rig();
  parts.friction.reset();
  parts.nut.at_zero = 0.425;
  parts.control.low_pass_hz = 900.0;
  parts.control.band_stops = {{800.0, 200.0, 40.0}};
  const double rate = parts.control.rate_hz;
  for (const double hz : {20.0, 50.0, 160.0, 320.0}) {
    FullAxis axis = full_axis(parts, {0.075});
    constexpr Eigen::Index kSamples = 80000, kLast = 16000;
    Eigen::ArrayXd asked(kSamples), moved(kSamples);
    axis.start(0.0);
    for (Eigen::Index k = 0; k < kSamples; ++k) {
      const double command =
          1e-6 * std::sin(2.0 * std::numbers::pi * hz * static_cast<double>(k) / rate);
      const FeedAxisSample sample = axis.step(command);
      asked(k) = parts.control.position_gain * (command - sample.motor_position);
      moved(k) = sample.motor_velocity;
    }
    const std::complex<double> closed = amplitude(moved, hz, rate, kLast) /
                                        amplitude(asked, hz, rate, kLast),
                               want = closed_velocity_loop(parts, 0.425,
                                                           Eigen::ArrayXd::Constant(1, hz))(0);
    EXPECT_LT(std::abs(closed - want), 1e-6 * std::abs(want)) << hz << closed << want;
  }
}

TEST(VelocityLoop, OfARigidAxisIsThePaperAndPencilOne) {
  FeedAxisParts parts = rig();
  parts.screw.axial = parts.screw.torsional = {};
  parts.control.current_loop_hz = 1e5;
  // Well below the modes it is a mass: L = K (1 + 1 / (s T)) / (J s).
  const Eigen::ArrayXd f = logarithmic(2.0, 15.0, 5);
  const Eigen::ArrayXcd got = closed_velocity_loop(parts, 0.425, f);
  for (Eigen::Index k = 0; k < f.size(); ++k) {
    const std::complex<double> s(0.0, 2.0 * std::numbers::pi * f(k)),
        open = parts.control.velocity_gain * (1.0 + 1.0 / (0.01 * s)) / (kInertia * s);
    EXPECT_LT(std::abs(got(k) - open / (1.0 + open)), 0.01) << f(k);
  }
}

TEST(VelocityLoop, ThatIsNotStableSaysSoAndRunsAway) {
  FeedAxisParts parts = rig();
  parts.control.low_pass_hz = 150.0;
  EXPECT_TRUE(velocity_loop_figures(parts, 0.425).stable);
  parts.control.velocity_gain *= 8.0;
  const LoopFigures figures = velocity_loop_figures(parts, 0.425);
  EXPECT_FALSE(figures.stable);
  ASSERT_TRUE(figures.gain_margin_db.has_value());
  EXPECT_LT(*figures.gain_margin_db, 0.0);
  ReducedAxis axis = reduced_axis(parts);
  Eigen::ArrayXd command = Eigen::ArrayXd::Constant(16000, 0.205);
  command(0) = 0.2049;
  EXPECT_GT(run(axis, command).torque.tail(100).abs().maxCoeff(), 1e3);
  // With the gain lowered by the margin it is at the stability limit.
  parts.control.velocity_gain *= std::pow(10.0, *figures.gain_margin_db / 20.0) * 0.99;
  EXPECT_TRUE(velocity_loop_figures(parts, 0.425).stable);
}

TEST(DriveControl, FiltersPassAndStopWhatTheyAreFor) {
  ControlParts parts;
  parts.position_gain = 1.0;
  parts.velocity_gain = 1.0;
  parts.reset_time = 1e9;
  parts.current_loop_hz = 1e9;
  const auto gain = [&](double hz) {
    const DriveControl control(parts, 1.0);
    return std::abs(
        control.linear().at(std::polar(1.0, 2.0 * std::numbers::pi * hz / parts.rate_hz)));
  };
  parts.low_pass_hz = 500.0;
  EXPECT_NEAR(gain(1e-3), 1.0, 1e-3);
  EXPECT_NEAR(gain(500.0), std::sqrt(0.5), 1e-6);
  parts.low_pass_hz.reset();
  parts.band_stops = {{700.0, 100.0, 0.0}};
  EXPECT_LT(gain(700.0), 1e-9);
  EXPECT_NEAR(gain(100.0), 1.0, 0.01);
  parts.band_stops = {{700.0, 100.0, 20.0}};
  EXPECT_NEAR(gain(700.0), 0.2, 1e-9);
}

// The step answer of K (e + 1/T_i sum e h) on L di/dt + R i = u, integrated finely by Euler's rule.
TEST(DriveControl, CurrentLoopIsPiOnResistanceAndInductance) {
  ControlParts parts;
  parts.position_gain = 1.0;
  parts.velocity_gain = 1.0;
  parts.reset_time = 1e12;
  parts.current_loop = CurrentLoopParts{1.2, 6e-3, 15.0, 5e-3};
  DriveControl control(parts, 1.0);
  const double h = 1.0 / parts.rate_hz;
  constexpr int kFine = 20000;
  double current = 0.0, integral = 0.0;
  for (int k = 0; k < 60; ++k) {
    const double got = control.step(1.0, 0.0, 0.0), error = 1.0 - current;
    integral += error * h / 5e-3;
    const double voltage = 15.0 * (error + integral), before = current;
    for (int i = 0; i < kFine; ++i) current += h / kFine * (voltage - 1.2 * current) / 6e-3;
    EXPECT_NEAR(got, (before + current) / 2.0, 1e-6) << k;
  }
  EXPECT_NEAR(current, 1.0, 0.2);
}

TEST(ReversingMotion, RisesInTwoStepsAndComesBack) {
  const ReversingMotion motion{.speed = 0.4, .travel = 0.36, .rest_s = 0.5, .cycles = 2};
  const Eigen::ArrayXd x = sampled(motion, 1000.0);
  EXPECT_NEAR(x.maxCoeff(), 0.36, 1e-12);
  EXPECT_NEAR(x.minCoeff(), 0.0, 1e-12);
  EXPECT_NEAR(x(x.size() - 1), 0.0, 1e-9);
  const Eigen::ArrayXd v = (x.tail(x.size() - 1) - x.head(x.size() - 1)) * 1000.0,
                       a = (v.tail(v.size() - 1) - v.head(v.size() - 1)) * 1000.0;
  EXPECT_NEAR(v.maxCoeff(), 0.4, 1e-9);
  EXPECT_NEAR(v(50), 0.2, 1e-9);
  EXPECT_LT(a.abs().maxCoeff(), 10.0 + 1e-6);
  // Ramps 4 x 20 ms, halves 2 x 60 ms, cruise 0.32 m / 0.4 m/s, rest 0.5 s; four ways.
  EXPECT_EQ(x.size(), 4 * (80 + 120 + 800 + 500) + 1);
  // Too short for its speed: v^2 / a + v half = travel.
  EXPECT_NEAR(sampled({.speed = 9.0, .travel = 0.04}, 1e4).maxCoeff(), 0.04, 1e-12);
  EXPECT_THROW((void)sampled({.speed = 0.0, .travel = 1.0}, 1e3), std::invalid_argument);
}

}  // namespace
}  // namespace servotwin
