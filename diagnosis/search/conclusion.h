// The end of a diagnosis: its causes sorted into named and suspected ones, its verdict, and what is
// left of the error. Any thread.
#pragma once

#include <vector>

#include "diagnosis/search/diagnose.h"

namespace servotwin {

/// RMS with a cause over RMS without it above which its gain is small.
inline constexpr double kMaxRmsRatioOfClearGain = 0.8;
/// RMS on the hold-out over that of another model up to which a model counts as no worse.
inline constexpr double kMaxRmsRatioNoWorse = 1.02;

/// Whether the cause consists of isolated events at times that cannot be predicted.
[[nodiscard]] bool unforeseeable(const Diagnosis& diagnosis, const Cause& cause);

/// Whether the gain on held-out data is small and its confidence interval includes zero.
[[nodiscard]] bool may_be_zero(const Gain& gain);

/// Completes a diagnosis after the search: sorts the causes into named and suspected ones, and
/// fills in the verdict, the confidences, the shares of the residual, the spectral lines, the
/// unexplained share, the causes that are not observable, and the suggested test. `holdout`: with
/// detected cuts.
void conclude(Diagnosis& diagnosis, const SegmentedAxis& axis, const std::vector<Segment>& holdout,
              const NoiseFloor& floor, const DiagnoseOptions& options);

}  // namespace servotwin
