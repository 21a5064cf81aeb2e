// Modes of vibration that move with the commanded position.
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "twin/hold.h"
#include "twin/mode_step.h"
#include "twin/twin.h"

namespace servotwin {
namespace {

// The matrix exponential of the system augmented by its inputs, from another routine.
TEST(ModeStep, IsTheExactDiscretisation) {
  for (const double omega : {1e-2, 30.0, 280.0, 2800.0}) {
    for (const double zeta : {1e-3, 0.04, 0.6, 0.95}) {
      const double h = 1e-3, damping = 2.0 * zeta * omega, stiffness = omega * omega;
      const ModeStep step(damping, stiffness, h);
      Eigen::Matrix2d a;
      a << -damping, 1.0, -stiffness, 0.0;
      const Eigen::Vector2d b(0.7, 40.0);
      const Hold hold = discretise(a, b, h, 2);
      // Values and rates in units of the mode.
      const Eigen::Vector2d unit(1.0, std::max(1.0, omega));
      const auto expect = [&](const std::array<double, 2>& found, const Eigen::Vector2d& want) {
        const double size = (want.array() / unit.array()).abs().maxCoeff();
        for (Eigen::Index i : {0, 1})
          EXPECT_NEAR(found[static_cast<std::size_t>(i)], want(i), 2e-12 * size * unit(i))
              << "omega " << omega << ", zeta " << zeta << ", row " << i;
      };
      expect(step.times(0, 1.0, 0.0), hold.phi.col(0));
      expect(step.times(0, 0.0, unit(1)), unit(1) * hold.phi.col(1));
      double power = h;
      for (std::size_t k = 0; k < 3; ++k, power *= h) {
        const auto found = step.times(k + 1, b(0), b(1));
        expect({power * found[0], power * found[1]}, hold.g.col(static_cast<Eigen::Index>(k)));
      }
    }
  }
}

Model moving_axis(int order, double sample_time) {
  Model model;
  model.sample_time_s = sample_time;
  model.loop.order = order;
  model.loop.denominator = denominator_of({60.0, 150.0, 0.7}, order);
  model.loop.numerator = {0.9, 60.0, 500.0};
  model.loop.modes = {{280.0, 0.03, -0.05, 20.0, 2e-4, 0.6, 0.25, -0.1, 0.4},
                      {700.0, 0.1, 0.02, -30.0, -1e-4, 0.2}};
  model.loop.travel = {-0.1, 0.3};
  Effect force = make_effect<ConstantForce>();
  force.coefficient[0] = 0.4;
  model.effects = {force};
  return model;
}

// Over 0.4 m and beyond, with vibrations in it.
double command(double t) {
  return 0.1 + 0.25 * std::sin(3.0 * t) + 2e-4 * std::sin(40.0 * t * (1.0 + 0.5 * t));
}
double command_velocity(double t) {
  return 0.75 * std::cos(3.0 * t) + 2e-4 * 40.0 * (1.0 + t) * std::cos(40.0 * t * (1.0 + 0.5 * t));
}

/// The definition in twin/loop.h as differential equations with omega(x(t)), by Runge and Kutta's
/// method in steps of 1e-5 s: the error at every `every`-th of them.
std::vector<double> integrated(const Model& model, double to, int every) {
  const Loop& loop = model.loop;
  const auto n = static_cast<std::size_t>(loop.order), modes = loop.modes.size();
  const std::size_t size = 2 * n + 2 * modes;
  const double d = model.effects[0].coefficient[0];
  const double a_last = loop.denominator[n - 1];
  // omega, zeta and delta at t, and what c(n-1) is more.
  struct Here {
    double omega, zeta, delta, lag;
  };
  const auto here = [&](const Mode& mode, double t) {
    double xi = (command(t) - 0.5 * (loop.travel.from + loop.travel.to)) /
                (0.5 * (loop.travel.to - loop.travel.from));
    xi = xi > 1.0 ? 1.0 : xi < -1.0 ? -1.0 : xi;
    const double omega = mode.omega * std::exp(mode.slope * xi + mode.curve * xi * xi);
    const double less = 1.0 / (mode.omega * mode.omega) - 1.0 / (omega * omega);
    const double give = 1.0 / (mode.omega * mode.omega) - 1.0 / a_last;
    return Here{omega, mode.zeta * std::exp(mode.zeta_slope * xi),
                n == 2 ? mode.delta * give / (give - less) : mode.delta, a_last * mode.beta * less};
  };
  using State = std::vector<double>;
  const auto rate = [&](double t, const State& w) {
    State out(size);
    for (const std::size_t first : {std::size_t{0}, n}) {
      for (std::size_t i = 0; i + 1 < n; ++i) out[first + i] = w[first + i + 1];
      double top = first == 0 ? command_velocity(t) : d;
      for (std::size_t i = 0; i < n; ++i) top -= loop.denominator[n - 1 - i] * w[first + i];
      out[first + n - 1] = top;
    }
    for (std::size_t m = 0; m < modes; ++m) {
      const Mode& mode = loop.modes[m];
      const auto [omega, zeta, delta, lag] = here(mode, t);
      const double v = command_velocity(t);
      const std::size_t at = 2 * n + 2 * m;
      out[at] = -2.0 * zeta * omega * w[at] + w[at + 1] + mode.alpha * v + mode.gamma * d;
      out[at + 1] = -omega * omega * w[at] + mode.beta * v + delta * d;
    }
    return out;
  };
  const auto error_of = [&](double t, const State& w) {
    const double a1 = loop.denominator[0];
    double e = 0.0, share = 1.0;
    for (std::size_t i = 0; i < n; ++i) e += loop.numerator[n - 1 - i] * w[i];
    for (std::size_t m = 0; m < modes; ++m) {
      const Mode& mode = loop.modes[m];
      const auto [omega, zeta, delta, lag] = here(mode, t);
      share -= mode.gamma * (a1 - 2.0 * zeta * omega) + delta;
      e += w[2 * n + 2 * m] - mode.gamma * w[2 * n - 1] + lag * w[0];
      if (n == 3) e -= delta * a_last / (omega * omega) * w[n];
    }
    return e + share * w[2 * n - 2];
  };
  // A force that acts since ever.
  State w(size, 0.0);
  w[n] = d / loop.denominator[n - 1];
  for (std::size_t m = 0; m < modes; ++m) {
    const Mode& mode = loop.modes[m];
    const auto [omega, zeta, delta, lag] = here(mode, 0.0);
    w[2 * n + 2 * m] = delta / (omega * omega) * d;
    w[2 * n + 2 * m + 1] = 2.0 * zeta * omega * w[2 * n + 2 * m] - mode.gamma * d;
  }
  const double h = 1e-5;
  std::vector<double> errors{error_of(0.0, w)};
  const auto steps = static_cast<int>(std::lround(to / h));
  const auto moved = [&](const State& from, double by, const State& along) {
    State out = from;
    for (std::size_t i = 0; i < size; ++i) out[i] += by * along[i];
    return out;
  };
  for (int k = 0; k < steps; ++k) {
    const double t = k * h;
    const State k1 = rate(t, w), k2 = rate(t + h / 2, moved(w, h / 2, k1)),
                k3 = rate(t + h / 2, moved(w, h / 2, k2)), k4 = rate(t + h, moved(w, h, k3));
    for (std::size_t i = 0; i < size; ++i) w[i] += h / 6 * (k1[i] + 2 * k2[i] + 2 * k3[i] + k4[i]);
    if ((k + 1) % every == 0) errors.push_back(error_of((k + 1) * h, w));
  }
  return errors;
}

/// How far the twin is from that at most [m], where the command starts with a speed.
double missed(const Model& model, const std::vector<double>& truth) {
  const double h = model.sample_time_s;
  Twin twin(model);
  twin.start(command(0.0));
  double most = 0.0;
  for (std::size_t k = 1; k < truth.size(); ++k) {
    const double t = h * static_cast<double>(k), before = t - h;
    const auto second = [](double at) {
      const double d = 1e-6;
      return (command_velocity(at + d) - command_velocity(at - d)) / (2.0 * d);
    };
    CommandPiece piece;
    piece.velocity = command_velocity(before);
    piece.acceleration = second(before);
    piece.jerk = 2.0 / (h * h) * (command_velocity(t) - piece.velocity - h * piece.acceleration);
    piece.end_position = command(t);
    piece.end_velocity = command_velocity(t);
    piece.end_acceleration = second(t);
    most = std::max(most, std::abs(twin.step(piece) - truth[k]));
  }
  return most;
}

TEST(MovingMode, TheTwinFollowsItsDifferentialEquation) {
  for (const int order : {2, 3}) {
    const std::vector<double> fine = integrated(moving_axis(order, 5e-4), 2.0, 50);
    std::vector<double> coarse;
    for (std::size_t k = 0; k < fine.size(); k += 2) coarse.push_back(fine[k]);
    double largest = 0.0;
    for (double e : fine) largest = std::max(largest, std::abs(e));
    const double at_1 = missed(moving_axis(order, 1e-3), coarse),
                 at_half = missed(moving_axis(order, 5e-4), fine);
    // Of second order in the cycle, over which the frequency is held; less at the ends of the
    // travel.
    EXPECT_LT(at_half, 2e-5 * largest) << "order " << order;
    EXPECT_GT(at_1 / at_half, 2.5) << "order " << order;

    // The change of the mode has a much larger effect.
    Model standing = moving_axis(order, 5e-4);
    standing.loop.modes[0].slope = standing.loop.modes[0].curve = 0.0;
    EXPECT_GT(missed(standing, fine), 1e-3 * largest);
  }
}

// Where the axis stays, the loop is that of modes that stand where they are there.
TEST(MovingMode, AnAxisThatStaysSeesItsModesThere) {
  for (const double place : {-0.1, 0.02, 0.3, 0.9}) {
    Model moving = moving_axis(2, 1e-3);
    moving.effects.clear();
    Model there = moving;
    there.loop = at_position(moving.loop, place);
    EXPECT_FALSE(there.loop.modes[0].moves());
    Twin one(moving), other(there);
    one.start(place);
    other.start(place);
    for (int k = 1; k <= 500; ++k) {
      const double x = place + 1e-9 * std::sin(0.25 * k);
      ASSERT_NEAR(one.follow(x), other.follow(x), 1e-16) << "at " << place;
    }
  }
  const Loop loop = moving_axis(2, 1e-3).loop;
  EXPECT_NEAR(at_position(loop, 0.3).modes[0].omega, 280.0 * std::exp(0.15), 1e-10);
  EXPECT_NEAR(at_position(loop, -0.1).modes[0].omega, 280.0 * std::exp(-0.35), 1e-10);
  EXPECT_EQ(at_position(loop, 7.0).modes[0].omega, at_position(loop, 0.3).modes[0].omega);
  EXPECT_EQ(at_position(loop, 0.1).modes[1].omega, 700.0);
}

// At constant speed the lag is that of the middle, and so is the give under a constant force.
TEST(MovingMode, WhatTheControlMakesGoodAtRestStays) {
  for (const int order : {2, 3}) {
    const Loop loop = moving_axis(order, 1e-3).loop;
    const auto n = static_cast<std::size_t>(order);
    const auto lag = [&](const Loop& of) {
      double sum = of.numerator[n - 1] / of.denominator[n - 1];
      for (const Mode& mode : of.modes) sum += mode.beta / (mode.omega * mode.omega);
      return sum;
    };
    const auto give = [&](Loop of) {
      for (Mode& mode : of.modes) mode.gamma = 0.0;  // its share of damping moves with omega
      double sum = disturbance_share(of.denominator, of.modes) / of.denominator[1];
      for (const Mode& mode : of.modes) sum += mode.delta / (mode.omega * mode.omega);
      return sum;
    };
    for (const double place : {-0.1, 0.0, 0.3}) {
      EXPECT_NEAR(lag(at_position(loop, place)), lag(loop), 1e-15);
      if (order == 2) {
        EXPECT_NEAR(give(at_position(loop, place)), give(loop), 1e-18);
      }
    }
  }
}

TEST(MovingMode, NeedsATravelToMoveOver) {
  Model model = moving_axis(3, 1e-3);
  EXPECT_EQ(why_invalid(model), "");
  model.loop.travel = {0.2, 0.2};
  EXPECT_NE(why_invalid(model).find("loop.travel goes from 0.2 to 0.2"), std::string::npos);
  model = moving_axis(3, 1e-3);
  model.loop.modes[0].curve = 1.2;
  EXPECT_NE(why_invalid(model).find("log_frequency_curve = 1.2"), std::string::npos);
}

}  // namespace
}  // namespace servotwin
