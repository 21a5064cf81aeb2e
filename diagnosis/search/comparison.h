// Finds what has changed since an earlier model of the axis was identified (docs/theory.md 10.2).
//
// The earlier model is fixed. Changes (diagnosis/search/change.h: mass, gains, feed-forward,
// friction, delay, and every effect of the catalogue that the model does not have) are added one by
// one. All are screened for the share of the simulation error that they could explain. The
// promising ones are fitted in free simulation together with the changes found before, and one is
// kept if it lowers the error significantly, as in a diagnosis without a model. Changes are
// selected on the training data alone; all are discarded where they do not lower the error on the
// hold-out.
#pragma once

#include "diagnosis/search/diagnose.h"

namespace servotwin {

/// The changes as a diagnosis, whose `baseline` is the earlier model evaluated on this recording.
/// Of the options only the training share, `leave_out`, `encoder_in_loop` and `stop` are used.
/// Throws std::runtime_error where a comparison is not possible (another axis or another kind of
/// axis, no motion, too short), and where it was asked to stop. Any thread.
[[nodiscard]] Diagnosis compare(const SegmentedAxis& axis, const ModelRecord& earlier,
                                const DiagnoseOptions& options = {});

}  // namespace servotwin
