#include "twin/hold.h"

#include <cassert>
#include <cmath>

#include "twin/linear_algebra.h"

namespace servotwin {

namespace {

/// The system with a chain of integrators for its input and m derivatives of it.
Eigen::MatrixXd with_inputs(const Eigen::MatrixXd& a, const Eigen::VectorXd& b, int m) {
  assert(a.rows() == a.cols() && b.size() == a.rows() && m >= 0);
  const Eigen::Index n = a.rows();
  Eigen::MatrixXd augmented = Eigen::MatrixXd::Zero(n + m + 1, n + m + 1);
  augmented.topLeftCorner(n, n) = a;
  augmented.col(n).head(n) = b;
  for (int k = 0; k < m; ++k) augmented(n + k, n + k + 1) = 1.0;
  return augmented;
}

/// By one exponential in these units of the n states and the inputs, in which it loses no digits.
Hold stepped(const Eigen::MatrixXd& augmented, Eigen::Index n, double h,
             const Eigen::VectorXd& scale) {
  const Eigen::MatrixXd scaled =
      scale.asDiagonal() * (augmented * h) * scale.cwiseInverse().asDiagonal();
  const Eigen::MatrixXd step =
      scale.cwiseInverse().asDiagonal() * exponential(scaled) * scale.asDiagonal();
  return {step.topLeftCorner(n, n), step.topRightCorner(n, step.cols() - n)};
}

/// Its derivative for a change of the system, from the exponential of both in one: that of
/// [A, dA; 0, A] is [e^A, de^A; 0, e^A].
Hold stepped_derivative(const Eigen::MatrixXd& augmented, const Eigen::MatrixXd& da,
                        const Eigen::VectorXd& db, double h, const Eigen::VectorXd& scale) {
  const Eigen::Index size = augmented.rows(), n = da.rows();
  Eigen::MatrixXd change = Eigen::MatrixXd::Zero(size, size);
  change.topLeftCorner(n, n) = da;
  change.col(n).head(n) = db;
  const auto scaled = [&](const Eigen::MatrixXd& x) -> Eigen::MatrixXd {
    return scale.asDiagonal() * (x * h) * scale.cwiseInverse().asDiagonal();
  };
  Eigen::MatrixXd both = Eigen::MatrixXd::Zero(2 * size, 2 * size);
  both.topLeftCorner(size, size) = both.bottomRightCorner(size, size) = scaled(augmented);
  both.topRightCorner(size, size) = scaled(change);
  const Eigen::MatrixXd step = scale.cwiseInverse().asDiagonal() *
                               exponential(both).topRightCorner(size, size) * scale.asDiagonal();
  return {step.topLeftCorner(n, n), step.topRightCorner(n, size - n)};
}

/// States are derivatives of each other, so their magnitudes differ by powers of the pole
/// frequency. In units of time where that frequency is about 1 the exponential loses no digits.
Eigen::VectorXd scale_of(const Eigen::MatrixXd& augmented, Eigen::Index n, int m) {
  const double rate =
      std::max(std::pow(augmented.topLeftCorner(n, n).norm(), 1.0 / static_cast<double>(n)), 1e-9);
  Eigen::VectorXd scale(n + m + 1);
  for (Eigen::Index i = 0; i < n; ++i) scale(i) = std::pow(rate, -static_cast<double>(i));
  for (Eigen::Index k = 0; k <= m; ++k) scale(n + k) = std::pow(rate, -static_cast<double>(n + k));
  return scale;
}
Eigen::VectorXd scale_alike(const Eigen::VectorXd& b, int m, double rate) {
  const Eigen::Index n = b.size();
  Eigen::VectorXd scale = Eigen::VectorXd::Ones(n + m + 1);
  const double norm = b.norm(), size = norm > 0.0 ? norm : 1.0;
  for (int k = 0; k <= m; ++k) scale(n + k) = size * std::pow(rate, -1 - k);
  return scale;
}

}  // namespace

Hold discretise(const Eigen::MatrixXd& a, const Eigen::VectorXd& b, double h, int m) {
  assert(h > 0.0);
  const Eigen::MatrixXd augmented = with_inputs(a, b, m);
  return stepped(augmented, a.rows(), h, scale_of(augmented, a.rows(), m));
}

Hold discretise_derivative(const Eigen::MatrixXd& a, const Eigen::VectorXd& b,
                           const Eigen::MatrixXd& da, const Eigen::VectorXd& db, double h, int m) {
  const Eigen::MatrixXd augmented = with_inputs(a, b, m);
  return stepped_derivative(augmented, da, db, h, scale_of(augmented, a.rows(), m));
}

Hold discretise_alike(const Eigen::MatrixXd& a, const Eigen::VectorXd& b, double h, int m,
                      double rate) {
  assert(h > 0.0 && rate > 0.0);
  return stepped(with_inputs(a, b, m), a.rows(), h, scale_alike(b, m, rate));
}

Hold discretise_alike_derivative(const Eigen::MatrixXd& a, const Eigen::VectorXd& b,
                                 const Eigen::MatrixXd& da, const Eigen::VectorXd& db, double h,
                                 int m, double rate) {
  const Eigen::MatrixXd augmented = with_inputs(a, b, m);
  return stepped_derivative(augmented, da, db, h, scale_alike(b, m, rate));
}

Spline Spline::through(const Eigen::ArrayXd& samples, double h, double slope_begin,
                       double slope_end) {
  const Eigen::Index n = samples.size();
  Spline s;
  s.h = h;
  s.value = samples;
  s.first = Eigen::ArrayXd::Zero(n);
  s.second = Eigen::ArrayXd::Zero(n);
  s.third = Eigen::ArrayXd::Zero(n);
  if (n < 2) return s;

  // Tridiagonal system of the slopes: m_(i-1) + 4 m_i + m_(i+1) = 3 (x_(i+1) - x_(i-1)) / h.
  s.first(0) = slope_begin;
  s.first(n - 1) = slope_end;
  if (n > 2) {
    Eigen::ArrayXd diagonal = Eigen::ArrayXd::Constant(n, 4.0);
    Eigen::ArrayXd right(n);
    right(1) = 3.0 * (samples(2) - samples(0)) / h - slope_begin;
    // 1 / diagonal settles to its last digit within some twenty rows.
    double factor = 0.25;
    bool settled = false;
    for (Eigen::Index i = 2; i < n - 1; ++i) {
      if (!settled) {
        factor = 1.0 / diagonal(i - 1);
        settled = 4.0 - factor == diagonal(i - 1);
      }
      diagonal(i) -= factor;
      right(i) = 3.0 * (samples(i + 1) - samples(i - 1)) / h - factor * right(i - 1);
    }
    for (Eigen::Index i = n - 2; i >= 1; --i)
      s.first(i) = (right(i) - s.first(i + 1)) / diagonal(i);
  }
  for (Eigen::Index i = 0; i + 1 < n; ++i) {
    const double chord = (samples(i + 1) - samples(i)) / h;
    s.second(i) = (6.0 * chord - 4.0 * s.first(i) - 2.0 * s.first(i + 1)) / h;
    s.third(i) = (6.0 * (s.first(i) + s.first(i + 1)) - 12.0 * chord) / (h * h);
  }
  // The last row has no interval of its own; it continues the one before.
  s.second(n - 1) = s.second(n - 2) + h * s.third(n - 2);
  return s;
}

Spline Spline::through(const Eigen::ArrayXd& samples, double h) {
  const Eigen::Index n = samples.size();
  if (n < 4) return through(samples, h, 0.0, 0.0);
  const auto slope = [&](Eigen::Index at, Eigen::Index step) {
    return (-11.0 * samples(at) + 18.0 * samples(at + step) - 9.0 * samples(at + 2 * step) +
            2.0 * samples(at + 3 * step)) /
           (6.0 * h * static_cast<double>(step));
  };
  return through(samples, h, slope(0, 1), slope(n - 1, -1));
}

Spline Spline::straight(const Eigen::ArrayXd& samples, double h) {
  Spline out;
  const Eigen::Index n = samples.size();
  out.h = h;
  out.value = samples;
  out.first = out.second = out.third = Eigen::ArrayXd::Zero(n);
  if (n > 1) out.first.head(n - 1) = (samples.tail(n - 1) - samples.head(n - 1)) / h;
  return out;
}

Eigen::ArrayXd Spline::delayed(double delay_s) const {
  const Eigen::Index n = value.size();
  if (delay_s == 0.0) return value;
  Eigen::ArrayXd out(n);
  const double shift = delay_s / h;
  const auto whole = static_cast<Eigen::Index>(std::ceil(shift));
  const double sigma = (static_cast<double>(whole) - shift) * h;
  for (Eigen::Index i = 0; i < n; ++i) {
    const Eigen::Index k = i - whole;
    if (k < 0) {
      // Before the record the motion continues backwards at the slope of its start.
      out(i) = value(0) + first(0) * (static_cast<double>(k) * h + sigma);
    } else {
      out(i) = value(k) + sigma * (first(k) + sigma * (second(k) / 2.0 + sigma * third(k) / 6.0));
    }
  }
  return out;
}

Eigen::ArrayXd Spline::delayed_derivative(double delay_s) const {
  const Eigen::Index n = value.size();
  Eigen::ArrayXd out(n);
  const double shift = delay_s / h;
  const auto whole = static_cast<Eigen::Index>(std::ceil(shift));
  const double sigma = (static_cast<double>(whole) - shift) * h;
  for (Eigen::Index i = 0; i < n; ++i) {
    const Eigen::Index k = i - whole;
    out(i) = k < 0 ? -first(0) : -(first(k) + sigma * (second(k) + sigma * third(k) / 2.0));
  }
  return out;
}

}  // namespace servotwin
