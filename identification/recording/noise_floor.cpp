#include "identification/recording/noise_floor.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <numeric>

#include "identification/recording/order_statistics.h"

namespace servotwin {

namespace {

constexpr Eigen::Index kFewestRowsOfLaps = 200;

/// The encoder's step: all readings, sorted by position, differ by multiples of it. Motion may be
/// too fast to pass through single steps in time; somewhere on the axis two readings are a few
/// steps apart. Values that were interpolated over a gap lie anywhere between the steps: a few of
/// them must not decide, and among many there is no step to be seen.
double encoder_step(const std::vector<Segment>& segments) {
  std::vector<double> readings;
  for (const Segment& s : segments)
    readings.insert(readings.end(), s.actual.begin(), s.actual.end());
  std::sort(readings.begin(), readings.end());
  std::vector<double> apart;
  for (std::size_t i = 1; i < readings.size(); ++i) {
    const double d = readings[i] - readings[i - 1];
    if (d > 1e-13) apart.push_back(d);
  }
  if (apart.size() < 100) return 0.0;
  std::sort(apart.begin(), apart.end());
  // Multiples of a step are multiples of half a step as well: the largest candidate is the step.
  constexpr double kTolerance = 0.12;
  const auto below = [&](double limit) {
    return std::lower_bound(apart.begin(), apart.end(), limit);
  };
  for (auto next = apart.end(); next != apart.begin(); next = below(0.94 * *next)) {
    --next;
    const auto first = below((1.0 - kTolerance) * *next), last = below((1.0 + kTolerance) * *next);
    // Only small multiples count: the error of `step` itself grows with the multiple.
    const double step = std::accumulate(first, last, 0.0) / static_cast<double>(last - first);
    const auto end = below(8.5 * step);
    const auto all = end - apart.begin();
    if (all < 12) break;
    if (5 * (first - apart.begin()) > all) continue;
    const auto multiples = std::count_if(first, end, [&](double d) {
      return std::abs(d / step - std::round(d / step)) < kTolerance;
    });
    if (5 * multiples > 4 * all) return step;
  }
  return 0.0;
}

/// Whether the recorder repeats readings of an axis that moves on: more equal neighbours than steps
/// of this size between the others could leave.
bool is_held(const Eigen::ArrayXd& block, double encoder_step) {
  constexpr double kMinShareOfHeld = 0.1;
  std::vector<double> steps;
  for (Eigen::Index i = 1; i < block.size(); ++i) {
    if (block(i) != block(i - 1)) steps.push_back(std::abs(block(i) - block(i - 1)));
  }
  const double held =
      1.0 - static_cast<double>(steps.size()) / static_cast<double>(block.size() - 1);
  return held > kMinShareOfHeld && held * median(steps) > encoder_step;
}

/// The white part of a signal. In the upper half of its band the motion of an axis is weakest; each
/// frequency of each short block there shows the square of the noise, exponentially distributed,
/// and what the motion, a tone, a push or a step of stick and slip adds to it.
class White {
 public:
  void add(const Segment& segment, double encoder_step) {
    for (Eigen::Index at = 0; at + kRows <= segment.size(); at += kBlock / 2) {
      const Eigen::ArrayXd block = segment.actual.segment(at, kRows) - segment.actual(at);
      if (is_held(block, encoder_step)) continue;
      const Eigen::VectorXd parts = waves() * block.matrix();
      // Of readings without noise, what the window and the rounding of numbers leave.
      const double least = 1e-13 * segment.actual.segment(at, kRows).abs().maxCoeff();
      for (Eigen::Index line = 0; line < kLines; ++line) {
        const double square = parts.segment<2>(2 * line).squaredNorm();
        if (square > least * least) squares_[static_cast<std::size_t>(line)].push_back(square);
      }
    }
  }
  /// Of all lines; the interval holds those of the single lines, which would be the same but for
  /// chance if nothing else were in the band.
  [[nodiscard]] RmsEstimate rms() const {
    std::vector<double> all;
    for (const std::vector<double>& line : squares_)
      all.insert(all.end(), line.begin(), line.end());
    RmsEstimate out{std::sqrt(least_mean(std::move(all)))};
    out.low = out.high = out.rms;
    for (const std::vector<double>& line : squares_) {
      const double one = std::sqrt(least_mean(line));
      if (!std::isfinite(one)) return {};
      out.low = std::min(out.low, one);
      out.high = std::max(out.high, one);
    }
    return out;
  }

 private:
  // Fourth differences leave nothing of a cubic, the path of an axis at limited jerk.
  static constexpr Eigen::Index kDifferences = 4, kBlock = 32, kRows = kBlock + kDifferences;
  // Periods a block: from a quarter of the sampling rate to just below the half of it.
  static constexpr Eigen::Index kFirstLine = 8, kLines = 7;

  /// Cosine and sine of each line under a Hann window, of fourth differences, for white noise of 1.
  static const Eigen::MatrixXd& waves() {
    static const Eigen::MatrixXd all = [] {
      constexpr std::array<double, kDifferences + 1> kBinomial{1.0, -4.0, 6.0, -4.0, 1.0};
      Eigen::MatrixXd out = Eigen::MatrixXd::Zero(2 * kLines, kRows);
      for (Eigen::Index line = 0; line < kLines; ++line) {
        for (Eigen::Index i = 0; i < kBlock; ++i) {
          const double turn =
              std::numbers::pi * (static_cast<double>(i) + 0.5) / static_cast<double>(kBlock);
          const double angle = 2.0 * static_cast<double>(kFirstLine + line) * turn;
          const double window = std::sin(turn) * std::sin(turn);
          for (Eigen::Index k = 0; k <= kDifferences; ++k) {
            const double weight = window * kBinomial[static_cast<std::size_t>(k)];
            out(2 * line, i + k) += weight * std::cos(angle);
            out(2 * line + 1, i + k) += weight * std::sin(angle);
          }
        }
        out.middleRows<2>(2 * line) /= out.middleRows<2>(2 * line).norm();
      }
      return out;
    }();
    return all;
  }

  /// The mean of exponentially distributed values, some of which are larger for another reason:
  /// from those below 1.5 times that mean, which is found from below.
  static double least_mean(std::vector<double> values) {
    constexpr std::size_t kFewest = 20;
    constexpr double kCut = 1.5;  // larger: more of the noise, and of what is not
    const double mean_below = 1.0 - kCut / std::expm1(kCut);
    if (values.size() < kFewest) return kAbsent;
    std::sort(values.begin(), values.end());
    std::vector<double> sums(values.size() + 1, 0.0);
    std::partial_sum(values.begin(), values.end(), sums.begin() + 1);
    double mean = values[values.size() / 10] / -std::log(0.9);
    for (int i = 0; i < 200; ++i) {
      const auto below =
          std::upper_bound(values.begin(), values.end(), kCut * mean) - values.begin();
      const double next =
          sums[static_cast<std::size_t>(below)] / (mean_below * static_cast<double>(below));
      if (std::abs(next - mean) <= 1e-6 * mean) break;
      mean = next;
    }
    return mean;
  }

  std::array<std::vector<double>, kLines> squares_;
};

/// What is left between laps in blocks of a quarter of a second: the median, since a lap that
/// differs from the others affects few blocks.
class Repeats {
 public:
  void add(const Eigen::ArrayXd& difference, double sample_time_s) {
    const auto length =
        std::min(static_cast<Eigen::Index>(std::ceil(kBlock_s / sample_time_s)), difference.size());
    for (Eigen::Index at = 0; at + length <= difference.size(); at += length)
      squares_.push_back(0.5 * difference.segment(at, length).square().mean());
  }
  /// The interval has a chance of 95 %: the ranks of a binomial count.
  [[nodiscard]] RmsEstimate rms() {
    if (squares_.empty()) return {};
    std::sort(squares_.begin(), squares_.end());
    const double count = static_cast<double>(squares_.size());
    const auto of_rank = [&](double rank) {
      return std::sqrt(squares_[static_cast<std::size_t>(std::clamp(rank, 0.0, count - 1.0))]);
    };
    return {of_rank(0.5 * count), of_rank(0.5 * count - 0.98 * std::sqrt(count)),
            of_rank(0.5 * count + 0.98 * std::sqrt(count))};
  }

 private:
  static constexpr double kBlock_s = 0.25;
  std::vector<double> squares_;
};

/// The lap of a repeating command, in samples; 0 if it does not repeat.
Eigen::Index lap_of(const Segment& s) {
  const Eigen::Index n = s.size();
  const Eigen::Index stride = std::max<Eigen::Index>(1, n / 2000);
  const double spread = std::sqrt((s.command - s.command.mean()).square().mean());
  const auto shortest = static_cast<Eigen::Index>(1.0 / s.sample_time_s);
  const auto apart = [&](Eigen::Index lag, Eigen::Index step) {
    double sum = 0.0;
    Eigen::Index count = 0;
    for (Eigen::Index i = 0; i + lag < n; i += step) {
      const double d = s.command(i + lag) - s.command(i);
      sum += d * d;
      ++count;
    }
    return std::sqrt(sum / static_cast<double>(std::max<Eigen::Index>(count, 1)));
  };
  Eigen::Index best = 0;
  double least = 0.05 * spread;
  for (Eigen::Index lag = shortest; lag < 2 * n / 3; lag += stride) {
    if (const double d = apart(lag, stride); d < least) least = d, best = lag;
  }
  if (best == 0) return 0;
  Eigen::Index fine = best;
  for (Eigen::Index lag = std::max(shortest, best - stride); lag <= best + stride && lag < n;
       ++lag) {
    if (const double d = apart(lag, 1); d < least) least = d, fine = lag;
  }
  return least < 1e-4 * spread ? fine : 0;
}

}  // namespace

NoiseFloor noise_floor(const std::vector<Segment>& segments, double known_step) {
  NoiseFloor floor;
  floor.encoder_step = known_step > 0.0 ? known_step : encoder_step(segments);
  White white;
  Repeats repeats;
  for (const Segment& s : segments) {
    white.add(s, floor.encoder_step);
    if (s.size() < kFewestRowsOfLaps) continue;
    if (const Eigen::Index lap = lap_of(s); lap > 0) {
      const Eigen::ArrayXd error = s.command - s.actual;
      const Eigen::Index overlap = s.size() - lap;
      repeats.add(error.tail(overlap) - error.head(overlap), s.sample_time_s);
      floor.lap_s = static_cast<double>(lap) * s.sample_time_s;
    }
  }
  floor.white = white.rms();
  // Noise of less than a quarter of a step does not make the rounding white: at rest it may not
  // show at all, and while the axis moves on evenly it is a tone.
  if (const double step = floor.encoder_step; step > 0.0) {
    const double rounding = step / std::sqrt(12.0);
    if (std::isfinite(floor.white.rms))
      floor.white.high = std::max(floor.white.high, std::hypot(rounding, 0.25 * step));
    for (double* value : {&floor.white.rms, &floor.white.low})
      if (!(*value >= rounding)) *value = rounding;
  }
  floor.repeats = repeats.rms();
  const bool repeats_show_more = floor.repeats.rms > 0.0 && !(floor.repeats.rms <= floor.white.rms);
  static_cast<RmsEstimate&>(floor) = repeats_show_more ? floor.repeats : floor.white;
  return floor;
}

}  // namespace servotwin
