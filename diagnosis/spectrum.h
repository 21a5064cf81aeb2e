// Lines in the spectrum of the residual: frequencies that stand out of their neighbourhood.
//
//   P(f) = sum over stretches of |sum_k w_k (r_k - mean) e^(-2 pi i f t_k)|^2,   w: Hann
//   background(f) = median of P about f / ln 2;   a line: P such that chance makes one as high in
//   1 of 100 spectra
//
// Amplitude [m | rad] of a sine throughout. Any thread. Source: Welch 1967.
#pragma once

#include <span>
#include <vector>

#include "diagnosis/residual.h"

namespace servotwin {

struct SpectrumPeak {
  double frequency_hz = 0.0;
  double amplitude = 0.0;     ///< [m | rad]
  double significance = 0.0;  ///< chance of a line as high anywhere in the spectrum
};

struct Spectrum {
  double step_hz = 0.0;
  std::vector<double> amplitude;  ///< at 0, step_hz, .. [m | rad]
};

/// Of all stretches of at least half a second and one sampling time; empty where there is none.
[[nodiscard]] Spectrum spectrum_of(std::span<const ResidualStretch> stretches);

/// The highest first, at most six.
[[nodiscard]] std::vector<SpectrumPeak> spectrum_peaks(std::span<const ResidualStretch> stretches);

}  // namespace servotwin
