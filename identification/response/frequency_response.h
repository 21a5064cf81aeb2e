// Frequency responses from records of inputs and an output, with coherence and deviations.
//
//   S_ab = mean over windows of conj(A) B       Hann windows, half overlapping, mean removed
//   (Welch) G = S_ru^-1 S_ry                            per frequency; r: the instruments
//
// Without instruments r = u, the estimate H1 = S_uu^-1 S_uy: noise on the output averages out. In a
// closed loop that noise comes back through u and biases H1 towards -1 / controller; a recorded
// command r, which the noise does not move, is the instrument (Soderstrom and Stoica 1989; with one
// input G = S_ry / S_ru). The output minus G u has the spectrum S_vv, and
//
//   var G_i = S_vv c_ii / (n - q),   C = S_ru^-1 S_rr S_ru^-H,   n averages, q inputs
//   gamma_i^2 = |G_i|^2 / (|G_i|^2 + S_vv c_ii)     partial coherence; with one input the ordinary
//   sd |G| = sd arg G |G| = |G| sqrt((1 - gamma^2) / (2 gamma^2 (n - q)))
//
// (Bendat and Piersol 2010, eq. 9.90, with n - q in place of n: few averages). All signals may be
// differenced first, which does not change G and reduces the leakage of a large position offset.
// docs/theory.md 15. Any thread. Errors: std::runtime_error, one line.
#pragma once

#include <Eigen/Core>
#include <span>
#include <vector>

#include "identification/response/vector_fitting.h"

namespace servotwin {

/// Unbroken and evenly sampled. All arrays are of one length and finite.
struct ResponseRecord {
  std::vector<Eigen::ArrayXd> inputs;  ///< q of them, at least one
  Eigen::ArrayXd output;
  std::vector<Eigen::ArrayXd> instruments;  ///< none, or q
};

/// Which windows: all, or of four quarters the first and third, or the second and fourth.
enum class Windows { kAll, kOdd, kEven };

struct SpectralOptions {
  double window_s = 0.0;     ///< 0: an eighth of the data and at most kWindow_s
  bool differenced = false;  ///< all signals
  Windows windows = Windows::kAll;
};

inline constexpr double kWindow_s = 2.0;  ///< 0.01 of damping at 100 Hz is 2 Hz wide
inline constexpr double kFewestAverages =
    4.0;  ///< in addition to the inputs; with fewer, coherence is random
inline constexpr double kChanceOfSignificance =
    0.01;  ///< probability of significant coherence without any relation

/// From one input to the output. NaN and not significant where the inputs have no power of their
/// own.
struct ResponseChannel {
  Eigen::ArrayXcd response;  ///< G
  Eigen::ArrayXd deviation;  ///< of |G|, and of its real and its imaginary part
  Eigen::ArrayXd coherence;  ///< gamma_i^2; at most that of the input with the instruments
  Eigen::ArrayXd power;      ///< of the input (differenced, if so), as a share of its whole
  /// Coherence above the chance level 1 - kChanceOfSignificance^(1 / (n - q)), and input power
  /// above the leakage of strong lines. Elsewhere G is meaningless.
  Eigen::Array<bool, Eigen::Dynamic, 1> significant;
};

struct FrequencyResponse {
  double sample_time_s = 0.0, window_s = 0.0;
  int windows = 0;
  double averages = 0.0;        ///< n: equivalent number of independent windows
  Eigen::ArrayXd frequency_hz;  ///< above 0, below the Nyquist frequency, 1 / window_s apart
  Eigen::ArrayXd coherence;     ///< multiple: share of the output that all inputs explain together
  std::vector<ResponseChannel> channels;  ///< one per input

  /// The places of the significant frequencies of a channel within a band, where three or more are
  /// side by side: one alone may be chance.
  [[nodiscard]] std::vector<Eigen::Index> significant(std::size_t channel, double from_hz,
                                                      double to_hz) const;
  /// For a fit. A deviation is at least a thousandth of |G|: windows leak.
  [[nodiscard]] ResponsePoints points(std::size_t channel,
                                      const std::vector<Eigen::Index>& places) const;
};

/// Throws if the windows are too few (kFewestAverages) or have less than 16 samples.
[[nodiscard]] FrequencyResponse frequency_response(std::span<const ResponseRecord> records,
                                                   double sample_time_s,
                                                   const SpectralOptions& options = {});

}  // namespace servotwin
