#include "twin/state_space.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <complex>
#include <numbers>

#include "tests/support/two_mass_machine.h"
#include "twin/hold.h"
#include "twin/twin.h"

namespace servotwin {
namespace {

using Complex = std::complex<double>;

Loop loop_of(int order) {
  Loop loop;
  loop.order = order;
  loop.denominator = denominator_of({62.0, 2.0 * std::numbers::pi * 31.31, 0.44}, order);
  loop.numerator = order == 3 ? std::array{0.97, 230.0, 29000.0} : std::array{0.98, 120.0, 0.0};
  loop.modes = {{280.0, 0.04, -0.05, 20.0, 2e-4, 0.6}, {700.0, 0.1, 0.02, -30.0, -1e-4, 0.2}};
  return loop;
}

/// Output i by input k at s.
Eigen::MatrixXcd transfer(const StateSpace& m, Complex s) {
  const Eigen::MatrixXcd left =
      s * Eigen::MatrixXcd::Identity(m.a.rows(), m.a.cols()) - m.a.cast<Complex>();
  return m.c.cast<Complex>() * left.partialPivLu().solve(m.b.cast<Complex>()) + m.d.cast<Complex>();
}

// The transfer functions of docs/theory.md 1, at points off the axes.
TEST(StateSpace, HasTheTransferFunctionsOfTheLoop) {
  for (const int order : {2, 3}) {
    const Loop loop = loop_of(order);
    const StateSpace m = state_space(loop, 1e-3);
    for (const Complex s : {Complex(3.0, 20.0), Complex(-40.0, 300.0), Complex(500.0, -1.0)}) {
      Complex p = 1.0, numerator = 0.0;
      for (int i = 0; i < order; ++i) {
        p = p * s + loop.denominator[static_cast<std::size_t>(i)];
        numerator = numerator * s + loop.numerator[static_cast<std::size_t>(i)];
      }
      const Complex own = (order == 3 ? s : 1.0) / p;
      Complex by_velocity = numerator / p;  // e / (s x_r)
      Complex by_force = own;               // e / d
      for (const Mode& k : loop.modes) {
        const Complex mode = s * s + 2.0 * k.zeta * k.omega * s + k.omega * k.omega;
        const double held = order == 3 ? loop.denominator[2] / (k.omega * k.omega) : 0.0;
        const double slip = loop.denominator[0] - 2.0 * k.zeta * k.omega;
        by_velocity += (k.alpha * s + k.beta) / mode;
        by_force +=
            k.gamma * (s / mode - s * own - slip * own) + k.delta * (1.0 / mode - held / p - own);
      }
      const Eigen::MatrixXcd h = transfer(m, s);
      const auto expect = [&](int output, int input, Complex value) {
        EXPECT_LT(std::abs(h(output, input) - value), 1e-10 * std::abs(value))
            << "order " << order << ", output " << output << ", input " << input;
      };
      expect(0, 0, by_velocity);
      expect(0, 1, by_force);
      expect(1, 0, 1.0 / s - by_velocity);
      expect(1, 1, -by_force);
      expect(2, 0, 1.0 - s * by_velocity);
      expect(2, 1, -s * by_force);
    }
  }
}

// The discretised matrices along the spline of the command are `simulate`, whose filters are
// others.
TEST(StateSpace, StepsAsTheTwinSimulates) {
  for (const int order : {2, 3}) {
    Model model;
    model.sample_time_s = 2e-3;
    model.loop = loop_of(order);
    Segment segment;
    segment.sample_time_s = model.sample_time_s;
    segment.command = Eigen::ArrayXd::LinSpaced(2000, 0.0, 25.0).sin() * 0.03 + 0.2;
    const Eigen::ArrayXd error = simulate(model, segment);
    const Spline motion = Spline::through(segment.command, model.sample_time_s);
    const StateSpace m = state_space(model.loop, model.sample_time_s);
    Eigen::VectorXd state = Eigen::VectorXd::Zero(m.a.rows());
    state(state.size() - 1) = segment.command(0);
    for (Eigen::Index k = 0; k + 1 < segment.size(); ++k) {
      Eigen::VectorXd input(5);
      input << motion.first(k), motion.second(k), motion.third(k), 0.0, 0.0;
      state = (m.phi * state + m.g * input).eval();
      const Eigen::VectorXd out = m.c * state;
      ASSERT_NEAR(out(0), error(k + 1), 1e-12) << "order " << order << ", sample " << k;
      ASSERT_NEAR(out(1), segment.command(k + 1) - error(k + 1), 1e-12);
    }
  }
}

// A force that rises straight: its steady error without an integrator is d / a2, less a1 / a2 of
// its rate.
TEST(StateSpace, HoldsAForceThatRisesStraight) {
  Loop loop = loop_of(2);
  loop.modes.clear();
  const double h = 1e-3, rate = 0.7;
  const StateSpace m = state_space(loop, h);
  Eigen::VectorXd state = Eigen::VectorXd::Zero(3);
  const int n = 3000;
  for (int k = 0; k < n; ++k) {
    Eigen::VectorXd input = Eigen::VectorXd::Zero(5);
    input(3) = rate * k * h;
    input(4) = rate;
    state = (m.phi * state + m.g * input).eval();
  }
  const double a1 = loop.denominator[0], a2 = loop.denominator[1];
  EXPECT_NEAR(state(0), rate * (n * h - a1 / a2) / a2, 1e-15);
}

/// A cascade of drive on two bodies without friction, and its model.
struct TwoBodyDrive {
  test::Cascade drive;
  test::TwoBodies axis;
  Model model;
};
std::vector<TwoBodyDrive> two_body_drives() {
  std::vector<TwoBodyDrive> out;
  for (const Encoders encoders : {Encoders::kMotor, Encoders::kLoad, Encoders::kOutside}) {
    for (const double reset : {60.0, 0.0}) {
      TwoBodyDrive one;
      one.drive.reset = reset;
      one.axis.encoders = encoders;
      one.axis.load_friction = 0.0;
      one.model = test::model_of(one.drive, one.axis, 1e-3);
      out.push_back(one);
    }
  }
  return out;
}
StateSpace space_of(const TwoBodyDrive& one) {
  return state_space(one.model.loop, two_mass_parameters(*two_mass_of(one.model)), 1e-3);
}

// The equations of both bodies and of the cascade, at points off the axes.
TEST(StateSpace, OfTwoMassesObeysTheirEquations) {
  for (const TwoBodyDrive& one : two_body_drives()) {
    const auto [kp, kv, reset, kff, aff] = one.drive;
    const double share = one.axis.load_share, w = 2.0 * std::numbers::pi * one.axis.frequency_hz;
    const StateSpace m = space_of(one);
    for (const Complex s : {Complex(3.0, 20.0), Complex(-40.0, 300.0), Complex(500.0, -1.0)}) {
      const Eigen::MatrixXcd h = transfer(m, s);
      for (int input = 0; input < 3; ++input) {
        const Complex motor = h(3, input) / s, load = h(4, input) / s;  // positions
        const Complex command = input == 0 ? 1.0 / s : 0.0;
        const Complex loop = one.axis.encoders == Encoders::kLoad ? load : motor;
        const Complex read = one.axis.encoders == Encoders::kMotor ? motor : load;
        const Complex miss = kp * (command - loop) + kff * s * command - s * motor;
        const Complex demand = kv * miss * (1.0 + reset / s) + aff * s * s * command;
        const Complex contact = share * (w * w + 2.0 * one.axis.zeta * w * s) * (motor - load);
        const double scale = std::abs(demand) + std::abs(contact) + 1.0;
        EXPECT_LT(
            std::abs((1.0 - share) * s * s * motor - demand + contact + (input == 1 ? 1.0 : 0.0)),
            1e-10 * scale);
        EXPECT_LT(std::abs(share * s * s * load - contact + (input == 2 ? 1.0 : 0.0)),
                  1e-10 * scale);
        EXPECT_LT(std::abs(h(0, input) - command + read), 1e-10 * std::abs(command - read));
        EXPECT_LT(std::abs(h(1, input) - read), 1e-10 * std::abs(read));
        EXPECT_LT(std::abs(h(2, input) - s * read), 1e-10 * std::abs(s * read));
      }
    }
  }
}

// Discretised along a smooth command, and under forces that rise straight, against the machine.
TEST(StateSpace, OfTwoMassesStepsAsTheMachine) {
  const auto sine = [](double t) {
    const double w = 8.0, s = std::sin(w * t), c = std::cos(w * t);
    return test::Setpoint{1e-3 * s * s * s, 3e-3 * w * s * s * c,
                          1e-3 * w * w * (6.0 * s * c * c - 3.0 * s * s * s)};
  };
  for (TwoBodyDrive one : two_body_drives()) {
    one.axis.motor_force = [](double t) { return 0.7 * t; };
    one.axis.load_force = [](double t) { return -0.4 * t; };
    const StateSpace m = space_of(one);
    const std::vector<double> errors = test::integrated(one.drive, one.axis, 1e-3, 1000, sine);
    Eigen::VectorXd state = Eigen::VectorXd::Zero(m.a.rows());
    double largest = 0.0, apart = 0.0;
    for (std::size_t k = 0; k + 1 < errors.size(); ++k) {
      const double t = 1e-3 * static_cast<double>(k);
      const test::Setpoint r = sine(t), next = sine(t + 1e-3);
      Eigen::VectorXd input(7);
      input << r.v, r.a, (next.a - r.a) / 1e-3, 0.7 * t, 0.7, -0.4 * t, -0.4;
      state = (m.phi * state + m.g * input).eval();
      apart = std::max(apart, std::abs(m.c.row(0).dot(state) - errors[k + 1]));
      largest = std::max(largest, std::abs(errors[k + 1]));
    }
    EXPECT_LT(apart, 1e-5 * largest);
  }
}

}  // namespace
}  // namespace servotwin
