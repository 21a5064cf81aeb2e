// The diagnosis as one self-contained page for a maintenance engineer: no network, no script.
#pragma once

#include <string>
#include <vector>

#include "diagnosis/diagnose.h"
#include "twin/sample.h"

namespace servotwin {

/// `segments`: the recording that was diagnosed; its hold-out is shown. `more`: a section that
/// comes behind the causes, as HTML. Any thread.
[[nodiscard]] std::string report_html(const Diagnosis& diagnosis,
                                      const std::vector<Segment>& segments,
                                      const std::string& source, const std::string& more = {});

}  // namespace servotwin
