// Fits the parts of a feed axis to measurements, stage by stage (Ferkl et al. 2021, sections 1.2
// and 4; docs/theory.md 16.5).
//
//   stage 1   stiffness and damping of coupling, bearing and nut from the closed velocity loop:
//             min sum |ln(G_simulated / G_measured)|^2
//   stage 2   friction of the bare axis from its torque: min sum (T_simulated - T_measured)^2
//   stage 3   friction that the cover adds, the rest held: as stage 2
//
// All unknowns are positive. They are fitted as logarithms by Levenberg-Marquardt (Ceres) with
// central differences, within a factor of 100 of the given parts, which must be a close start; for
// stages 2 and 3 force_fit.h gives a start that needs none. In stage 1 the given values count as
// known to a factor of three, so that values the response does not determine stay at those of the
// data sheet.
//
// SI units. The same data give the same result. Any thread. Errors: std::runtime_error where
// nothing can be fitted.
#pragma once

#include <cstdint>

#include <string>
#include <vector>

#include "twin/feed_axis/parts.h"
#include "twin/sample.h"

namespace servotwin {

/// The measured closed velocity loop, from the commanded to the motor's velocity.
struct VelocityResponse {
  Eigen::ArrayXd frequency_hz;
  Eigen::ArrayXcd closed;  ///< not 0
  double nut = 0.0;        ///< position of the nut, from the bearing [m]
};

struct FittedValue {
  std::string name;                  ///< key in the file of the parts, without its unit
  double before = 0.0, value = 0.0;  ///< SI
  double deviation = 0.0;            ///< relative standard deviation of the value
};

struct FeedAxisFit {
  FeedAxisParts parts;
  std::vector<FittedValue> values;
  double rms_before = 0.0, rms = 0.0;  ///< stage 1: of the logarithm [1]; 2 and 3: of torque [Nm]
};

[[nodiscard]] FeedAxisFit fit_response(const FeedAxisParts& parts,
                                       const VelocityResponse& response);

enum class FrictionOf : std::uint8_t { kDrive, kCover };
/// From the command [m] and torque [Nm] of every segment; each segment begins at rest. The start is
/// parts.friction or parts.cover.
[[nodiscard]] FeedAxisFit fit_friction(const FeedAxisParts& parts, FrictionOf which,
                                       const std::vector<Segment>& segments);

/// The command of a segment resampled to this rate along its cubic spline [m].
[[nodiscard]] Eigen::ArrayXd at_rate(const Segment& segment, double rate_hz);

}  // namespace servotwin
