#include "identification/response/partial_fractions.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <numeric>

#include "twin/linear_algebra.h"

namespace servotwin {

using Complex = std::complex<double>;
using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace {

constexpr double kDampingOfAxisPole = 1e-4;  // of a pole that lands on the imaginary axis
constexpr double kMaxFrequencyRatio = 1e4;   // of a pole over the mean frequency, and the inverse

}  // namespace

int order_of(const Factors& factors) {
  return std::accumulate(factors.begin(), factors.end(), 0,
                         [](int sum, const Factor& f) { return sum + f.poles(); });
}

WeightedResponse::WeightedResponse(const ResponsePoints& points, const RationalOptions& options)
    : unit(std::exp(points.omega.log().mean())), overlap(points.overlap) {
  s = Complex(0.0, 1.0) * (points.omega / unit).matrix().cast<Complex>();
  weight = points.deviation.cwiseInverse();
  response = points.response;
  for (Index i = 0; i < s.size(); ++i)
    response.row(i) *= std::polar(1.0, points.omega(i) * options.delay_s);
  least_width = options.least_width / unit;
  size = (weight.array() * response.array().abs()).square().sum();
}

VectorXd stacked(const Eigen::VectorXcd& v) {
  VectorXd out(2 * v.size());
  out << v.real(), v.imag();
  return out;
}
MatrixXd stacked(const Eigen::MatrixXcd& m) {
  MatrixXd out(2 * m.rows(), m.cols());
  out << m.real(), m.imag();
  return out;
}

Eigen::MatrixXcd basis_of(const Factors& factors, const Eigen::VectorXcd& s) {
  Eigen::MatrixXcd out(s.size(), order_of(factors) + 1);
  Index column = 0;
  for (const Factor& factor : factors) {
    for (Index i = 0; i < s.size(); ++i) {
      const Complex inverse = 1.0 / factor.at(s(i));
      if (factor.pair) out(i, column) = s(i) * inverse;
      out(i, column + factor.poles() - 1) = inverse;
    }
    column += factor.poles();
  }
  out.col(column).setOnes();
  return out;
}

namespace {

/// Least squares with columns of any size.
VectorXd solved(const MatrixXd& a, const VectorXd& b) {
  const VectorXd scale = a.colwise().norm().cwiseMax(1e-300).cwiseInverse();
  return scale.cwiseProduct(least_squares(a * scale.asDiagonal(), b));
}

}  // namespace

Residues residues_of(const WeightedResponse& p, const Factors& factors) {
  const Eigen::MatrixXcd basis = basis_of(factors, p.s);
  Residues out{MatrixXd(p.channels(), basis.cols()), 0.0};
  for (Index c = 0; c < p.channels(); ++c) {
    const Eigen::VectorXcd w = p.weight.col(c).cast<Complex>();
    const MatrixXd a = stacked(Eigen::MatrixXcd(w.asDiagonal() * basis));
    const VectorXd b = stacked(Eigen::VectorXcd(w.cwiseProduct(p.response.col(c))));
    const VectorXd x = solved(a, b);
    out.coefficients.row(c) = x.transpose();
    out.cost += (a * x - b).squaredNorm();
  }
  return out;
}

namespace {

/// The zeros of d + sum of c_i basis_i, mirrored to the left, as factors.
Factors zeros_of(const Factors& factors, const VectorXd& sigma, double least_width) {
  const Index n = sigma.size() - 1;
  MatrixXd a = MatrixXd::Zero(n, n);
  VectorXd b = VectorXd::Zero(n), c(n);
  Index k = 0;
  for (const Factor& factor : factors) {
    if (factor.pair) {
      a(k, k + 1) = 1.0;
      a(k + 1, k) = -factor.b;
      a(k + 1, k + 1) = -factor.a;
      c(k) = sigma(k + 1);
      c(k + 1) = sigma(k);
    } else {
      a(k, k) = -factor.b;
      c(k) = sigma(k);
    }
    k += factor.poles();
    b(k - 1) = 1.0;
  }
  // Gustavsen 2006: a constant near 0 would throw the zeros to infinity.
  const double d = sigma(n), least = 1e-8;
  const VectorXd feedback = c / (std::abs(d) > least ? d : std::copysign(least, d));
  const MatrixXd closed = a - b * feedback.transpose();
  if (!closed.allFinite()) return {};
  Factors out;
  const Eigen::VectorXcd zeros = eigenvalues(closed);
  for (const Complex z : zeros) {
    const double omega = std::clamp(std::abs(z), 1.0 / kMaxFrequencyRatio, kMaxFrequencyRatio);
    if (z.imag() > 0.0) {
      const double zeta = std::max(std::abs(z.real()) / std::abs(z), kDampingOfAxisPole);
      out.push_back(pair_of(omega, std::max(zeta, 0.5 * least_width / omega)));
    } else if (z.imag() == 0.0) {
      out.push_back({false, 0.0, omega});
    }
  }
  return out;
}

}  // namespace

Factors relocated(const WeightedResponse& p, const Factors& factors) {
  const Eigen::MatrixXcd basis = basis_of(factors, p.s);
  const Index n = basis.cols(), rows = basis.rows();
  MatrixXd sigma_rows(p.channels() * n + 1, n);
  for (Index c = 0; c < p.channels(); ++c) {
    const Eigen::VectorXcd w = p.weight.col(c).cast<Complex>();
    const Eigen::VectorXcd minus = -w.cwiseProduct(p.response.col(c));
    MatrixXd a(2 * rows, 2 * n);
    a << stacked(Eigen::MatrixXcd(w.asDiagonal() * basis)),
        stacked(Eigen::MatrixXcd(minus.asDiagonal() * basis));
    const MatrixXd r = triangle_of(a);
    sigma_rows.middleRows(c * n, n) = r.block(n, n, n, n);
  }
  // Relaxed: the mean of sigma is 1, not its constant.
  const double weight = std::sqrt(p.size) / static_cast<double>(rows);
  sigma_rows.bottomRows(1) = weight * basis.real().colwise().sum();
  VectorXd right = VectorXd::Zero(sigma_rows.rows());
  right(right.size() - 1) = weight * static_cast<double>(rows);
  const VectorXd sigma = solved(sigma_rows, right);
  return sigma.allFinite() ? zeros_of(factors, sigma, p.least_width) : Factors{};
}

}  // namespace servotwin
