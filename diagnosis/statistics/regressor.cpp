#include "diagnosis/statistics/regressor.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>
#include <random>

#include "twin/sample.h"

namespace servotwin {

namespace {

constexpr Eigen::Index kSamples = 6000;      // the data are thinned to about this number
constexpr Eigen::Index kScanSamples = 3000;  // and to this one for the scan of periods
constexpr int kShuffles = 999, kScans = 99;  // number of shuffles, without the unshuffled data
constexpr int kBins = 20;
constexpr double kMaxRestSpeedShare =
    0.005;  // share of the peak speed below which the axis is at rest

/// The thinned data: the residual without its mean, and the value of every variable.
struct Samples {
  Eigen::ArrayXd residual;
  std::array<Eigen::ArrayXd, kRegressors> value;
  double h = 0.0;
};

Samples samples_of(std::span<const ResidualStretch> stretches) {
  Eigen::Index all = 0;
  for (const ResidualStretch& s : stretches) all += s.residual.size();
  const Eigen::Index every = std::max<Eigen::Index>(1, (all + kSamples - 1) / kSamples);
  std::vector<double> residual;
  std::array<std::vector<double>, kRegressors> values;
  double fastest = 0.0;
  std::vector<Variables> variables;
  for (const ResidualStretch& s : stretches) {
    variables.push_back(variables_of(s));
    for (const double v : variables.back().velocity) {
      if (std::isfinite(v)) fastest = std::max(fastest, std::abs(v));
    }
  }
  for (std::size_t i = 0; i < stretches.size(); ++i) {
    const Variables& v = variables[i];
    for (Eigen::Index k = 0; k < stretches[i].residual.size(); k += every) {
      if (!std::isfinite(stretches[i].residual(k)) || !std::isfinite(v.velocity(k))) continue;
      residual.push_back(stretches[i].residual(k));
      const bool moving = std::abs(v.velocity(k)) > kMaxRestSpeedShare * fastest;
      const std::array<double, kRegressors> row{
          v.velocity(k),     !moving ? 0.0 : v.velocity(k) > 0.0 ? 1.0 : -1.0,
          v.position(k),     moving ? v.position(k) : kAbsent,
          v.acceleration(k), v.since_reversal_s(k),
          v.since_rest_s(k), v.time(k)};
      for (std::size_t r = 0; r < kRegressors; ++r) values[r].push_back(row[r]);
    }
  }
  Samples out;
  const auto n = static_cast<Eigen::Index>(residual.size());
  out.residual = Eigen::Map<Eigen::ArrayXd>(residual.data(), n);
  if (n > 0) out.residual -= out.residual.mean();
  for (std::size_t r = 0; r < kRegressors; ++r)
    out.value[r] = Eigen::Map<Eigen::ArrayXd>(values[r].data(), n);
  out.h = (stretches.empty() ? 0.0 : stretches.front().h) * static_cast<double>(every);
  return out;
}

/// Length of the shuffled blocks [samples]: the residual is uncorrelated over it.
Eigen::Index block_of(const Samples& s) {
  const Eigen::Index n = s.residual.size();
  const double power = s.residual.square().mean();
  double area = 0.5;
  for (Eigen::Index lag = 1; lag < n / 10; ++lag) {
    const double c = (s.residual.head(n - lag) * s.residual.tail(n - lag)).mean() / power;
    if (!(c > 0.05)) break;
    area += c;
  }
  const auto least = std::max<Eigen::Index>(2, std::lround(0.25 / s.h));
  return std::clamp<Eigen::Index>(static_cast<Eigen::Index>(20.0 * area), least,
                                  std::max<Eigen::Index>(least, n / 20));
}

/// The indices of the samples in the order of the shuffled blocks.
std::vector<Eigen::Index> shuffled(Eigen::Index n, Eigen::Index block, std::mt19937_64& random) {
  std::vector<Eigen::Index> order(static_cast<std::size_t>((n + block - 1) / block));
  std::iota(order.begin(), order.end(), 0);
  std::shuffle(order.begin(), order.end(), random);
  std::vector<Eigen::Index> out;
  out.reserve(static_cast<std::size_t>(n));
  for (const Eigen::Index b : order) {
    for (Eigen::Index k = b * block; k < std::min(n, (b + 1) * block); ++k) out.push_back(k);
  }
  return out;
}

/// The bin of every sample; -1 where the variable has no value. The edges are quantiles; equal ones
/// are merged.
std::vector<int> places_of(const Eigen::ArrayXd& x) {
  std::vector<double> sorted;
  for (const double value : x) {
    if (std::isfinite(value)) sorted.push_back(value);
  }
  std::vector<int> out(static_cast<std::size_t>(x.size()), -1);
  if (sorted.empty()) return out;
  std::sort(sorted.begin(), sorted.end());
  std::vector<double> edges;
  for (int i = 1; i < kBins; ++i) {
    const double edge = sorted[sorted.size() * static_cast<std::size_t>(i) / kBins];
    if (edge > sorted.front() && (edges.empty() || edge > edges.back())) edges.push_back(edge);
  }
  for (Eigen::Index k = 0; k < x.size(); ++k) {
    if (!std::isfinite(x(k))) continue;
    out[static_cast<std::size_t>(k)] =
        static_cast<int>(std::upper_bound(edges.begin(), edges.end(), x(k)) - edges.begin());
  }
  return out;
}

/// Sum of squares explained by the means of the bins, where the k-th sample has the residual
/// (*order)[k]; `order` null: its own.
double explained(const std::vector<int>& places, const Eigen::ArrayXd& residual,
                 const std::vector<Eigen::Index>* order) {
  std::array<double, kBins + 1> sum{}, count{};
  for (std::size_t k = 0; k < places.size(); ++k) {
    const auto b = static_cast<std::size_t>(places[k] + 1);
    sum[b] += residual(order != nullptr ? (*order)[k] : static_cast<Eigen::Index>(k));
    count[b] += 1.0;
  }
  double out = 0.0;
  for (std::size_t b = 1; b < sum.size(); ++b) {
    if (count[b] > 0.0) out += sum[b] * sum[b] / count[b];
  }
  return out;
}

/// Fills in the best period, and the share of the variance that its sine and cosine explain.
void scan_periods(const Samples& s, Eigen::Index block, std::mt19937_64& random,
                  RegressorShare& out) {
  const Eigen::ArrayXd& x = s.value[static_cast<std::size_t>(Regressor::kPositionInPeriod)];
  const Eigen::Index n = s.residual.size(),
                     every = std::max<Eigen::Index>(1, (n + kScanSamples - 1) / kScanSamples);
  const Eigen::Index m = n / every;
  double low = 1e300, high = -1e300;
  for (const double value : x) {
    if (std::isfinite(value)) low = std::min(low, value), high = std::max(high, value);
  }
  if (!(high > low) || m < 100) return;
  constexpr int kMinPeriodsOverTravel = 3, kMaxPeriodsOverTravel = 200, kScanStepsPerPeriod = 2;
  const Eigen::Index waves = (kMaxPeriodsOverTravel - kMinPeriodsOverTravel) * kScanStepsPerPeriod;
  Eigen::MatrixXf right(m, kScans + 1);
  for (int column = 0; column <= kScans; ++column) {
    const std::vector<Eigen::Index> order =
        column == 0 ? std::vector<Eigen::Index>{} : shuffled(n, block, random);
    for (Eigen::Index i = 0; i < m; ++i) {
      const Eigen::Index k = i * every;
      const Eigen::Index from = column == 0 ? k : order[static_cast<std::size_t>(k)];
      right(i, column) = std::isfinite(x(k)) ? static_cast<float>(s.residual(from)) : 0.0F;
    }
  }
  const float size = std::max(1e-30F, right.col(0).norm());
  right /= size;
  Eigen::MatrixXf sine(waves, m), cosine(waves, m);
  Eigen::Index moving = 0;
  for (Eigen::Index i = 0; i < m; ++i) {
    const double place = std::isfinite(x(i * every)) ? (x(i * every) - low) / (high - low) : 0.0;
    moving += std::isfinite(x(i * every)) ? 1 : 0;
    for (Eigen::Index w = 0; w < waves; ++w) {
      const double angle = 2.0 * std::numbers::pi *
                           (kMinPeriodsOverTravel + static_cast<double>(w) / kScanStepsPerPeriod) *
                           place;
      sine(w, i) = static_cast<float>(std::sin(angle));
      cosine(w, i) = static_cast<float>(std::cos(angle));
    }
  }
  const Eigen::MatrixXf power = (sine * right).cwiseAbs2() + (cosine * right).cwiseAbs2();
  Eigen::Index best = 0;
  const double peak = power.col(0).maxCoeff(&best);
  // The variance of all scanned samples, in the scale of `right`.
  double all = 0.0;
  for (Eigen::Index i = 0; i < m; ++i) all += std::pow(s.residual(i * every) / size, 2);
  const double to_share = 2.0 / (static_cast<double>(moving) * all);
  out.share = std::min(1.0, to_share * peak);
  out.chance = to_share * power.rightCols(kScans).maxCoeff();
  out.period =
      (high - low) / (kMinPeriodsOverTravel + static_cast<double>(best) / kScanStepsPerPeriod);
  out.significant = out.share > out.chance;
}

}  // namespace

std::string_view name_of(Regressor regressor) {
  constexpr std::array<std::string_view, kRegressors> kNames{
      "velocity",     "direction",           "position",        "position_in_period",
      "acceleration", "time_since_reversal", "time_since_rest", "time"};
  return kNames[static_cast<std::size_t>(regressor)];
}

Variables variables_of(const ResidualStretch& stretch) {
  Variables out;
  const Eigen::Index n = stretch.command.size();
  CommandMotion motion = motion_of(stretch);
  out.velocity = std::move(motion.velocity);
  out.acceleration = std::move(motion.acceleration);
  out.position = stretch.command;
  out.time =
      stretch.start_s + stretch.h * Eigen::ArrayXd::LinSpaced(n, 0.0, static_cast<double>(n - 1));
  out.since_reversal_s = Eigen::ArrayXd::Constant(n, kAbsent);
  out.since_rest_s = out.travel = out.since_reversal_s;
  double fastest = 0.0;
  for (const double v : out.velocity) {
    if (std::isfinite(v)) fastest = std::max(fastest, std::abs(v));
  }
  int direction = 0;
  Eigen::Index reversal = -1, rest = -1;
  for (Eigen::Index k = 0; k < n; ++k) {
    const double v = out.velocity(k);
    if (std::abs(v) > kMaxRestSpeedShare * fastest) {
      const int now = v > 0.0 ? 1 : -1;
      if (direction != 0 && now != direction) reversal = k;
      direction = now;
    } else if (std::isfinite(v)) {
      rest = k;
    }
    if (reversal >= 0) {
      out.since_reversal_s(k) = stretch.h * static_cast<double>(k - reversal);
      out.travel(k) = std::abs(stretch.command(k) - stretch.command(reversal));
    }
    if (rest >= 0) out.since_rest_s(k) = stretch.h * static_cast<double>(k - rest);
  }
  return out;
}

RegressorShares by_regressor(std::span<const ResidualStretch> stretches) {
  RegressorShares out;
  for (std::size_t r = 0; r < kRegressors; ++r) out[r].regressor = static_cast<Regressor>(r);
  const Samples s = samples_of(stretches);
  const Eigen::Index n = s.residual.size();
  const double all = s.residual.square().sum();
  if (n < 200 || !(all > 0.0)) return out;
  const Eigen::Index block = block_of(s);
  std::mt19937_64 random(1);
  std::array<std::vector<int>, kRegressors> places;
  for (std::size_t r = 0; r < kRegressors; ++r) {
    places[r] = places_of(s.value[r]);
    out[r].share = explained(places[r], s.residual, nullptr) / all;
  }
  for (int i = 0; i < kShuffles; ++i) {
    const std::vector<Eigen::Index> order = shuffled(n, block, random);
    for (std::size_t r = 0; r < kRegressors; ++r)
      out[r].chance = std::max(out[r].chance, explained(places[r], s.residual, &order) / all);
  }
  for (RegressorShare& one : out) one.significant = one.share > one.chance;
  RegressorShare& periodic = out[static_cast<std::size_t>(Regressor::kPositionInPeriod)];
  periodic = {.regressor = Regressor::kPositionInPeriod};
  scan_periods(s, block, random, periodic);
  return out;
}

std::vector<Bin> bins_of(const Eigen::ArrayXd& x, const Eigen::ArrayXd& y, int most) {
  constexpr Eigen::Index kMinSamplesPerBin = 8;
  double low = 1e300, high = -1e300;
  for (Eigen::Index k = 0; k < x.size(); ++k) {
    if (!std::isfinite(x(k)) || !std::isfinite(y(k))) continue;
    low = std::min(low, x(k)), high = std::max(high, x(k));
  }
  std::vector<Bin> out;
  if (!(low <= high)) return out;
  // Consecutive samples in a bin form a run. Runs, not samples, are taken as independent.
  struct Sums {
    double x = 0.0, y = 0.0;
    Eigen::Index count = 0;
    std::vector<std::pair<double, Eigen::Index>> runs;
  };
  std::vector<Sums> sums(static_cast<std::size_t>(most));
  std::size_t last = sums.size();
  for (Eigen::Index k = 0; k < x.size(); ++k) {
    if (!std::isfinite(x(k)) || !std::isfinite(y(k))) {
      last = sums.size();
      continue;
    }
    const double place = high > low ? (x(k) - low) / (high - low) : 0.0;
    const auto b = std::min(sums.size() - 1, static_cast<std::size_t>(place * most));
    Sums& s = sums[b];
    s.x += x(k), s.y += y(k), ++s.count;
    if (b != last) s.runs.emplace_back(0.0, 0);
    s.runs.back().first += y(k), ++s.runs.back().second;
    last = b;
  }
  for (const Sums& s : sums) {
    if (s.count < kMinSamplesPerBin) continue;
    const auto count = static_cast<double>(s.count);
    Bin bin{s.x / count, s.y / count, 0.0, s.count};
    // Sum over runs of the squared sum of deviations (clusters; Liang and Zeger 1986).
    double square = 0.0;
    for (const auto& [sum, samples] : s.runs)
      square += std::pow(sum - static_cast<double>(samples) * bin.mean, 2);
    bin.deviation = std::sqrt(square) / count;
    out.push_back(bin);
  }
  return out;
}

}  // namespace servotwin
