#include "identification/torque/control_law.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "twin/linear_algebra.h"

namespace servotwin {

namespace {

constexpr Eigen::Index kLags = 6, kFirst = 5, kColumns = kFirst + 2 * kLags;
constexpr double kLag_s = 1e-3;         // between two lags, or a sampling time
constexpr double kSpan_s = 2e-3;        // to each side, of velocity and acceleration
constexpr double kSignBefore_s = 4e-3;  // of the friction's feed-forward, behind filters
constexpr Eigen::Index kMostRows = 30'000, kRowsPerLawColumn = 20;

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
    position_ = s.command;
    v_.resize(n), a_.resize(n), integral_.resize(n);
    double integral = 0.0;
    for (Eigen::Index k = 0; k < n; ++k) {
      v_(k) = (command(k + span) - command(k - span)) / (2.0 * span_s);
      a_(k) = (command(k + span) - 2.0 * command(k) + command(k - span)) / (span_s * span_s);
      integral_(k) = integral += s.sample_time_s * e_(k);
    }
    first_ = std::max(sign_before_, (kLags - 1) * lag_) + span;
    last_ = n - 1 - span;
  }
  /// Whether all that the law needs lies within the segment.
  [[nodiscard]] bool knows(Eigen::Index k) const { return k >= first_ && k <= last_; }
  [[nodiscard]] Row at(Eigen::Index k) const {
    const auto ago = [&](const Eigen::ArrayXd& x, Eigen::Index count) { return x(k - count); };
    const auto sign = [](double value) {
      return static_cast<double>((value > 0.0) - (value < 0.0));
    };
    Row out;
    out.head<kFirst>() << sign(v_(k)), sign(ago(v_, sign_before_)), v_(k), position_(k),
        integral_(k);
    for (Eigen::Index j = 0; j < kLags; ++j) {
      out(kFirst + j) = ago(e_, j * lag_);
      out(kFirst + kLags + j) = ago(a_, j * lag_);
    }
    return out;
  }

 private:
  static Eigen::Index samples(const Segment& s, double time_s) {
    return std::max<Eigen::Index>(1, std::lround(time_s / s.sample_time_s));
  }

  Eigen::Index lag_, sign_before_, first_ = 0, last_ = -1;
  Eigen::ArrayXd e_, position_, v_, a_, integral_;
};

}  // namespace

std::vector<Eigen::ArrayXd> asked_torque(
    const std::vector<Segment>& segments,
    const std::function<bool(std::size_t, Eigen::Index)>& fits) {
  struct Mean {
    Row row = Row::Zero();
    double torque = 0.0, count = 0.0;
  };
  std::vector<Inputs> inputs;
  std::vector<Mean> means;  // of the fitted samples of a segment: what they share is its constant
  std::vector<std::pair<std::size_t, Eigen::Index>> places;
  for (std::size_t i = 0; i < segments.size(); ++i) {
    const Segment& s = segments[i];
    if (s.actual.size() != s.size() || s.torque.size() != s.size()) return {};
    inputs.emplace_back(s);
    Mean& mean = means.emplace_back();
    for (Eigen::Index k = 0; k < s.size(); ++k) {
      if (!std::isfinite(s.torque(k)) || !inputs[i].knows(k) || !fits(i, k)) continue;
      places.emplace_back(i, k);
      mean.row += inputs[i].at(k);
      mean.torque += s.torque(k);
      mean.count += 1.0;
    }
    mean.row /= std::max(1.0, mean.count);
    mean.torque /= std::max(1.0, mean.count);
  }
  const auto count = static_cast<Eigen::Index>(places.size());
  if (count < kRowsPerLawColumn * kColumns) return {};
  // Not every n-th sample, which a periodic motion may always have at the same places.
  constexpr Eigen::Index kSpread = 7919;  // a prime
  const Eigen::Index every = 1 + (count - 1) / kMostRows, rows = count / every;
  Eigen::MatrixXd x(rows, kColumns);
  Eigen::VectorXd y(rows);
  for (Eigen::Index row = 0; row < rows; ++row) {
    const auto [i, k] = places[static_cast<std::size_t>(row * every + (row * kSpread) % every)];
    x.row(row) = inputs[i].at(k) - means[i].row;
    y(row) = segments[i].torque(k) - means[i].torque;
  }
  Eigen::VectorXd scale = x.colwise().norm();
  scale = (scale.array() > 0.0).select(scale, 1.0);
  const Eigen::VectorXd law =
      least_squares(x * scale.cwiseInverse().asDiagonal(), y).cwiseQuotient(scale);
  std::vector<Eigen::ArrayXd> asked;
  for (std::size_t i = 0; i < segments.size(); ++i) {
    Eigen::ArrayXd& of = asked.emplace_back(Eigen::ArrayXd::Constant(segments[i].size(), kAbsent));
    for (Eigen::Index k = 0; k < of.size() && means[i].count > 0.0; ++k) {
      if (inputs[i].knows(k)) of(k) = means[i].torque + (inputs[i].at(k) - means[i].row) * law;
    }
  }
  return asked;
}

}  // namespace servotwin
