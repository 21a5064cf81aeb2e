// The result of `learn`: the correction, the errors before and after it, and the models that it is
// based on, as JSON (servotwin.correction/1, docs/files.md), as an HTML report, and as text.
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "cli/common/command_table.h"
#include "ilc/prepared_axis.h"
#include "twin/contour_shares.h"

namespace servotwin::cli {

inline constexpr const char* kCorrectionSchema = "servotwin.correction/1";

struct CorrectedAxis : PreparedAxis {
  CommandedAxis commanded;
  bool beyond_model = false;  ///< the path is outside the motion that the model was identified on
};

struct Correction {
  std::string source;  ///< name of the table
  std::string method;
  LearnOptions options;
  std::vector<CorrectedAxis> axes;
  Learned learned;
  std::vector<ContourShare> shares;  ///< of the contour error before; empty with one axis
};

/// The RMS error to be expected on the machine [m | rad]: the remaining error on the twin and the
/// prediction error of the model on held-out data, added in squares. NaN if the latter is unknown,
/// if the path is outside the motion of the model, or if no correction is kept.
[[nodiscard]] double expected_rms(const Correction& correction, std::size_t axis);
/// The same for the distance from the path [m], for a path that runs equally in all directions: of
/// the squared prediction error of each of n axes, a share of (n - 1)/n is perpendicular to it.
[[nodiscard]] double expected_contour_rms(const Correction& correction);
/// "bandwidth 138.0 Hz, |Q (1 - L T)| at most 0.50 (at 105 Hz) for 245 models within ..".
[[nodiscard]] std::string bandwidth_text(const Correction& correction, const CorrectedAxis& axis);
/// What limits the correction of an axis, as the rest of a sentence "limited by ..".
[[nodiscard]] std::string limited_by(const Correction& correction, std::size_t axis);
/// "X loop 41 %, Y coulomb_friction 30 %, ..".
[[nodiscard]] std::string shares_text(const Correction& correction);

[[nodiscard]] nlohmann::json to_json(const Correction& correction);
/// One self-contained HTML page: it loads nothing from a network and runs no script.
[[nodiscard]] std::string report_html(const Correction& correction);

}  // namespace servotwin::cli
