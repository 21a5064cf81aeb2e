// Force fit: the published figures of a real axis, and the published friction of two rigs recovered
// from what the independent virtual machine recorded.
#include "identification/torque/force_fit.h"

#include <gtest/gtest.h>

#include <cmath>

#include "drivers/recordings/recording_file.h"
#include "identification/recording/segments.h"
#include "identification/torque/friction_from_torque.h"
#include "tests/support/real_data.h"
#include "tests/virtual_machine/friction_rigs.h"

namespace servotwin {
namespace {

namespace vm = virtual_machine;

std::vector<Segment> emps(const std::filesystem::path& file) {
  constexpr double kNewtonPerVolt = 35.15065188;  // the benchmark's
  ReadOptions read;
  read.columns = "X.command=qg[m],X.actual=qm[m],X.torque=vir[V]";
  auto segments = segment_axis(read_recording(file, read), "X").segments;
  for (Segment& s : segments) s.torque *= kNewtonPerVolt;
  return segments;
}

Segment part(const Segment& s, Eigen::Index from, Eigen::Index count) {
  Segment out;
  out.sample_time_s = s.sample_time_s;
  out.start_s = s.start_s + s.sample_time_s * static_cast<double>(from);
  out.command = s.command.segment(from, count);
  out.actual = s.actual.segment(from, count);
  out.torque = s.torque.segment(from, count);
  return out;
}

Segment segment_of(const vm::AxisRecord& record, double force_per_torque) {
  Segment out;
  out.sample_time_s = record.sample_time;
  out.command = record.command;
  out.actual = record.actual;
  out.torque = record.torque * force_per_torque;
  return out;
}

/// A search that is short enough for a test.
ForceFitOptions brief() {
  ForceFitOptions options;
  options.evaluations = 40;
  return options;
}

ForceFitOptions sign_of_velocity(std::size_t shapes) {
  ForceFitOptions options;
  options.shapes = std::vector<double>(shapes, 1e-9);  // so narrow a ramp is a sign
  return options;
}

// Janot, Gautier, Brunot 2019: M 95.1089 kg, Fv 203.5034, Fc 20.3935, offset -3.1648, error 4.0834
// %. Their script keeps the last 50 samples, at rest; ours leaves them out at both ends.
TEST(ForceFit, ReproducesThePublishedSymmetricModelOfEmps) {
  SERVOTWIN_REAL_DATA(file, "emps/DATA_EMPS.mat");
  const auto fit = fit_force(ForceData::of_motion(emps(file)),
                             {true, {kind_of<CoulombFriction>(), kind_of<ConstantForce>()}},
                             sign_of_velocity(1));
  ASSERT_TRUE(fit);
  EXPECT_NEAR(fit->model.mass, 95.1089, 0.02);
  EXPECT_NEAR(fit->model.effects[0].coefficient[1], 203.5034, 0.2);
  EXPECT_NEAR(fit->model.effects[0].coefficient[0], 20.3935, 0.03);
  EXPECT_NEAR(fit->model.effects[1].coefficient[0], -3.1648, 0.02);
  EXPECT_NEAR(100.0 * fit->error.relative, 4.0834, 0.06);
}

// Fv 166.7061 and 240.4236, Fc 20.1440 and 20.6277, error 3.1117 %.
TEST(ForceFit, ReproducesThePublishedAsymmetricModelOfEmps) {
  SERVOTWIN_REAL_DATA(file, "emps/DATA_EMPS.mat");
  const auto fit = fit_force(ForceData::of_motion(emps(file)),
                             {true, {kind_of<CoulombFriction>(), kind_of<AsymmetricFriction>()}},
                             sign_of_velocity(2));
  ASSERT_TRUE(fit);
  const auto& symmetric = fit->model.effects[0].coefficient;
  const auto& difference = fit->model.effects[1].coefficient;
  EXPECT_NEAR(fit->model.mass, 95.1540, 0.02);
  EXPECT_NEAR(symmetric[1] + difference[1], 166.7061, 0.2);
  EXPECT_NEAR(symmetric[1] - difference[1], 240.4236, 0.3);
  EXPECT_NEAR(symmetric[0] + difference[0], 20.1440, 0.03);
  EXPECT_NEAR(symmetric[0] - difference[0], 20.6277, 0.03);
  EXPECT_NEAR(100.0 * fit->error.relative, 3.1117, 0.06);
}

// Fitted on the first half, validated on the second, with the same filters.
TEST(ForceFit, PredictsTheUnseenHalfOfEmpsBetterThanThePublishedModels) {
  SERVOTWIN_REAL_DATA(file, "emps/DATA_EMPS.mat");
  const Segment whole = emps(file).front();
  const Eigen::Index half = whole.size() / 2;
  const ForceData first = ForceData::of_motion({part(whole, 0, half)});
  const ForceData second = ForceData::of_motion({part(whole, half, whole.size() - half)});
  const auto unseen = [&](const std::vector<std::size_t>& effects, const ForceFitOptions& options) {
    const auto fit = fit_force(first, {true, effects}, options);
    return fit ? judge(fit->model, second).relative : kAbsent;
  };
  const double published =
      unseen({kind_of<CoulombFriction>(), kind_of<AsymmetricFriction>()}, sign_of_velocity(2));
  EXPECT_NEAR(100.0 * published, 3.09, 0.05);
  EXPECT_LT(unseen({kind_of<Stribeck>()}, brief()), 0.95 * published);
}

// The drive of paper 002: inertia and all six LuGre parameters of its table 1.
TEST(ForceFit, RecoversTheLuGreParametersOfTheFeedDrive) {
  const vm::Axis axis = vm::cover_rig_axis(false);
  const auto motion = vm::cover_rig_motion(1, 0.05, 0.4, 2);
  const Segment segment =
      segment_of(vm::record(axis, motion.command(), motion.duration()), 1.0 / axis.transmission);
  const auto fit = fit_force(ForceData::of_motion({segment}, 0.0, 8),
                             {true, {kind_of<LuGre>(), kind_of<ConstantForce>()}}, brief());
  ASSERT_TRUE(fit);
  const Effect& lugre = fit->model.effects[0];
  const double coulomb = lugre.coefficient[0], stiffness = coulomb / lugre.shape[0];
  EXPECT_NEAR(fit->model.mass, axis.body.mass, 0.002 * axis.body.mass);
  EXPECT_NEAR(coulomb, 163.0, 0.5);
  EXPECT_NEAR(lugre.coefficient[1], 530.0, 3.0);
  EXPECT_NEAR(coulomb * lugre.shape[1], 200.0, 4.0);
  EXPECT_NEAR(lugre.shape[2], 2.53e-3, 0.15e-3);
  EXPECT_NEAR(stiffness, 9.37e6, 0.05 * 9.37e6);                   // within a record of 1 ms
  EXPECT_NEAR(stiffness * lugre.shape[4], 4.45e4, 0.05 * 4.45e4);  // likewise
  EXPECT_NEAR(fit->model.effects[1].coefficient[0], 0.0, 0.1);
}

// The telescopic cover, with the drive's parameters held at their values without it.
TEST(LongForceFit, RecoversTheAddedFrictionOfTheCover) {
  const auto data_of = [](bool covered, std::uint64_t seed) {
    const vm::Axis axis = vm::cover_rig_axis(covered);
    const auto motion = vm::cover_rig_motion(seed, 0.05, 0.4, 2);
    return ForceData::of_motion({segment_of(vm::record(axis, motion.command(), motion.duration()),
                                            1.0 / axis.transmission)},
                                0.0, 8);
  };
  const auto drive =
      fit_force(data_of(false, 1), {true, {kind_of<LuGre>(), kind_of<ConstantForce>()}}, brief());
  ASSERT_TRUE(drive);
  const ForceData covered = data_of(true, 2);
  const auto cover =
      fit_force(covered, {true, {kind_of<LuGre>()}}, brief(), force_of(drive->model, covered));
  ASSERT_TRUE(cover);
  const Effect& lugre = cover->model.effects[0];
  EXPECT_NEAR(cover->model.mass, 0.0, 0.3);  // the virtual cover has no mass
  EXPECT_NEAR(lugre.coefficient[0], 106.0, 0.5);
  EXPECT_NEAR(lugre.coefficient[1], 86.2, 2.0);
  EXPECT_NEAR(lugre.coefficient[0] * lugre.shape[1], 49.6, 10.0);  // seen in few samples
  EXPECT_NEAR(lugre.coefficient[0] / lugre.shape[0], 1.92e6, 0.08 * 1.92e6);
  // The share of the steady torque, against the table's own.
  for (const double v : {0.05, 0.2, 0.4, -0.05, -0.4}) {
    const double part_of_it = steady_force(cover->model, v);
    const double share = part_of_it / (part_of_it + steady_force(drive->model, v));
    const double truth = vm::steady_force(vm::cover_rig_friction().cover, v) /
                         vm::steady_force(vm::cover_rig_friction(), v);
    EXPECT_NEAR(share, truth, 0.005) << v;
  }
}

TEST(ForceFit, NeedsATorque) {
  Segment s;
  s.sample_time_s = 1e-3;
  s.command = s.actual = Eigen::ArrayXd::LinSpaced(2000, 0.0, 0.1);
  EXPECT_THROW((void)ForceData::of_motion({s}), std::runtime_error);
  EXPECT_THROW((void)ForceData::of_motion({}), std::runtime_error);
}

// A torque with gaps is used where it exists; slow rows can be left out.
TEST(ForceFit, UsesWhatIsThereAndLeavesOutWhatIsSlow) {
  Segment s;
  s.sample_time_s = 1e-3;
  const Eigen::Index n = 8000;
  const Eigen::ArrayXd t = 1e-3 * Eigen::ArrayXd::LinSpaced(n, 0.0, n - 1.0);
  const double omega = 5.0;
  s.command = s.actual = 0.05 * (1.0 - (omega * t).cos());
  const Eigen::ArrayXd velocity = 0.05 * omega * (omega * t).sin();
  const Eigen::ArrayXd acceleration = 0.05 * omega * omega * (omega * t).cos();
  // At low speed the torque is something else entirely.
  s.torque = (velocity.abs() < 0.05)
                 .select(1e3, 12.0 * acceleration + 30.0 * velocity.sign() + 40.0 * velocity);
  s.torque.segment(3000, 500).setConstant(kAbsent);
  const ForceData data = ForceData::of_motion({s}, 0.0);
  EXPECT_EQ(data.stretches().size(), 2U);
  EXPECT_EQ(data.rows(), n - 500);
  ForceFitOptions options = sign_of_velocity(1);
  options.least_speed = 0.06;
  const auto fit = fit_force(data, {true, {kind_of<CoulombFriction>()}}, options);
  ASSERT_TRUE(fit);
  EXPECT_NEAR(fit->model.mass, 12.0, 1e-3);
  EXPECT_NEAR(fit->model.effects[0].coefficient[0], 30.0, 1e-3);
  EXPECT_NEAR(fit->model.effects[0].coefficient[1], 40.0, 1e-2);
}

}  // namespace
}  // namespace servotwin
