// Two masses that have the poles of a loop and of a vibration beside it.
//
// A rigid loop with a compliance (twin/effects/compliance.h) follows the motion of two masses
// closely, but its parameters are those of no spring: in the loop the vibration has another
// frequency, and far more damping. The poles of both together are the poles of two masses in their
// loop, which determine gains, spring and masses (docs/theory.md 3.11). Units: SI, rad for m on
// rotary axes. Any thread.
#pragma once

#include <cstddef>
#include <optional>

#include "twin/model.h"

namespace servotwin {

/// A pair of poles beside those of a loop.
struct PolePair {
  double frequency_hz;
  double damping;  ///< ratio
};

/// `rigid` with two masses without play of this kind, whose closed loop has the poles of `beside`
/// and of the vibration: a start for a fit. The damping of the spring, which hardly moves the
/// poles, is that of the catalogue; lag and friction are scaled with the last gain, so that errors
/// at low frequencies stay those of `rigid`. With an integrator and the load's encoder the drive is
/// a position gain around a PI velocity loop. Nothing where the loop is of another order than
/// `rigid`, or where no two masses have these poles.
[[nodiscard]] std::optional<Model> two_masses_with_poles(const Loop& beside, const PolePair& pair,
                                                         const Model& rigid, std::size_t kind);

/// The same with the loop and the compliance of `vibrating`; nothing where it has none, or two
/// masses.
[[nodiscard]] std::optional<Model> two_masses_with_poles_of(const Model& vibrating,
                                                            const Model& rigid, std::size_t kind);

}  // namespace servotwin
