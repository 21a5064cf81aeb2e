// Zero-phase low-pass filters, run forwards and backwards.
//
// A filter of even order consists of second-order sections, from the bilinear transform of the
// analogue poles (Butterworth; Chebyshev of the first kind), each section of gain 1 at frequency 0.
// `zero_phase` extends the samples at both ends by their reflection in the end point and starts at
// rest there, as the usual `filtfilt` does, so a constant or a ramp passes unchanged up to the
// ends.
//
// Frequencies as a share of the sampling rate. Errors: std::invalid_argument. Allocates. Any
// thread. Used as in docs/theory.md 9.1.
#pragma once

#include <Eigen/Core>
#include <vector>

namespace servotwin {

/// y_k = g (u_k + 2 u_(k-1) + u_(k-2)) - a1 y_(k-1) - a2 y_(k-2), g = (1 + a1 + a2) / 4.
struct FilterSection {
  double a1 = 0.0, a2 = 0.0;
};
using LowPass = std::vector<FilterSection>;

/// -3 dB at `cutoff`, a share of the sampling rate in (0, 0.5); `order` even.
[[nodiscard]] LowPass butterworth(int order, double cutoff);
/// `cutoff` (as above) is where the gain leaves the band of `ripple_db` > 0.
[[nodiscard]] LowPass chebyshev(int order, double ripple_db, double cutoff);

/// The gain is squared, because the filter runs twice. `x` must be longer than 3 * order samples,
/// the length of the reflection.
[[nodiscard]] Eigen::ArrayXd zero_phase(const LowPass& filter, const Eigen::ArrayXd& x);

}  // namespace servotwin
