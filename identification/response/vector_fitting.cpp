#include "identification/response/vector_fitting.h"

#include <ceres/ceres.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include "identification/least_squares/bounded.h"
#include "identification/response/partial_fractions.h"
#include "twin/linear_algebra.h"

namespace servotwin {

namespace {

using Complex = std::complex<double>;
using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr int kRelocations = 20;  // of the poles by vector fitting, from each start
// Largest |log| of a and b; beyond it a pole is outside the points' band.
constexpr double kMaxLogCoefficient = 20.0;
constexpr double kStartDamping = 0.01;  // Gustavsen and Semlyen 1999
constexpr double kPeakDamping = 0.05;   // of a pair that is added at the largest misfit
constexpr Index kPeakPoints = 5;        // over which that place is averaged
constexpr Index kBlock = 8;             // neighbouring frequencies, whose errors are correlated
// Allowed increase of the held-out misfit to avoid undetermined poles.
constexpr double kMaxMisfitRatio = 2.0;
// Difference in mean squared error below which orders are equal.
constexpr double kMinMisfitDifference = 1e-3;

struct Relocated {
  Factors factors;
  Residues linear;
};

Relocated fitted_from(const WeightedResponse& p, Factors factors) {
  Relocated best{factors, residues_of(p, factors)};
  for (int i = 0; i < kRelocations; ++i) {
    factors = relocated(p, factors);
    if (factors.empty()) break;
    Residues linear = residues_of(p, factors);
    if (linear.cost < best.linear.cost) best = {factors, std::move(linear)};
  }
  return best;
}

/// Two real poles may become a pair, so that they are one factor.
Factors in_pairs(const Factors& factors) {
  Factors out;
  std::vector<double> real;
  for (const Factor& factor : factors) {
    if (factor.pair) {
      out.push_back(factor);
    } else {
      real.push_back(factor.b);
    }
  }
  std::sort(real.begin(), real.end());
  for (std::size_t i = 0; i + 1 < real.size(); i += 2)
    out.push_back({true, real[i] + real[i + 1], real[i] * real[i + 1]});
  if (real.size() % 2 == 1) out.push_back({false, 0.0, real.back()});
  return out;
}

/// All parameters at once: log a, log b of every factor, then the coefficients channel by channel.
class ResponseCost final : public ceres::CostFunction {
 public:
  ResponseCost(const WeightedResponse& p, Factors shape) : p_(p), factors_(std::move(shape)) {
    mutable_parameter_block_sizes()->push_back(
        static_cast<int>(nonlinear() + p.channels() * (nonlinear() + 1)));
    set_num_residuals(static_cast<int>(2 * p.s.size() * p.channels()));
  }

  [[nodiscard]] Index nonlinear() const { return order_of(factors_); }
  [[nodiscard]] Factors factors_at(const double* x) const {
    Factors out = factors_;
    for (Factor& factor : out) {
      if (factor.pair) factor.a = std::exp(*x++);
      factor.b = std::exp(*x++);
    }
    return out;
  }
  [[nodiscard]] VectorXd parameters(const Relocated& at) const {
    VectorXd out(parameter_block_sizes()[0]);
    Index i = 0;
    for (const Factor& factor : at.factors) {
      if (factor.pair) out(i++) = std::log(factor.a);
      out(i++) = std::log(factor.b);
    }
    for (Index c = 0; c < p_.channels(); ++c) {
      const Index n = at.linear.coefficients.cols();
      out.segment(i, n) = at.linear.coefficients.row(c).transpose();
      i += n;
    }
    return out;
  }

  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override {
    const double* x = parameters[0];
    const Index rows = p_.s.size(), poles = nonlinear(), n = poles + 1;
    if ((Eigen::Map<const Eigen::ArrayXd>(x, poles).abs() > kMaxLogCoefficient).any()) return false;
    const Factors factors = factors_at(x);
    const Eigen::MatrixXcd basis = basis_of(factors, p_.s);
    using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
    const bool wanted = jacobians != nullptr && jacobians[0] != nullptr;
    Eigen::Map<RowMajor> jacobian(wanted ? jacobians[0] : nullptr, wanted ? num_residuals() : 0,
                                  parameter_block_sizes()[0]);
    if (wanted) jacobian.setZero();
    for (Index c = 0; c < p_.channels(); ++c) {
      const Eigen::Map<const VectorXd> k(x + poles + c * n, n);
      const Eigen::VectorXcd w = p_.weight.col(c).cast<Complex>();
      const Eigen::VectorXcd left = w.cwiseProduct(basis * k.cast<Complex>() - p_.response.col(c));
      Eigen::Map<VectorXd>(residuals + 2 * rows * c, 2 * rows) = stacked(left);
      if (!wanted) continue;
      const auto put = [&](Index column, const Eigen::VectorXcd& derivative) {
        jacobian.block(2 * rows * c, column, 2 * rows, 1) =
            stacked(Eigen::VectorXcd(w.cwiseProduct(derivative)));
      };
      for (Index j = 0; j < n; ++j) put(poles + c * n + j, basis.col(j));
      Index j = 0;
      for (const Factor& factor : factors) {
        const Eigen::VectorXcd inverse = basis.col(j + factor.poles() - 1);
        Eigen::VectorXcd share = k(j + factor.poles() - 1) * inverse;
        if (factor.pair) share += k(j) * basis.col(j);
        if (factor.pair) put(j, -factor.a * share.cwiseProduct(basis.col(j)));
        put(j + factor.poles() - 1, -factor.b * share.cwiseProduct(inverse));
        j += factor.poles();
      }
    }
    return true;
  }

 private:
  const WeightedResponse& p_;
  Factors factors_;  // what is a pair
};

/// Levenberg-Marquardt over all parameters.
Relocated refined(const WeightedResponse& p, const Relocated& start) {
  Relocated from{in_pairs(start.factors), {}};
  from.linear = residues_of(p, from.factors);
  auto* cost = new ResponseCost(p, from.factors);  // the problem below owns it
  VectorXd x = cost->parameters(from);
  ceres::Problem problem;
  problem.AddResidualBlock(cost, nullptr, x.data());
  Index i = 0;
  for (const Factor& factor : from.factors) {
    if (factor.pair && p.least_width > 0.0)
      problem.SetParameterLowerBound(x.data(), static_cast<int>(i), std::log(p.least_width));
    i += factor.poles();
  }
  solve_bounded(bounded_options(ceres::DENSE_QR, 60, 1e-12), problem);
  if (!x.allFinite()) return from;
  Relocated out{cost->factors_at(x.data()), {}};
  out.linear = residues_of(p, out.factors);
  return out.linear.cost < from.linear.cost ? out : from;
}

/// Pairs spread over the band, and a real pole where the order is odd.
Factors spread(double from, double to, int order, bool logarithmic) {
  Factors out;
  const int pairs = order / 2;
  for (int i = 0; i < pairs; ++i) {
    const double share = (i + 0.5) / pairs;
    const double omega =
        logarithmic ? from * std::pow(to / from, share) : from + (to - from) * share;
    out.push_back(pair_of(omega, kStartDamping));
  }
  if (order % 2 == 1) out.push_back({false, 0.0, std::sqrt(from * to)});
  return out;
}

/// The frequency around which the misfit is largest.
double worst_at(const WeightedResponse& p, const Relocated& fit) {
  const Eigen::MatrixXcd modelled =
      basis_of(fit.factors, p.s) * fit.linear.coefficients.transpose().cast<Complex>();
  const Eigen::ArrayXd wrong =
      ((modelled - p.response).array().abs() * p.weight.array()).square().rowwise().sum();
  const Index width = std::min(kPeakPoints, wrong.size());
  Index worst = 0;
  for (Index i = 0; i + width <= wrong.size(); ++i) {
    if (wrong.segment(i, width).sum() > wrong.segment(worst, width).sum()) worst = i;
  }
  return p.s(worst + width / 2).imag();
}

bool enough(const ResponsePoints& points, int order) {
  return points.omega.size() * points.response.cols() * 2 >
         order + points.response.cols() * (order + 1);
}

enum class Polish { kNone, kLeastSquares };

/// The fit of this order, with the fit of two poles fewer as one of the starts.
Relocated fitted(const WeightedResponse& p, int order, const Relocated* simpler, Polish polish) {
  const auto polished = [&](const Relocated& found) {
    return polish == Polish::kNone ? found : refined(p, found);
  };
  const double from = p.s(0).imag(), to = p.s(p.s.size() - 1).imag();
  std::vector<Factors> starts{spread(from, to, order, true), spread(from, to, order, false)};
  if (simpler != nullptr) {
    starts.push_back(simpler->factors);
    starts.back().push_back(pair_of(worst_at(p, *simpler), kPeakDamping));
  }
  Relocated best;
  best.linear.cost = std::numeric_limits<double>::infinity();
  for (const Factors& start : starts) {
    const Relocated found = polished(fitted_from(p, start));
    if (found.linear.cost < best.linear.cost) best = found;
  }
  if (simpler != nullptr) {  // the simpler fit's poles unchanged, in case vector fitting loses them
    const Relocated added = polished({starts.back(), residues_of(p, starts.back())});
    if (added.linear.cost < best.linear.cost) best = added;
  }
  return best;
}

/// The fits of orders 1 to `most`, each started from the one with two poles fewer.
std::vector<Relocated> grown(const WeightedResponse& p, int first, int step, int most,
                             Polish polish = Polish::kLeastSquares) {
  std::vector<Relocated> out;
  const auto back = static_cast<std::size_t>(2 / step);
  for (int order = first; order <= most; order += step) {
    const Relocated* simpler = out.size() >= back ? &out[out.size() - back] : nullptr;
    out.push_back(fitted(p, order, simpler, polish));
  }
  return out;
}

RationalFit described(const WeightedResponse& p, const Relocated& found, double delay_s) {
  RationalFit out;
  out.delay_s = delay_s;
  const Index n = found.linear.coefficients.cols(), channels = p.channels();
  ResponseCost cost(p, found.factors);
  const VectorXd x = cost.parameters(found);
  using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
  RowMajor jacobian(cost.num_residuals(), x.size());
  VectorXd residual(cost.num_residuals());
  const double* at = x.data();
  double* into = jacobian.data();
  cost.Evaluate(&at, residual.data(), &into);
  const double freedom = static_cast<double>(residual.size() - x.size());
  out.misfit = found.linear.cost / freedom;
  const VectorXd scale = jacobian.colwise().norm().cwiseMax(1e-300).cwiseInverse();
  const MatrixXd scaled = jacobian * scale.asDiagonal();
  const MatrixXd inverse = inverse_symmetric(scaled.transpose() * scaled);
  const MatrixXd covariance =
      p.overlap * std::max(1.0, out.misfit) * (scale.asDiagonal() * inverse * scale.asDiagonal());

  struct Described {
    FittedPole pole;
    MatrixXd columns;
  };
  std::vector<Described> all;
  Index j = 0;
  for (std::size_t i = 0; i < found.factors.size(); ++i) {
    const Factor& factor = found.factors[i];
    Described one;
    FittedPole& pole = one.pole;
    pole.pair = factor.pair;
    one.columns = p.unit * found.linear.coefficients.middleCols(j, factor.poles());
    if (factor.pair) {
      one.columns.col(1) *= p.unit;
      pole.omega = p.unit * std::sqrt(factor.b);
      pole.zeta = 0.5 * factor.a / std::sqrt(factor.b);
      pole.omega_deviation = 0.5 * pole.omega * std::sqrt(std::max(0.0, covariance(j + 1, j + 1)));
      pole.zeta_deviation =
          pole.zeta * std::sqrt(std::max(0.0, covariance(j, j) - covariance(j, j + 1) +
                                                  0.25 * covariance(j + 1, j + 1)));
    } else {
      pole.omega = p.unit * factor.b;
      pole.omega_deviation = pole.omega * std::sqrt(std::max(0.0, covariance(j, j)));
    }
    Factors others = found.factors;
    others.erase(others.begin() + static_cast<std::ptrdiff_t>(i));
    pole.explains = std::clamp(
        (residues_of(p, others).cost - found.linear.cost) / std::max(p.size, 1e-300), 0.0, 1.0);
    j += factor.poles();
    all.push_back(std::move(one));
  }
  std::stable_sort(all.begin(), all.end(), [](const Described& l, const Described& r) {
    return l.pole.explains > r.pole.explains;
  });
  out.coefficients.resize(channels, n);
  j = 0;
  for (const Described& one : all) {
    out.poles.push_back(one.pole);
    out.coefficients.middleCols(j, one.columns.cols()) = one.columns;
    j += one.columns.cols();
  }
  out.coefficients.col(n - 1) = found.linear.coefficients.col(n - 1);
  return out;
}

bool all_determined(const RationalFit& fit) {
  return std::all_of(fit.poles.begin(), fit.poles.end(),
                     [](const FittedPole& pole) { return pole.determined(); });
}

}  // namespace

int RationalFit::order() const {
  return std::accumulate(poles.begin(), poles.end(), 0,
                         [](int sum, const FittedPole& p) { return sum + (p.pair ? 2 : 1); });
}

Complex RationalFit::at(Index channel, double omega) const {
  const Complex s(0.0, omega);
  Complex out = coefficients(channel, coefficients.cols() - 1);
  Index j = 0;
  for (const FittedPole& pole : poles) {
    if (pole.pair) {
      out += (coefficients(channel, j) * s + coefficients(channel, j + 1)) /
             (s * s + 2.0 * pole.zeta * pole.omega * s + pole.omega * pole.omega);
      j += 2;
    } else {
      out += coefficients(channel, j++) / (s + pole.omega);
    }
  }
  return out * std::polar(1.0, -omega * delay_s);
}

std::optional<RationalFit> fit_rational(const ResponsePoints& points, int order,
                                        const RationalOptions& options) {
  if (order < 1 || order > kMaxPoles || !enough(points, order)) return std::nullopt;
  const WeightedResponse p(points, options);
  const std::vector<Relocated> fits = grown(p, order % 2 == 1 ? 1 : 2, 2, order);
  if (!std::isfinite(fits.back().linear.cost)) return std::nullopt;
  return described(p, fits.back(), options.delay_s);
}

std::vector<std::vector<FittedPole>> starting_poles(const ResponsePoints& points, int most) {
  while (most > 0 && !enough(points, most)) --most;
  std::vector<std::vector<FittedPole>> out;
  if (most == 0) return out;
  const WeightedResponse p(points, {});
  for (const Relocated& fit : grown(p, 1, 1, most, Polish::kNone)) {
    out.emplace_back();
    for (const Factor& factor : in_pairs(fit.factors)) {
      FittedPole pole;
      pole.pair = factor.pair;
      pole.omega = p.unit * (factor.pair ? std::sqrt(factor.b) : factor.b);
      if (factor.pair) pole.zeta = factor.a / (2.0 * std::sqrt(factor.b));
      out.back().push_back(pole);
    }
  }
  return out;
}

std::optional<ChosenFit> fit_rational_order(const ResponsePoints& all,
                                            const std::array<ResponsePoints, 2>& halves, int most,
                                            const RationalOptions& options) {
  most = std::min(most, kMaxPoles);
  while (most > 0 && !enough(all, most)) --most;
  if (most == 0) return std::nullopt;
  const std::array<WeightedResponse, 2> half{WeightedResponse(halves[0], options),
                                             WeightedResponse(halves[1], options)};
  // Squared errors of every order at every frequency, of both halves on the other.
  MatrixXd wrong = MatrixXd::Zero(all.omega.size(), most);
  for (std::size_t h = 0; h < 2; ++h) {
    const WeightedResponse& judge = half[1 - h];
    const std::vector<Relocated> fits = grown(half[h], 1, 1, most);
    for (int i = 0; i < most; ++i) {
      const Relocated& fit = fits[static_cast<std::size_t>(i)];
      const Eigen::MatrixXcd modelled =
          basis_of(fit.factors, judge.s) * fit.linear.coefficients.transpose().cast<Complex>();
      wrong.col(i) += (((modelled - judge.response).array().abs() * judge.weight.array())
                           .square()
                           .rowwise()
                           .sum())
                          .matrix();
    }
  }
  Index best = 0;
  const VectorXd sums = wrong.colwise().sum().transpose();
  if (!sums.allFinite()) return std::nullopt;
  sums.minCoeff(&best);
  Index chosen = best;
  const double points = 4.0 * static_cast<double>(all.omega.size() * all.response.cols());
  for (Index i = 0; i < best; ++i) {
    const Eigen::ArrayXd more = (wrong.col(i) - wrong.col(best)).array();
    const Index blocks = std::max<Index>(2, more.size() / kBlock);
    Eigen::ArrayXd sum(blocks);
    for (Index k = 0; k < blocks; ++k) {
      const Index begin = k * more.size() / blocks, end = (k + 1) * more.size() / blocks;
      sum(k) = more.segment(begin, end - begin).sum();
    }
    const double error = std::sqrt((sum - sum.mean()).square().sum());
    if (more.sum() <= std::max(error, kMinMisfitDifference * points)) {
      chosen = i;
      break;
    }
  }
  const WeightedResponse whole(all, options);
  const std::vector<Relocated> fits = grown(whole, 1, 1, static_cast<int>(chosen) + 1);
  const auto fit_of = [&](Index i) {
    return described(whole, fits[static_cast<std::size_t>(i)], options.delay_s);
  };
  ChosenFit out{fit_of(chosen), {}};
  for (Index i = chosen; i >= 0 && sums(i) <= kMaxMisfitRatio * sums(chosen); --i) {
    if (RationalFit fit = fit_of(i); all_determined(fit)) {
      out.fit = std::move(fit);
      chosen = i;
      break;
    }
  }
  for (Index i = 0; i < most; ++i)
    out.trials.push_back({static_cast<int>(i) + 1, sums(i) / points, i == chosen});
  return out;
}

}  // namespace servotwin
