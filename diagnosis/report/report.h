// The diagnosis as one self-contained HTML page for a maintenance engineer; it loads nothing from
// the network and runs no script.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "diagnosis/evidence/encoder_difference.h"
#include "diagnosis/search/diagnose.h"
#include "diagnosis/torque/torque.h"
#include "twin/sample.h"

namespace servotwin {

/// The page as HTML. `segments`: the recording that was diagnosed; the plots show its held-out
/// part. `source`: where the recording comes from, for the first line. `torque`: what the torque
/// shows, in the first sentence and as a section after the causes. `encoders`: what two encoders
/// show, as a paragraph. Any thread.
[[nodiscard]] std::string report_html(const Diagnosis& diagnosis,
                                      const std::vector<Segment>& segments,
                                      const std::string& source,
                                      const std::optional<TorqueDiagnosis>& torque = {},
                                      const std::optional<EncoderDifference>& encoders = {});

}  // namespace servotwin
