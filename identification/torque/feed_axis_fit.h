// A feed axis' parts from what was measured on it, stage by stage (paper 002, 1 and 4;
// docs/theory.md 16.5).
//
//   stage 1   stiffness and damping of coupling, bearing and nut from the closed velocity loop
//   stage 2   friction of the bare axis from its torque: min sum (T_simulated - T_measured)^2
//   stage 3   what the cover adds to it, the rest held
//
// What is sought is positive and sought as logarithms, by Levenberg-Marquardt (Ceres) with central
// differences, within a factor of 100. It starts from the given parts, which must be near: of
// stages 2 and 3 force_fit.h gives a start that needs none. In stage 1 the given parts count as
// known to a factor of three, so that what the response cannot show stays where the data sheet has
// it.
//
// The same data give the same result. Any thread. Errors: std::runtime_error where nothing can be
// fitted.
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
  double nut = 0.0;        ///< where it stood, from the bearing [m]
};

struct FittedValue {
  std::string name;                  ///< as in the file of the parts, without its unit
  double before = 0.0, value = 0.0;  ///< SI
  double deviation = 0.0;            ///< of the value, as a share of it
};

struct FeedAxisFit {
  FeedAxisParts parts;
  std::vector<FittedValue> values;
  double rms_before = 0.0, rms = 0.0;  ///< stage 1: of the logarithm [1]; 2, 3: torque [Nm]
};

[[nodiscard]] FeedAxisFit fit_response(const FeedAxisParts& parts,
                                       const VelocityResponse& response);

enum class FrictionOf : std::uint8_t { kDrive, kCover };
/// From the command and torque [Nm] of every segment, which begins at rest. parts.friction or
/// parts.cover is the start.
[[nodiscard]] FeedAxisFit fit_friction(const FeedAxisParts& parts, FrictionOf which,
                                       const std::vector<Segment>& segments);

/// The command of a segment as a control of this rate gets it: along the cubic spline.
[[nodiscard]] Eigen::ArrayXd at_rate(const Segment& segment, double rate_hz);

}  // namespace servotwin
