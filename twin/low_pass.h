// Low-pass filters run forwards and backwards: no phase, so that what passes stays where it is.
//
// A filter of even order as second-order sections, by the bilinear transform of the analogue poles
// (Butterworth; Chebyshev of the first kind), each section of gain 1 at rest. `zero_phase`
// continues the samples at both ends by their reflection in the end point and starts at rest there,
// as the usual `filtfilt` does, so that a constant or a ramp comes through unchanged up to the
// ends. Errors: std::invalid_argument. Any thread.
#pragma once

#include <Eigen/Core>
#include <vector>

namespace servotwin {

/// y_k = g (u_k + 2 u_(k-1) + u_(k-2)) - a1 y_(k-1) - a2 y_(k-2), g = (1 + a1 + a2) / 4.
struct Section {
  double a1 = 0.0, a2 = 0.0;
};
using LowPass = std::vector<Section>;

/// -3 dB at `cutoff`, a share of the sampling rate in (0, 0.5); `order` even.
[[nodiscard]] LowPass butterworth(int order, double cutoff);
/// Leaves the band of its ripple [dB] at `cutoff`.
[[nodiscard]] LowPass chebyshev(int order, double ripple_db, double cutoff);

/// Filters twice, so that the gain is squared; `x` longer than the reflection of 3 * order samples.
[[nodiscard]] Eigen::ArrayXd zero_phase(const LowPass& filter, const Eigen::ArrayXd& x);

}  // namespace servotwin
