// What the simulation gets wrong: finds it, names it, extends the model, and measures the gain on
// data that it has not seen (docs/theory.md 10).
//
// From a baseline (identify's) candidates of the catalogue are added one by one. Each is fitted
// with the loop and all effects before it by variable projection, so that the loop does not absorb
// the effect nor the effect the loop, and judged in free simulation by blocked cross-validation
// within the training data. It earns its place if the error falls by kWorthIt, in most blocks, and
// by more than chance: a paired test over quarter-second pieces whose threshold is divided by the
// number of candidates (Bonferroni), so that a clean machine gets no cause. An effect that another
// one has made needless is taken out again. The hold-out decides nothing; gains are measured on it.
#pragma once

#include <string>
#include <vector>

#include "diagnosis/regressor.h"
#include "diagnosis/residual.h"
#include "diagnosis/spectrum.h"
#include "diagnosis/suggested_motion.h"
#include "identification/identify.h"

namespace servotwin {

enum class Verdict { kExplained, kNothingSignificant, kUnexplained };
[[nodiscard]] std::string_view name_of(Verdict verdict);

/// Hold-out RMS without and with one cause, everything else as it is in the extended model.
struct Gain {
  double before = kAbsent, after = kAbsent;  ///< [m | rad]
  double low = kAbsent, high = kAbsent;      ///< 95 % interval of before - after (block bootstrap)
};

inline constexpr std::size_t kNoEffect = static_cast<std::size_t>(-1);

struct Cause {
  std::string id;         ///< of the contract: "stribeck", "cogging", ..
  std::size_t place = 0;  ///< of the effect in the extended model; kNoEffect: of the record alone
  std::vector<std::pair<std::string, double>> counts;  ///< where there is no effect
  double confidence = 0.0;  ///< share of bootstrap samples in which it beats its nearest rival
  double statistic = 0.0;   ///< of the paired test when it was added; 0: it was in the baseline
  double p = kAbsent;       ///< one-sided, before the correction for many candidates
  std::vector<std::string> ambiguous_with;
  Gain gain;
  std::optional<Model> without;  ///< the extended model fitted again without it
};

struct Diagnosis {
  Verdict verdict = Verdict::kNothingSignificant;
  ModelRecord baseline;             ///< judged on the hold-out
  ModelRecord extended;             ///< with all causes; the baseline where there is none
  std::vector<Cause> causes;        ///< by their share of the error explained
  RegimeShares regimes;             ///< of what is left on the hold-out
  RegressorShares regressors;       ///< likewise
  std::vector<SpectrumPeak> peaks;  ///< likewise
  double unexplained_share = 0.0;   ///< of the baseline's squared error beyond the noise floor
  std::optional<SuggestedTest> suggested_test;  ///< where something is left in doubt
  int fits = 0;
  std::vector<std::string> steps;  ///< what was tried, added and taken out, for people
};

struct DiagnoseOptions {
  IdentifyOptions identify;
  std::vector<std::string> leave_out;  ///< causes that are not looked for
};

/// Throws std::runtime_error as `identify` does. Any thread.
[[nodiscard]] Diagnosis diagnose(const SegmentedAxis& axis, const DiagnoseOptions& options = {});

}  // namespace servotwin
