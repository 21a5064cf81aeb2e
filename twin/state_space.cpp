#include "twin/state_space.h"

#include "twin/hold.h"

namespace servotwin {

StateSpace state_space(const Loop& loop, double sample_time_s) {
  const int n = loop.order;
  StateSpace s;
  // The error by the observer canonical form: e = (sum b_i s^(n-1-i)) / P u.
  s.a = Eigen::MatrixXd::Zero(n + 1, n + 1);
  s.b = Eigen::MatrixXd::Zero(n + 1, 2);
  for (int i = 0; i < n; ++i) {
    const auto k = static_cast<std::size_t>(i);
    s.a(i, 0) = -loop.denominator[k];
    if (i + 1 < n) s.a(i, i + 1) = 1.0;
    s.b(i, 0) = loop.numerator[k];
  }
  s.b(1, 1) = 1.0;  // order 3: s / P of the disturbance, order 2: 1 / P
  s.b(n, 0) = 1.0;  // the command's velocity makes the command
  s.c = Eigen::MatrixXd::Zero(3, n + 1);
  s.d = Eigen::MatrixXd::Zero(3, 2);
  s.c(0, 0) = 1.0;
  s.c(1, 0) = -1.0;
  s.c(1, n) = 1.0;
  s.c.row(2) = -s.a.row(0);
  s.d.row(2) = -s.b.row(0);
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

}  // namespace servotwin
