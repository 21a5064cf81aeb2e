// Whether an axis is identified as rigid or as two masses, and with which law of friction: chosen
// on the last third of the training data, as every structure (identification/loop/identify.h).
//
// Units: SI, rad for m on rotary axes. Any thread.
#pragma once

#include <optional>
#include <vector>

#include "identification/loop/identify.h"
#include "identification/loop/two_mass_fit.h"

namespace servotwin {

/// The model of two masses to refine on all training data; nothing where a rigid axis with this
/// structure is kept. A law of friction asked for is kept; else several are compared, and friction
/// with free elements where more than noise is left. `search`: for the rigid axis, from which the
/// two masses start. Adds to `trials` what was compared. Throws std::runtime_error where two masses
/// are demanded and have no valid fit.
[[nodiscard]] std::optional<TwoMassFit> chosen_masses(
    const std::string& axis, const std::vector<Segment>& training, const Structure& structure,
    const PoleSearchOptions& search, const IdentifyOptions& options, double encoder_step,
    std::vector<StructureTrial>& trials);

}  // namespace servotwin
