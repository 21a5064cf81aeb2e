#include "identification/torque/control_law.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "twin/linear_algebra.h"

namespace servotwin {

namespace {

constexpr Eigen::Index kLags = 6, kColumns = 5 + 2 * kLags;
constexpr double kLag_s = 1e-3;         // between two lags, or a sampling time
constexpr double kSpan_s = 2e-3;        // to each side, of velocity and acceleration
constexpr double kSignBefore_s = 4e-3;  // of the friction's feed-forward, behind filters
constexpr Eigen::Index kMostRows = 30'000, kRowsPerColumn = 20;

using Row = Eigen::Matrix<double, 1, kColumns>;

/// The columns of the law along a segment.
class Inputs {
 public:
  explicit Inputs(const Segment& s)
      : lag_(samples(s, kLag_s)),
        sign_before_(samples(s, kSignBefore_s)),
        e_(s.command - s.actual) {
    const Eigen::Index n = s.size(), span = samples(s, kSpan_s);
    const double span_s = s.sample_time_s * static_cast<double>(span);
    const auto command = [&](Eigen::Index k) {
      return s.command(std::clamp<Eigen::Index>(k, 0, n - 1));
    };
    v_.resize(n), a_.resize(n), integral_.resize(n);
    double integral = 0.0;
    for (Eigen::Index k = 0; k < n; ++k) {
      v_(k) = (command(k + span) - command(k - span)) / (2.0 * span_s);
      a_(k) = (command(k + span) - 2.0 * command(k) + command(k - span)) / (span_s * span_s);
      integral_(k) = integral += s.sample_time_s * e_(k);
    }
  }
  [[nodiscard]] Row at(Eigen::Index k) const {
    const auto ago = [&](const Eigen::ArrayXd& x, Eigen::Index count) {
      return x(std::max<Eigen::Index>(0, k - count));
    };
    const auto sign = [](double value) {
      return static_cast<double>((value > 0.0) - (value < 0.0));
    };
    Row out;
    out.head<5>() << 1.0, sign(v_(k)), sign(ago(v_, sign_before_)), v_(k), integral_(k);
    for (Eigen::Index j = 0; j < kLags; ++j) {
      out(5 + j) = ago(e_, j * lag_);
      out(5 + kLags + j) = ago(a_, j * lag_);
    }
    return out;
  }

 private:
  static Eigen::Index samples(const Segment& s, double time_s) {
    return std::max<Eigen::Index>(1, std::lround(time_s / s.sample_time_s));
  }

  Eigen::Index lag_, sign_before_;
  Eigen::ArrayXd e_, v_, a_, integral_;
};

}  // namespace

std::vector<Eigen::ArrayXd> asked_torque(
    const std::vector<Segment>& segments,
    const std::function<bool(std::size_t, Eigen::Index)>& fits) {
  std::vector<Inputs> inputs;
  std::vector<std::pair<std::size_t, Eigen::Index>> places;
  for (std::size_t i = 0; i < segments.size(); ++i) {
    const Segment& s = segments[i];
    if (s.actual.size() != s.size() || s.torque.size() != s.size()) return {};
    inputs.emplace_back(s);
    for (Eigen::Index k = 0; k < s.size(); ++k) {
      if (std::isfinite(s.torque(k)) && fits(i, k)) places.emplace_back(i, k);
    }
  }
  const auto count = static_cast<Eigen::Index>(places.size());
  if (count < kRowsPerColumn * kColumns) return {};
  const Eigen::Index every = 1 + (count - 1) / kMostRows, rows = 1 + (count - 1) / every;
  Eigen::MatrixXd x(rows, kColumns);
  Eigen::VectorXd y(rows);
  for (Eigen::Index row = 0; row < rows; ++row) {
    const auto [i, k] = places[static_cast<std::size_t>(row * every)];
    x.row(row) = inputs[i].at(k);
    y(row) = segments[i].torque(k);
  }
  Eigen::VectorXd scale = x.colwise().norm();
  scale = (scale.array() > 0.0).select(scale, 1.0);
  const Eigen::VectorXd law =
      least_squares(x * scale.cwiseInverse().asDiagonal(), y).cwiseQuotient(scale);
  std::vector<Eigen::ArrayXd> asked;
  for (std::size_t i = 0; i < segments.size(); ++i) {
    Eigen::ArrayXd& of = asked.emplace_back(segments[i].size());
    for (Eigen::Index k = 0; k < of.size(); ++k) of(k) = inputs[i].at(k) * law;
  }
  return asked;
}

}  // namespace servotwin
