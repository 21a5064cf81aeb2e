// Significant lines in the spectrum of the residual: amplitudes that stand out from their
// neighbourhood.
//
//   P(f) = sum over stretches of |sum_k w_k (r_k - mean) e^(-2 pi i f t_k)|^2,   w: Hann
//   background(f) = median of P in the neighbourhood of f / ln 2
//   a line:  P so large that noise exceeds it somewhere in 1 of 100 spectra
//
// Amplitudes [m | rad] are those of a sine that is present throughout. Any thread. Source: Welch
// 1967.
#pragma once

#include <span>
#include <vector>

#include "diagnosis/statistics/residual.h"

namespace servotwin {

struct SpectrumPeak {
  double frequency_hz = 0.0;
  double amplitude = 0.0;     ///< [m | rad]
  double significance = 0.0;  ///< p of a line as high anywhere in the spectrum
};

struct Spectrum {
  double step_hz = 0.0;
  std::vector<double> amplitude;  ///< at 0, step_hz, .. [m | rad]
};

/// The spectrum of all stretches that last at least 0.5 s and have the sampling time of the first;
/// empty where there is none.
[[nodiscard]] Spectrum spectrum_of(std::span<const ResidualStretch> stretches);

/// The significant lines, the highest first, at most six.
[[nodiscard]] std::vector<SpectrumPeak> spectrum_peaks(std::span<const ResidualStretch> stretches);

}  // namespace servotwin
