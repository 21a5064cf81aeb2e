// The rule by which a model comes into force. A model is never published because it is new.
//
//   promote if it may be used at all (excited, stable, in bounds), and
//   RMS(candidate) <= (1 - min_improvement) RMS(in force)  on motion that neither was fitted to,
//   and not by chance: ten times that much, or on most of that motion (`sureness`: 1.75 standard
//   errors, and 3 below five times that much).
//
// The last, because a machine that does not change is judged thousands of times: of so many
// candidates some are better by two percent on four seconds, and worse on the next. Where no model
// is in force, the one to beat predicts nothing: its error is the tracking error itself. Pure: no
// clock, file or thread. RMS of measured minus freely simulated tracking error [m | rad].
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <string>
#include <vector>

#include "twin/sample.h"

namespace servotwin::daemon {

struct Candidacy {
  std::vector<std::string> refusals;  ///< of the identification: why it may not be used
  std::string invalid;                ///< why_invalid(model)
  double rms = kAbsent;               ///< of the candidate on the judging motion
  double rms_in_force = kAbsent;      ///< of the model in force there, or of predicting nothing
  int version_in_force = 0;           ///< 0: none
  double sureness = kAbsent;          ///< of the candidate's advantage over a model in force
  double judged_s = 0.0;              ///< motion judged on
  bool rotary = false;
};

struct PromotionRule {
  double judge_s = 4.0;           ///< least motion to judge on
  double min_improvement = 0.02;  ///< share by which the RMS must fall
};

/// Numbered, never reused.
enum class Ruling : std::uint8_t {
  kPromoted = 0,
  kInvalid = 1,    ///< unstable or out of physical bounds
  kRefused = 2,    ///< by the identification: not excited, predicts nothing
  kNotJudged = 3,  ///< too little motion, or it could not be simulated
  kNotBetter = 4,
  kByChance = 5,  ///< better, but not beyond what chance makes of a machine that is the same
};

struct Decision {
  Ruling ruling = Ruling::kNotJudged;
  std::string reason;  ///< one line for people

  [[nodiscard]] bool promoted() const noexcept { return ruling == Ruling::kPromoted; }
};

/// Whether the model in force, of this hold-out, was found to hold where a candidate was judged:
/// it leaves no more than twice of what it left where it was judged itself. That is less than what
/// a correction that was learned on it would have to lose before it is worth nothing.
[[nodiscard]] bool still_holds(const Candidacy& candidacy, double holdout_rms);

/// How sure it is that one model leaves less than another along the same samples: the mean over
/// sixteen parts of what it leaves less (squares), by the standard error of that mean. Negative
/// where it leaves more; absent where there are fewer than sixteen samples, or all parts agree.
[[nodiscard]] double sureness(const Eigen::ArrayXd& left, const Eigen::ArrayXd& left_by_other);

[[nodiscard]] Decision decide(const Candidacy& candidacy, const PromotionRule& rule);

}  // namespace servotwin::daemon
