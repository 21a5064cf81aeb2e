#include "diagnosis/statistics/spectrum.h"

#include <algorithm>
#include <cmath>
#include <complex>
#include <numbers>
#include <unsupported/Eigen/FFT>

namespace servotwin {

namespace {

constexpr double kMinStretch_s = 0.5;
constexpr double kMaxP = 0.01;  // of a line to be significant
constexpr std::size_t kMaxPeaks = 6;
// Of the sampling rate: above it the anti-aliasing filter of the recorder shapes the spectrum.
constexpr double kMaxFrequencyShare = 0.45;

bool usable(const ResidualStretch& s, double h) {
  return s.h == h && static_cast<double>(s.residual.size()) * h >= kMinStretch_s &&
         s.residual.isFinite().all();
}

double longest_s(std::span<const ResidualStretch> stretches) {
  double out = 0.0;
  for (const ResidualStretch& s : stretches) {
    if (usable(s, stretches.front().h))
      out = std::max(out, s.h * static_cast<double>(s.residual.size()));
  }
  return out;
}

}  // namespace

Spectrum spectrum_of(std::span<const ResidualStretch> stretches) {
  Spectrum out;
  const double longest = longest_s(stretches);
  if (!(longest > 0.0)) return out;
  const double h = stretches.front().h;
  std::size_t padded = 1;
  while (static_cast<double>(padded) * h < 1.9 * longest) padded *= 2;
  out.step_hz = 1.0 / (static_cast<double>(padded) * h);
  out.amplitude.assign(padded / 2 + 1, 0.0);
  Eigen::FFT<double> fft;
  double weight = 0.0;
  for (const ResidualStretch& s : stretches) {
    if (!usable(s, h)) continue;
    const auto n = static_cast<std::size_t>(s.residual.size());
    std::vector<double> windowed(padded, 0.0);
    const double mean = s.residual.mean();
    for (std::size_t k = 0; k < n; ++k) {
      const double w =
          0.5 - 0.5 * std::cos(2.0 * std::numbers::pi * (static_cast<double>(k) + 0.5) /
                               static_cast<double>(n));
      windowed[k] = w * (s.residual(static_cast<Eigen::Index>(k)) - mean);
    }
    std::vector<std::complex<double>> lines;
    fft.fwd(lines, windowed);
    for (std::size_t i = 0; i < out.amplitude.size(); ++i) out.amplitude[i] += std::norm(lines[i]);
    weight += 0.25 * static_cast<double>(n) * static_cast<double>(n);  // (sum of the window)^2
  }
  for (double& a : out.amplitude) a = 2.0 * std::sqrt(a / weight);
  return out;
}

std::vector<SpectrumPeak> spectrum_peaks(std::span<const ResidualStretch> stretches) {
  const Spectrum spectrum = spectrum_of(stretches);
  std::vector<SpectrumPeak> out;
  const std::size_t n = spectrum.amplitude.size();
  if (n < 64) return out;
  const double longest = longest_s(stretches);
  // Lines with fewer periods in the longest stretch belong to the motion itself.
  constexpr double kPeriods = 8.0, kNeighbourhood = 0.1;
  const auto first = static_cast<std::size_t>(kPeriods / longest / spectrum.step_hz) + 1;
  const auto last =
      std::min(n - 2, static_cast<std::size_t>(kMaxFrequencyShare * 2.0 * static_cast<double>(n)));
  const double independent = static_cast<double>(last - first) * spectrum.step_hz * longest;
  for (std::size_t i = first; i <= last; ++i) {
    const double a = spectrum.amplitude[i];
    if (a < spectrum.amplitude[i - 1] || a <= spectrum.amplitude[i + 1]) continue;
    const auto half = std::max<std::size_t>(
        30, static_cast<std::size_t>(kNeighbourhood * static_cast<double>(i)));
    const std::size_t from = i > first + half ? i - half : first, to = std::min(last, i + half);
    std::vector<double> near(spectrum.amplitude.begin() + static_cast<std::ptrdiff_t>(from),
                             spectrum.amplitude.begin() + static_cast<std::ptrdiff_t>(to) + 1);
    const auto middle = near.begin() + static_cast<std::ptrdiff_t>(near.size() / 2);
    std::nth_element(near.begin(), middle, near.end());
    const double background = *middle * *middle / std::numbers::ln2;
    const double p = background > 0.0 ? independent * std::exp(-a * a / background) : 0.0;
    if (p < kMaxP) out.push_back({spectrum.step_hz * static_cast<double>(i), a, p});
  }
  std::sort(out.begin(), out.end(),
            [](const auto& l, const auto& r) { return l.amplitude > r.amplitude; });
  // Side lobes of a line do not count as lines.
  std::vector<SpectrumPeak> apart;
  for (const SpectrumPeak& peak : out) {
    const bool skirt = std::any_of(apart.begin(), apart.end(), [&](const SpectrumPeak& other) {
      return std::abs(other.frequency_hz - peak.frequency_hz) < 5.0 / longest;
    });
    if (!skirt && apart.size() < kMaxPeaks) apart.push_back(peak);
  }
  return apart;
}

}  // namespace servotwin
