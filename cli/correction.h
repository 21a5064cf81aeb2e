// What `learn` hands over: the correction with what it brings and what it rests on, as JSON
// (servotwin.correction/1, docs/files.md), as a page, and as sentences.
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "cli/command_table.h"
#include "ilc/learn.h"
#include "twin/contour_shares.h"

namespace servotwin::cli {

inline constexpr const char* kCorrectionSchema = "servotwin.correction/1";

struct CorrectedAxis {
  CommandedAxis commanded;
  LearnAxis learning;
  ContractionCurve contraction;  ///< |1 - Q L T| without a trial
  std::size_t models = 0;        ///< within the uncertainty
  std::string uncertainty;       ///< where it is from, in words
  bool beyond_model = false;     ///< of other motion than its model was found on
};

struct Correction {
  std::string source;  ///< the table
  std::string method;
  LearnOptions options;
  std::vector<CorrectedAxis> axes;
  Learned learned;
  std::vector<ContourShare> shares;  ///< of the contour error before; empty with one axis
};

/// What is to be expected on the machine: what the twin leaves, and what it is known to miss [m |
/// rad]; NaN where the model does not say how well it predicts, or has not seen such motion.
[[nodiscard]] double expected_rms(const Correction& correction, std::size_t axis);
/// The same of the distance from the path [m], for a path that goes all ways alike: what the model
/// of each of n axes misses is across the path with a share of (n - 1)/n.
[[nodiscard]] double expected_contour_rms(const Correction& correction);
/// "bandwidth 138.0 Hz, |Q (1 - L T)| at most 0.50 (at 105 Hz) for 245 models within ..".
[[nodiscard]] std::string bandwidth_text(const Correction& correction, const CorrectedAxis& axis);
/// What limits it, in a sentence.
[[nodiscard]] std::string limited_by(const Correction& correction, std::size_t axis);
/// "X loop 41 %, Y coulomb_friction 30 %, ..".
[[nodiscard]] std::string shares_text(const Correction& correction);

[[nodiscard]] nlohmann::json to_json(const Correction& correction);
/// One self-contained page: no network, no script.
[[nodiscard]] std::string report_html(const Correction& correction);

}  // namespace servotwin::cli
