// The rule by which a candidate replaces the model in force.
//
// A candidate is promoted if
//   - it may be used: excited, stable, within its bounds;
//   - RMS(candidate) <= (1 - min_improvement) RMS(in force) on held-out motion;
//   - the improvement is significant: ten times min_improvement, or a `significance` of at least
//     1.75 standard errors (3 if the improvement is below five times min_improvement). This is
//     not required where no model is in force, or that one cannot be simulated.
//
// Significance is required because a machine that does not change is judged thousands of times:
// some of so many candidates are two percent better on four seconds and worse on the next. Without
// a model in force, the reference predicts nothing: its residual is the tracking error itself.
// Pure: no clock, file or thread. RMS: of measured minus freely simulated tracking error [m | rad].
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <string>
#include <vector>

#include "twin/sample.h"

namespace servotwin::daemon {

struct Candidacy {
  std::vector<std::string> refusals;  ///< why the identification refuses the model
  std::string invalid;                ///< why_invalid(model)
  double rms = kAbsent;               ///< of the candidate on the held-out motion
  double rms_in_force = kAbsent;      ///< of the model in force, or of no prediction
  int version_in_force = 0;           ///< 0: none
  double significance = kAbsent;      ///< of the advantage of the candidate, in standard errors
  double judged_s = 0.0;              ///< length of the held-out motion
  bool rotary = false;
};

struct PromotionRule {
  double judge_s = 4.0;           ///< minimum length of the held-out motion
  double min_improvement = 0.02;  ///< required relative reduction of the RMS
};

/// Numbered, never reused.
enum class Ruling : std::uint8_t {
  kPromoted = 0,
  kInvalid = 1,    ///< unstable or out of physical bounds
  kRefused = 2,    ///< by the identification: not excited, predicts nothing
  kNotJudged = 3,  ///< too little motion, or it could not be simulated
  kNotBetter = 4,
  kByChance = 5,  ///< better, but not significantly
};

struct Decision {
  Ruling ruling = Ruling::kNotJudged;
  std::string reason;  ///< one line for people

  [[nodiscard]] bool promoted() const noexcept { return ruling == Ruling::kPromoted; }
};

/// Whether the model in force is still valid on the motion where a candidate was judged: its RMS is
/// at most twice `holdout_rms`, its RMS on held-out data when it came into force. It is assumed
/// that with twice the residual a correction that was learned on it still reduces the error.
[[nodiscard]] bool still_holds(const Candidacy& candidacy, double holdout_rms);

/// Significance of the difference of two residuals along the same samples: the mean difference of
/// their squares over sixteen blocks, divided by its standard error. Positive if `left` is smaller
/// than `left_by_other`; NaN with fewer than sixteen samples or if all blocks agree.
[[nodiscard]] double significance(const Eigen::ArrayXd& left, const Eigen::ArrayXd& left_by_other);

[[nodiscard]] Decision decide(const Candidacy& candidacy, const PromotionRule& rule);

}  // namespace servotwin::daemon
