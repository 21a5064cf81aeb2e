// Learning on an axis of two masses, against a machine that is integrated in steps of 2 us
// (tests/support/two_mass_machine.h).
#include <gtest/gtest.h>

#include <cmath>
#include <complex>
#include <numbers>

#include "ilc/feedforward.h"
#include "ilc/model_uncertainty.h"
#include "ilc/prepared_axis.h"
#include "ilc/uncertainty.h"
#include "tests/ilc/study.h"
#include "tests/support/two_mass_machine.h"
#include "twin/hold.h"

namespace servotwin {
namespace {

using test::Cascade;
using test::integrated;
using test::model_of;
using test::Setpoint;
using test::TwoBodies;
using Complex = std::complex<double>;

constexpr double kCycle_s = 1e-3;
constexpr std::array kEveryEncoder{Encoders::kMotor, Encoders::kLoad, Encoders::kOutside};

/// The part of `errors` at this frequency in their last second, which holds whole periods.
Complex part_at(const std::vector<double>& errors, double omega) {
  Complex sum = 0.0;
  for (std::size_t k = errors.size() - 1000; k < errors.size(); ++k)
    sum += errors[k] * std::polar(1.0, -omega * kCycle_s * static_cast<double>(k));
  return sum / 500.0;  // 1 of cos(omega t)
}

/// Friction that is viscous: 4 and 9 1/s on motor and load.
TwoBodies viscous(Encoders encoders) {
  TwoBodies axis;
  axis.encoders = encoders;
  axis.friction_velocity = 1e3;
  axis.motor_friction = 4e3;
  axis.load_friction = 9e3;
  return axis;
}

Transfer transfer_with_friction(const Cascade& drive, const TwoBodies& axis) {
  Model model = model_of(drive, axis, kCycle_s);
  model.effects[0].coefficient = {
      0.0, (axis.motor_friction + axis.load_friction) / axis.friction_velocity};
  return transfer_of(model);
}

TEST(TwoMassTransfer, IsTheMachinesByCommandAndByForces) {
  for (const Encoders encoders : kEveryEncoder) {
    for (const double reset : {60.0, 0.0}) {
      Cascade drive;
      drive.reset = reset;
      const TwoBodies axis = viscous(encoders);
      const Transfer transfer = transfer_with_friction(drive, axis);
      for (const double f : {3.0, 42.0, 130.0}) {
        const double w = 2.0 * std::numbers::pi * f;
        const auto wave = [w](double t) { return std::cos(w * t); };
        const auto command = [w](double t) {
          return Setpoint{std::cos(w * t), -w * std::sin(w * t), -w * w * std::cos(w * t)};
        };
        const auto still = [](double) { return Setpoint(); };
        TwoBodies pushed = axis, pulled = axis;
        pushed.motor_force = wave;
        pulled.load_force = wave;
        const Complex t = 1.0 - part_at(integrated(drive, axis, kCycle_s, 3000, command), w);
        EXPECT_LT(std::abs(t - transfer.at(w)), 2e-4 * std::abs(t)) << f << ", reset " << reset;
        const Complex motor = part_at(integrated(drive, pushed, kCycle_s, 3000, still), w);
        EXPECT_LT(std::abs(motor - transfer.compliance_at(w)), 2e-4 * std::abs(motor)) << f;
        const Complex load = part_at(integrated(drive, pulled, kCycle_s, 3000, still), w);
        EXPECT_LT(std::abs(load - transfer.load_compliance_at(w)), 2e-4 * std::abs(load)) << f;
      }
      EXPECT_EQ(transfer.at(0.0), 1.0);
    }
  }
}

// A command of one sample, straight between the samples; without acceleration feed-forward, which
// would need its second derivative.
TEST(TwoMassTransfer, HasTheMachinesImpulseResponse) {
  for (const Encoders encoders : kEveryEncoder) {
    for (const double reset : {60.0, 0.0}) {
      Cascade drive;
      drive.reset = reset;
      drive.acceleration_feedforward = 0.0;
      const TwoBodies axis = viscous(encoders);
      const Eigen::ArrayXd found =
          impulse_response(transfer_with_friction(drive, axis), kCycle_s, 200);
      const auto peak = [](double t) {
        const double at = t / kCycle_s - 1.0;
        if (std::abs(at) >= 1.0) return Setpoint();
        return Setpoint{1.0 - std::abs(at), (at < 0.0 ? 1.0 : -1.0) / kCycle_s, 0.0};
      };
      const std::vector<double> errors = integrated(drive, axis, kCycle_s, 201, peak);
      for (Eigen::Index k = 0; k < found.size(); ++k) {
        const double x = (k == 0 ? 1.0 : 0.0) - errors[static_cast<std::size_t>(k) + 1];
        ASSERT_NEAR(found(k), x, 1e-4 * found.abs().maxCoeff()) << k;
      }
    }
  }
}

/// A drive whose table swings at 45 Hz; without feed-forward of the velocity it lags.
Cascade swinging() {
  Cascade drive;
  drive.position_gain = 30.0;
  drive.velocity_gain = 250.0;
  drive.reset = 20.0;
  return drive;
}

TwoBodies table(Encoders encoders) {
  TwoBodies axis;
  axis.encoders = encoders;
  axis.zeta = 0.04;
  axis.load_share = 0.4;
  axis.motor_friction = 0.1;
  axis.load_friction = 0.2;
  return axis;
}

Plant machine_of(const Cascade& drive, const TwoBodies& axis) {
  return [=](const std::vector<Eigen::ArrayXd>& commands) {
    const Spline spline = Spline::through(commands[0], kCycle_s);
    const auto at = [&](double t) {
      const auto k = std::min(static_cast<Eigen::Index>(t / kCycle_s), commands[0].size() - 1);
      const double s = t - kCycle_s * static_cast<double>(k);
      const double a = spline.second(k), j = spline.third(k), v = spline.first(k);
      return Setpoint{spline.value(k) + s * (v + s * (a / 2 + s * j / 6)), v + s * (a + s * j / 2),
                      a + s * j};
    };
    const std::vector<double> errors =
        integrated(drive, axis, kCycle_s, static_cast<std::size_t>(commands[0].size()), at);
    return std::vector<Eigen::ArrayXd>{
        commands[0] - Eigen::Map<const Eigen::ArrayXd>(errors.data(), commands[0].size())};
  };
}

struct LearnedOn {
  PreparedAxis prepared;
  double feedforward_um = 0.0, after_um = 0.0;
};
LearnedOn learned_on(const Model& model, const Plant& machine) {
  virtual_machine::Trajectory motion;
  motion.dwell(0.2);
  for (const double target : {0.01, 0.0, 0.01, 0.0}) {
    motion.move_to(target, {0.15, 3.0, 300.0});
    motion.dwell(0.1);
  }
  motion.dwell(0.4);
  CorrectionWish wish;
  wish.uncertainty_share = 0.05;
  LearnedOn out{prepared_axis("X", false, model, {}, study::sampled(motion, kCycle_s), wish)};
  const Learned learned = learn({out.prepared.learning}, machine);
  out.after_um = study::rms_um(learned)[learned.best];
  LearnOptions once;
  once.feedforward_only = true;
  out.feedforward_um = study::rms_um(learn({out.prepared.learning}, machine, once)).back();
  return out;
}

// The rigid loop that belongs to the two masses misses their resonance: with its law the iteration
// would diverge at the spring's frequency, though the models within its uncertainty converge.
TEST(TwoMassLearning, IsBetterThanWithTheRigidLoopAndConvergesOnTheMachine) {
  for (const Encoders encoders : kEveryEncoder) {
    const Cascade drive = swinging();
    const TwoBodies axis = table(encoders);
    const Model two = model_of(drive, axis, kCycle_s);
    Model rigid = two;
    rigid.effects.pop_back();
    const Plant machine = machine_of(drive, axis);
    const LearnedOn with = learned_on(two, machine), without = learned_on(rigid, machine);
    const std::vector<Transfer> truth{transfer_of(two)};
    const auto most_on_machine = [&](const LearnedOn& one) {
      return contraction(one.prepared.learning.law, truth, kCycle_s).most();
    };
    EXPECT_LT(most_on_machine(with), kContraction);
    EXPECT_GT(most_on_machine(without), 1.0);
    // A motor's encoder hardly sees what the load does, whose own resonance bounds the bandwidth.
    const double less = encoders == Encoders::kMotor ? 0.8 : 0.05;
    EXPECT_LT(with.after_um, less * without.after_um);
    EXPECT_LT(with.feedforward_um, less * without.feedforward_um);
  }
}

// Encoders at the load of a soft spring: some models within 20 % would shake themselves.
TEST(TwoMassUncertainty, MovesTheSpringAndLeavesEveryModelStable) {
  TwoBodies axis = table(Encoders::kLoad);
  axis.frequency_hz = 20.0;
  const Transfer transfer = transfer_of(model_of(swinging(), axis, kCycle_s));
  const std::vector<Transfer> models = models_within(transfer, relative_uncertainty(transfer, 0.2));
  double slowest = 1e9, fastest = 0.0;
  for (const Transfer& one : models) {
    EXPECT_TRUE(stable(one.loop, *one.two_masses));
    EXPECT_NEAR(std::abs(one.at(1e-6) - 1.0), 0.0, 1e-6);
    slowest = std::min(slowest, one.two_masses->omega);
    fastest = std::max(fastest, one.two_masses->omega);
  }
  EXPECT_NEAR(fastest, 1.4 * transfer.two_masses->omega, 1e-9);
  EXPECT_LT(slowest, 0.95 * transfer.two_masses->omega);
}

TEST(TwoMassUncertainty, IsTheStatedOneOrAShareOfWhatIsNotStated) {
  const Transfer transfer = transfer_of(model_of(swinging(), table(Encoders::kLoad), kCycle_s));
  StatedDeviations stated;
  stated.poles = {1.0, 1.0, 0.01};
  stated.two_masses = {2.0, std::nan(""), 0.01, 0.5};
  stated.holdout_over_training = 3.0;
  const ModelUncertainty found = uncertainty_of(stated, transfer, kCycle_s);
  const TwoMassDeviations& two = found.of_transfer.two_masses;
  EXPECT_DOUBLE_EQ(two.omega, 6.0);
  EXPECT_DOUBLE_EQ(two.load_share, 0.03);
  EXPECT_DOUBLE_EQ(two.reset, 1.5);
  EXPECT_DOUBLE_EQ(found.of_transfer.deviations * two.zeta, 0.05 * 0.04);
  EXPECT_NE(found.words.find("5 % of each parameter of its two masses"), std::string::npos);
}

}  // namespace
}  // namespace servotwin
