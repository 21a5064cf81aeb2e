#include "twin/state_space.h"

#include "twin/hold.h"

namespace servotwin {

StateSpace state_space(const Loop& loop, double sample_time_s) {
  const int rigid = loop.order, n = rigid + 2 * static_cast<int>(loop.modes.size());
  StateSpace s;
  // The error by the observer canonical form: e = (sum b_i s^(n-1-i)) / P u.
  s.a = Eigen::MatrixXd::Zero(n + 1, n + 1);
  s.b = Eigen::MatrixXd::Zero(n + 1, 2);
  for (int i = 0; i < rigid; ++i) {
    const auto k = static_cast<std::size_t>(i);
    s.a(i, 0) = -loop.denominator[k];
    if (i + 1 < rigid) s.a(i, i + 1) = 1.0;
    s.b(i, 0) = loop.numerator[k];
  }
  // Order 3: s / P of the disturbance, order 2: 1 / P; and what the modes take off (twin/loop.h).
  s.b(1, 1) = disturbance_share(loop.denominator, loop.modes);
  int at = rigid;
  for (const Mode& mode : loop.modes) {
    const double stiffness = mode.omega * mode.omega;
    s.a.block(at, at, 2, 2) << -2.0 * mode.zeta * mode.omega, 1.0, -stiffness, 0.0;
    s.b.row(at) << mode.alpha, mode.gamma;
    s.b.row(at + 1) << mode.beta, mode.delta;
    s.b(0, 1) -= mode.gamma;
    if (rigid == 3) s.b(2, 1) -= mode.delta * loop.denominator[2] / stiffness;
    at += 2;
  }
  s.b(n, 0) = 1.0;  // the command's velocity makes the command
  s.c = Eigen::MatrixXd::Zero(3, n + 1);
  s.d = Eigen::MatrixXd::Zero(3, 2);
  s.c(0, 0) = 1.0;  // the error, the position, the velocity
  for (at = rigid; at < n; at += 2) s.c(0, at) = 1.0;
  s.c.row(1) = -s.c.row(0);
  s.c(1, n) = 1.0;
  s.c.row(2) = -s.c.row(0) * s.a;
  s.d.row(2) = -s.c.row(0) * s.b;
  s.d(2, 0) += 1.0;

  const Eigen::MatrixXd a = s.a.topLeftCorner(n, n);
  const Hold command = discretise(a, s.b.col(0).head(n), sample_time_s, 2);
  const Hold force = discretise(a, s.b.col(1).head(n), sample_time_s, 1);
  const double h = sample_time_s;
  s.phi = Eigen::MatrixXd::Identity(n + 1, n + 1);
  s.phi.topLeftCorner(n, n) = command.phi;
  s.g.resize(n + 1, 5);
  s.g.topRows(n) << command.g, force.g;
  s.g.row(n) << h, h * h / 2, h * h * h / 6, 0.0, 0.0;
  return s;
}

StateSpace state_space(const Loop& loop, const TwoMassParameters& two_masses,
                       double sample_time_s) {
  const TwoMassEquations equations = two_mass_equations(loop, two_masses);
  TwoMassAxis axis;
  axis.discretise(loop, two_masses, sample_time_s);
  const TwoMassAxis::Step& step = axis.step();
  const int n = equations.states;
  const auto column = [n](const TwoMassAxis::State& x) -> Eigen::VectorXd {
    return Eigen::Map<const Eigen::VectorXd>(x.data(), n);
  };
  // The states less the part that follows the command's velocity at once: without it the equations
  // need no acceleration of the command.
  const Eigen::VectorXd at_once = column(equations.by_acceleration);
  StateSpace s;
  s.a = Eigen::MatrixXd::Zero(n + 1, n + 1);
  s.phi = Eigen::MatrixXd::Identity(n + 1, n + 1);
  s.g = Eigen::MatrixXd::Zero(n + 1, 7);
  for (int i = 0; i < n; ++i) {
    const auto k = static_cast<std::size_t>(i);
    s.a.row(i).head(n) = column(equations.by_state[k]);
    s.phi.row(i).head(n) = column(step.phi[k]);
    s.g.row(i).head(3) = Eigen::Map<const Eigen::RowVector3d>(step.command[k].data());
  }
  s.b = Eigen::MatrixXd::Zero(n + 1, 3);
  s.b.col(0).head(n) = column(equations.by_velocity) + s.a.topLeftCorner(n, n) * at_once;
  s.b.col(1).head(n) = column(equations.by_motor_force);
  s.b.col(2).head(n) = column(equations.by_load_force);
  s.b(n, 0) = 1.0;
  const double h = sample_time_s;
  s.g.col(0).head(n) += s.phi.topLeftCorner(n, n) * at_once - at_once;
  s.g.col(1).head(n) -= h * at_once;
  s.g.col(2).head(n) -= h * h / 2 * at_once;
  s.g.col(3).head(n) = column(step.motor_begin) + column(step.motor_end);
  s.g.col(4).head(n) = h * column(step.motor_end);
  s.g.col(5).head(n) = column(step.load_begin) + column(step.load_end);
  s.g.col(6).head(n) = h * column(step.load_end);
  s.g.row(n).head(3) << h, h * h / 2, h * h * h / 6;

  s.c = Eigen::MatrixXd::Zero(5, n + 1);
  s.d = Eigen::MatrixXd::Zero(5, 3);
  const bool at_load = two_masses.encoders != Encoders::kMotor;
  s.c(0, 0) = 1.0;
  s.c(0, 2) = at_load ? 1.0 : 0.0;
  s.c.row(1) = -s.c.row(0);
  s.c(1, n) = 1.0;
  s.c(3, 1) = s.c(4, 1) = s.c(4, 3) = -1.0;
  s.d(3, 0) = 1.0 - at_once(1);
  s.d(4, 0) = s.d(3, 0) - at_once(3);
  s.c.row(2) = s.c.row(at_load ? 4 : 3);
  s.d.row(2) = s.d.row(at_load ? 4 : 3);
  return s;
}

}  // namespace servotwin
