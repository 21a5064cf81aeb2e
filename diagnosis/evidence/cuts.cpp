#include "diagnosis/evidence/cuts.h"

#include <algorithm>
#include <cmath>
#include <complex>
#include <numbers>
#include <unsupported/Eigen/FFT>

#include "identification/recording/order_statistics.h"

namespace servotwin {

namespace {

constexpr double kMinTone_hz = 8.0;       // below it the residual is that of the axis motion
constexpr double kEnvelope_s = 0.12;      // window of the envelope, and the shortest cut
constexpr double kMinContrast = 4.0;      // of the envelope inside a cut to outside
constexpr double kHighPassPeriods = 3.0;  // of the tone: slower parts of the residual are removed
// Share of the tone in the squared residual during the cut, after that high-pass.
constexpr double kMinToneShare = 0.5;
constexpr double kMinCutTimeShare = 0.03, kMaxCutTimeShare = 0.9;

constexpr std::size_t kLines = 10, kStrongest = 4;  // number of frequencies that are tried
constexpr double kMinFrequencyRatio = 1.1;          // between two of the strongest

/// Window of the envelope [s]: at least three periods of the tone.
double envelope_window_s(double f) { return std::max(kEnvelope_s, 3.0 / f); }

/// |mean of x exp(-2 pi i f t)| over a window centred on every sample.
Eigen::ArrayXd envelope(const Eigen::ArrayXd& x, double h, double f) {
  const Eigen::Index n = x.size();
  std::vector<std::complex<double>> sum(static_cast<std::size_t>(n) + 1);
  for (Eigen::Index k = 0; k < n; ++k) {
    const double angle = -2.0 * std::numbers::pi * f * h * static_cast<double>(k);
    sum[static_cast<std::size_t>(k) + 1] =
        sum[static_cast<std::size_t>(k)] + x(k) * std::polar(1.0, angle);
  }
  const auto half = static_cast<Eigen::Index>(std::lround(0.5 * envelope_window_s(f) / h));
  Eigen::ArrayXd out(n);
  for (Eigen::Index k = 0; k < n; ++k) {
    const Eigen::Index from = std::max<Eigen::Index>(0, k - half), to = std::min(n, k + half + 1);
    out(k) = std::abs(sum[static_cast<std::size_t>(to)] - sum[static_cast<std::size_t>(from)]) /
             static_cast<double>(to - from);
  }
  return out;
}

/// Mean over a window of this length centred on every sample.
Eigen::ArrayXd running_mean(const Eigen::ArrayXd& x, double h, double window_s) {
  const Eigen::Index n = x.size();
  const auto half = static_cast<Eigen::Index>(std::lround(0.5 * window_s / h));
  std::vector<double> sum(static_cast<std::size_t>(n) + 1, 0.0);
  for (Eigen::Index k = 0; k < n; ++k)
    sum[static_cast<std::size_t>(k) + 1] = sum[static_cast<std::size_t>(k)] + x(k);
  Eigen::ArrayXd out(n);
  for (Eigen::Index k = 0; k < n; ++k) {
    const Eigen::Index from = std::max<Eigen::Index>(0, k - half), to = std::min(n, k + half + 1);
    out(k) = (sum[static_cast<std::size_t>(to)] - sum[static_cast<std::size_t>(from)]) /
             static_cast<double>(to - from);
  }
  return out;
}

/// Share of the tone in the squared residual: the median over the windows in which the tone is
/// `on`. Slower parts are removed first. The transients as the tool enters and leaves are in few
/// windows and do not change the median.
double share_of_tone(const Eigen::ArrayXd& x, const Eigen::ArrayXd& tone_envelope,
                     const Eigen::ArrayXd& on, double h, double f) {
  const Eigen::ArrayXd faster = x - running_mean(x, h, kHighPassPeriods / f),
                       there = running_mean(faster.square(), h, envelope_window_s(f));
  std::vector<double> shares;
  for (Eigen::Index k = 0; k < x.size(); ++k) {
    // A tone of amplitude a has the envelope a / 2 and the mean square a^2 / 2.
    if (on(k) > 0.0 && there(k) > 0.0)
      shares.push_back(tone_envelope(k) * tone_envelope(k) / (0.5 * there(k)));
  }
  return quantile(std::move(shares), 0.5);
}

struct PowerSpectrum {
  std::vector<double> power;
  double step_hz;
};

/// Power spectrum with a Hann window and zero padding to at least twice the length, which halves
/// the distance between frequencies.
PowerSpectrum spectrum_of(const Eigen::Ref<const Eigen::VectorXd>& signal, double h) {
  Eigen::Index length = 1;
  while (length < 2 * signal.size()) length *= 2;
  std::vector<double> x(static_cast<std::size_t>(length), 0.0);
  for (Eigen::Index k = 0; k < signal.size(); ++k) {
    const double window = 0.5 - 0.5 * std::cos(2.0 * std::numbers::pi * static_cast<double>(k) /
                                               static_cast<double>(signal.size()));
    x[static_cast<std::size_t>(k)] = window * signal(k);
  }
  Eigen::FFT<double> fft;
  std::vector<std::complex<double>> spectrum;
  fft.fwd(spectrum, x);
  std::vector<double> power(static_cast<std::size_t>(length / 2));
  for (std::size_t i = 0; i < power.size(); ++i) power[i] = std::norm(spectrum[i]);
  return {std::move(power), 1.0 / (h * static_cast<double>(length))};
}

bool is_peak(const std::vector<double>& power, std::size_t i) {
  return power[i] >= power[i - 1] && power[i] >= power[i + 1];
}

}  // namespace

std::vector<double> lines_of(const Eigen::Ref<const Eigen::VectorXd>& signal, double h,
                             std::size_t most) {
  const auto [power, step_hz] = spectrum_of(signal, h);
  // A line is compared with its own neighbourhood, not with the whole spectrum.
  std::vector<std::pair<double, double>> lines;
  for (std::size_t i = 2; i + 2 < power.size(); ++i) {
    if (!is_peak(power, i)) continue;
    const std::size_t reach = std::max<std::size_t>(20, i / 5);
    const std::size_t from = i > reach ? i - reach : 1, to = std::min(power.size(), i + reach);
    double sum = 0.0;
    for (std::size_t j = from; j < to; j += 2) sum += power[j];
    const std::size_t count = (to - from + 1) / 2;
    const double around = sum / static_cast<double>(count);
    lines.emplace_back(-power[i] / around, step_hz * static_cast<double>(i));
  }
  std::sort(lines.begin(), lines.end());
  std::vector<double> out;
  for (std::size_t i = 0; i < std::min(most, lines.size()); ++i) out.push_back(lines[i].second);
  return out;
}

std::vector<double> strongest_of(const Eigen::Ref<const Eigen::VectorXd>& signal, double h) {
  const auto [power, step_hz] = spectrum_of(signal, h);
  std::vector<std::pair<double, double>> peaks;
  for (std::size_t i = 2; i + 2 < power.size(); ++i) {
    const double f = step_hz * static_cast<double>(i);
    if (f >= kMinTone_hz && is_peak(power, i)) peaks.emplace_back(-power[i], f);
  }
  std::sort(peaks.begin(), peaks.end());
  std::vector<double> out;
  for (const auto& [negative, f] : peaks) {
    if (out.size() == kStrongest) break;
    if (std::none_of(out.begin(), out.end(), [f = f](double other) {
          return f < kMinFrequencyRatio * other && other < kMinFrequencyRatio * f;
        }))
      out.push_back(f);
  }
  return out;
}

bool find_cuts(std::vector<Segment>& segments, const std::vector<Eigen::ArrayXd>& left) {
  const auto longest = static_cast<std::size_t>(
      std::max_element(segments.begin(), segments.end(),
                       [](const auto& l, const auto& r) { return l.size() < r.size(); }) -
      segments.begin());
  const double h = segments[longest].sample_time_s;
  double best = kMinToneShare, tone = 0.0, level = 0.0;
  // An intermittent tone is broader than a line.
  std::vector<double> tones = lines_of(left[longest].matrix(), h, kLines);
  for (const double f : strongest_of(left[longest].matrix(), h)) tones.push_back(f);
  for (const double f : tones) {
    if (f < kMinTone_hz || f > 0.45 / h) continue;
    const Eigen::ArrayXd tone_envelope = envelope(left[longest], h, f);
    const double threshold = 0.5 * quantile(tone_envelope, 0.95);
    const auto on = (tone_envelope > threshold).cast<double>().eval();
    const double share = on.mean();
    if (share < kMinCutTimeShare || share > kMaxCutTimeShare) continue;
    const double contrast = (tone_envelope * on).sum() / on.sum() /
                            std::max(1e-300, (tone_envelope * (1.0 - on)).sum() / (1.0 - on).sum());
    if (contrast > kMinContrast) {
      const double tone_share = share_of_tone(left[longest], tone_envelope, on, h, f);
      if (tone_share > best) best = tone_share, tone = f, level = threshold;
    }
  }
  if (tone == 0.0) return false;
  for (std::size_t i = 0; i < segments.size(); ++i)
    segments[i].in_cut = (envelope(left[i], h, tone) > level).cast<double>();
  return true;
}

}  // namespace servotwin
