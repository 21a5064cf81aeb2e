// What a model predicts of a motion beside what was measured, as panels of a plot. Any thread;
// errors: none.
#pragma once

#include <string>
#include <vector>

#include "diagnosis/report/plot.h"
#include "identification/model/model_file.h"

namespace servotwin::cli {

/// Three panels over the time of the recording [s]: the tracking error measured and predicted from
/// the command alone; measured minus predicted, with the noise floor; the commanded position. Each
/// in um, mm or m (urad, mrad, rad), as its values need. A lead-in is not shown. A prediction
/// begins where `judge` begins to count, so that the largest residual shown is that of `figures`.
/// `figures`, `floor`: of these segments [m | rad].
[[nodiscard]] std::vector<PlotPanel> prediction_panels(const std::string& axis, bool rotary,
                                                       const Model& model,
                                                       const std::vector<Segment>& segments,
                                                       const ErrorFigures& figures,
                                                       const RmsEstimate& floor);

}  // namespace servotwin::cli
