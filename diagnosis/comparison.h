// What changed since an earlier model of the axis was identified (docs/theory.md 10.2).
//
// The earlier model is held. Changes (diagnosis/change.h: mass, gains, feed-forward, friction,
// delay, and every effect of the catalogue that the model does not have) are added one by one: all
// are screened by how much they could explain of what the model misses, the promising are fitted in
// free simulation together with those found before, and one is kept if it makes the error smaller
// by more than chance, as in a diagnosis without a model. The hold-out decides nothing.
#pragma once

#include "diagnosis/diagnose.h"

namespace servotwin {

/// `baseline` of the result is the earlier model judged on this recording. Of the options the
/// training share and what is left out count. Throws std::runtime_error where there is nothing to
/// compare: another axis or another kind of axis, no motion, too short. Any thread.
[[nodiscard]] Diagnosis compare(const SegmentedAxis& axis, const ModelRecord& earlier,
                                const DiagnoseOptions& options = {});

}  // namespace servotwin
