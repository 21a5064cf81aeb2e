#include "identification/recording/noise_floor.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>

#include "identification/recording/order_statistics.h"
#include "twin/linear_algebra.h"

namespace servotwin {

namespace {

constexpr double kBlock_s = 0.25;
constexpr Eigen::Index kCoefficientsOfCubic = 4;
// Of a block at rest: as many again are left for its noise.
constexpr Eigen::Index kFewestRows = 2 * kCoefficientsOfCubic;

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

/// Mean squares of blocks of a signal. Their median is the noise: a push at rest, or a lap that
/// differs from the others, affects few blocks.
class Pieces {
 public:
  void add(const Eigen::ArrayXd& signal, Eigen::Index length) {
    length = std::min(length, signal.size());
    for (Eigen::Index at = 0; at + length <= signal.size(); at += length)
      squares_.push_back(signal.segment(at, length).square().mean());
  }
  /// The same about the cubic of each block. An axis that settles or creeps while its command rests
  /// moves along a curve; the cubic follows it, so that it does not count as noise.
  void add_about_cubics(const Eigen::ArrayXd& signal, Eigen::Index length) {
    const Eigen::VectorXd along = Eigen::VectorXd::LinSpaced(length, -1.0, 1.0);
    Eigen::MatrixXd powers = Eigen::MatrixXd::Ones(length, kCoefficientsOfCubic);
    for (Eigen::Index k = 1; k < powers.cols(); ++k)
      powers.col(k) = powers.col(k - 1).cwiseProduct(along);
    const Eigen::MatrixXd cubics = orthonormal_basis(powers);
    for (Eigen::Index at = 0; at + length <= signal.size(); at += length) {
      const Eigen::VectorXd block = signal.segment(at, length).matrix();
      squares_.push_back((block - cubics * (cubics.transpose() * block)).squaredNorm() /
                         static_cast<double>(length - kCoefficientsOfCubic));
    }
  }
  [[nodiscard]] double rms() const {
    return squares_.empty() ? std::nan("") : std::sqrt(median(squares_));
  }

 private:
  std::vector<double> squares_;
};

void standstill(const Segment& s, Pieces& pieces) {
  const auto settle = static_cast<Eigen::Index>(std::ceil(0.15 / s.sample_time_s));
  const auto block =
      std::max(kFewestRows, static_cast<Eigen::Index>(std::ceil(0.05 / s.sample_time_s)));
  Eigen::Index begin = 0;
  for (Eigen::Index i = 1; i <= s.size(); ++i) {
    if (i < s.size() && s.command(i) == s.command(begin)) continue;
    if (const Eigen::Index length = i - begin - settle; length >= block) {
      // From the first reading on: readings that are all the same then leave 0, not its rounding.
      pieces.add_about_cubics(s.actual.segment(begin + settle, length) - s.actual(begin + settle),
                              block);
    }
    begin = i;
  }
}

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

NoiseFloor noise_floor(const std::vector<Segment>& segments) {
  NoiseFloor floor;
  floor.encoder_step = encoder_step(segments);
  if (floor.encoder_step > 0.0) floor.rms = floor.encoder_step / std::sqrt(12.0);
  Pieces at_rest, from_lap_to_lap;
  for (const Segment& s : segments) {
    if (s.size() < 200) continue;
    standstill(s, at_rest);
    if (const Eigen::Index lap = lap_of(s); lap > 0) {
      const Eigen::ArrayXd error = s.command - s.actual;
      const Eigen::Index overlap = s.size() - lap;
      from_lap_to_lap.add(error.tail(overlap) - error.head(overlap),
                          static_cast<Eigen::Index>(std::ceil(kBlock_s / s.sample_time_s)));
      floor.lap_s = static_cast<double>(lap) * s.sample_time_s;
    }
  }
  floor.standstill_rms = at_rest.rms();
  floor.repeat_rms = from_lap_to_lap.rms() / std::numbers::sqrt2;
  for (double value : {floor.standstill_rms, floor.repeat_rms}) {
    // A record without any change is coarser than its noise, not free of noise.
    if (value > 0.0 && !(value <= floor.rms)) floor.rms = value;
  }
  return floor;
}

}  // namespace servotwin
