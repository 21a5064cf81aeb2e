#include "identification/loop/full_ls.h"

#include <ceres/ceres.h>

#include <Eigen/Core>
#include <cmath>

#include "identification/least_squares/bounded.h"
#include "twin/linear_algebra.h"
#include "twin/two_pi.h"

namespace servotwin {

namespace {

// Velocity limit of the saturated sign in place of the method's sign [m/s | rad/s]: just wide
// enough for the simulation to be well posed.
constexpr double kSignWidth = 1e-4;

/// Central differences, one-sided at the ends.
Eigen::ArrayXd gradient(const Eigen::ArrayXd& x, double h) {
  const Eigen::Index n = x.size();
  Eigen::ArrayXd g(n);
  g.segment(1, n - 2) = (x.tail(n - 2) - x.head(n - 2)) / (2.0 * h);
  g(0) = (x(1) - x(0)) / h;
  g(n - 1) = (x(n - 1) - x(n - 2)) / h;
  return g;
}

/// | P(x - th1 E - th2 v - th3 a) | as a function of the poles: P projects out the parameters
/// that are linear for given poles, so that four columns of a small triangular matrix represent the
/// data.
struct EquationError {
  Eigen::Matrix4d r;  // of the columns E, v, a, x
  template <class T>
  bool operator()(const T* log_poles, T* residual) const {
    const T p = ceres::exp(log_poles[0]), omega = ceres::exp(log_poles[1]),
            zeta = ceres::exp(log_poles[2]);
    const T a1 = p + 2.0 * zeta * omega;
    const T a2 = omega * omega + 2.0 * zeta * omega * p;
    const T a3 = p * omega * omega;
    const T c[4] = {-a3 / a2, a1 / a2, 1.0 / a2, T(1.0)};
    for (int i = 0; i < 4; ++i) {
      residual[i] = T(0.0);
      for (int k = 0; k < 4; ++k) residual[i] += r(i, k) * c[k];
    }
    return true;
  }
};

}  // namespace

std::optional<FullLsFit> full_ls(const std::vector<Segment>& segments, const PoleBounds& bounds,
                                 bool pole_constraints) {
  Eigen::Index rows = 0;
  for (const Segment& s : segments) rows += s.size();
  if (rows < 50) return std::nullopt;
  const auto pieces = static_cast<Eigen::Index>(segments.size());
  // Each segment's integral starts at an unknown value: one constant column a segment after the
  // first's E = 0.
  Eigen::MatrixXd phi = Eigen::MatrixXd::Zero(rows, 8 + (pieces > 1 ? pieces : 0));
  Eigen::VectorXd x(rows);
  Eigen::Index row = 0;
  for (Eigen::Index i = 0; i < pieces; ++i) {
    const Segment& s = segments[static_cast<std::size_t>(i)];
    const Eigen::Index n = s.size();
    if (n < 4) return std::nullopt;
    const double h = s.sample_time_s;
    const Eigen::ArrayXd v = gradient(s.actual, h), a = gradient(v, h);
    const Eigen::ArrayXd vr = gradient(s.command, h), ar = gradient(vr, h);
    auto block = phi.middleRows(row, n);
    double integral = 0.0;
    for (Eigen::Index k = 0; k < n; ++k) {
      integral += h * (s.command(k) - s.actual(k));
      block(k, 0) = integral;
    }
    block.col(1) = v.matrix();
    block.col(2) = a.matrix();
    block.col(3) = s.command.matrix();
    block.col(4) = vr.matrix();
    block.col(5) = ar.matrix();
    block.col(6) = (v > 0.0).cast<double>().matrix();
    block.col(7) = -(v < 0.0).cast<double>().matrix();
    if (pieces > 1) block.col(8 + i).setOnes();
    x.segment(row, n) = s.actual.matrix();
    row += n;
  }

  FullLsFit fit;
  {
    Eigen::MatrixXd mm = phi.leftCols(8);
    mm.leftCols(6) *= 1e3;
    const Eigen::VectorXd singular = singular_values(triangle_of(mm));
    fit.condition_number = singular(0) / singular(7);
  }
  const Eigen::VectorXd scale = phi.colwise().norm().cwiseMax(1e-300).cwiseInverse();
  const Eigen::MatrixXd scaled = phi * scale.asDiagonal();
  const Eigen::VectorXd theta = (least_squares(scaled, x).array() * scale.array()).matrix();
  double a2 = -1.0 / theta(2);
  double a1 = theta(1) / theta(2);
  double a3 = theta(0) * a2;
  Eigen::VectorXd linear = theta.tail(theta.size() - 3);

  Loop& loop = fit.model.loop;
  loop.order = 3;
  loop.denominator = {a1, a2, a3};
  fit.poles_in_box = stable(loop) && inside(loop, bounds).has_value();
  if (pole_constraints && !fit.poles_in_box) {
    fit.constrained = true;
    // Columns E, v, a, x after projecting out all parameters that are linear for given poles.
    const Eigen::MatrixXd rest = scaled.rightCols(phi.cols() - 3);
    Eigen::MatrixXd four(rows, 4);
    four << phi.leftCols(3), x;
    const Eigen::MatrixXd turned = turned_by(rest, four);
    EquationError cost;
    cost.r = triangle_of(turned.bottomRows(rows - rest.cols()));
    cost.r /= std::max(std::abs(cost.r(3, 3)), 1e-300) / std::sqrt(static_cast<double>(rows));
    double best = 1e300;
    std::array<double, 3> q{};
    const double low[3] = {std::log(bounds.real_min_hz * kTwoPi),
                           std::log(bounds.omega_min_hz * kTwoPi), std::log(bounds.zeta_min)};
    const double high[3] = {std::log(bounds.real_max_hz * kTwoPi),
                            std::log(bounds.omega_max_hz * kTwoPi), std::log(bounds.zeta_max)};
    for (int start = 0; start < 18; ++start) {
      const int place[3] = {start % 3, start / 3 % 3, start / 9};
      const double part[3] = {(place[0] + 0.5) / 3.0, (place[1] + 0.5) / 3.0,
                              (place[2] + 0.5) / 2.0};
      std::array<double, 3> at{};
      for (std::size_t i = 0; i < 3; ++i) at[i] = low[i] + part[i] * (high[i] - low[i]);
      ceres::Problem problem;
      problem.AddResidualBlock(
          new ceres::AutoDiffCostFunction<EquationError, 4, 3>(new EquationError(cost)), nullptr,
          at.data());
      for (int i = 0; i < 3; ++i) {
        problem.SetParameterLowerBound(at.data(), i, low[i]);
        problem.SetParameterUpperBound(at.data(), i, high[i]);
      }
      const ceres::Solver::Summary summary =
          solve_bounded(bounded_options(ceres::DENSE_QR, 200, 1e-12), problem);
      if (summary.IsSolutionUsable() && summary.final_cost < best) {
        best = summary.final_cost;
        q = at;
      }
    }
    loop.denominator = denominator_of({std::exp(q[0]), std::exp(q[1]), std::exp(q[2])}, 3);
    a1 = loop.denominator[0], a2 = loop.denominator[1], a3 = loop.denominator[2];
    const Eigen::VectorXd target =
        x - phi.leftCols(3) * Eigen::Vector3d(a3 / a2, -a1 / a2, -1.0 / a2);
    linear = (least_squares(rest, target).array() * scale.tail(rest.cols()).array()).matrix();
  }
  loop.numerator = {1.0 - a2 * linear(2), a1 - a2 * linear(1), a2 - a2 * linear(0)};
  fit.friction_positive = -a2 * linear(3);
  fit.friction_negative = -a2 * linear(4);
  fit.model.sample_time_s = segments.front().sample_time_s;
  Effect friction = make_effect<CoulombFriction>();
  friction.shape[0] = kSignWidth;
  friction.coefficient[0] = 0.5 * (fit.friction_positive + fit.friction_negative);
  fit.model.effects.push_back(friction);
  if (!loop.denominator.empty() && std::isfinite(a1 + a2 + a3)) return fit;
  return std::nullopt;
}

}  // namespace servotwin
