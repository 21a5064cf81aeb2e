// Which causes are not observable in this recording, whatever the machine does: because a sensor,
// a motion, or an earlier model to compare with is missing. The recording can neither confirm nor
// exclude such a cause.
//
// Engineering knowledge; docs/theory.md 10. Any thread.
#pragma once

#include <string>
#include <vector>

#include "identification/recording/segments.h"

namespace servotwin {

struct NotObservable {
  std::string id;   ///< of the contract
  std::string why;  ///< the reason in one line, and what would make the cause observable
};

/// What is known in addition to the recording.
struct Beside {
  bool earlier_model = false;    ///< there is an earlier model to compare with
  bool encoder_in_loop = false;  ///< the recorded encoder is known to be the position loop's own
  bool integrator = false;       ///< the identified loop has an integrator (order 3)
  bool cuts_heard = false;       ///< cuts were detected (diagnosis/evidence/cuts.h)
};

/// The causes that are not observable, in the order of the contract.
[[nodiscard]] std::vector<NotObservable> not_observable(const SegmentedAxis& axis,
                                                        const Beside& beside);

}  // namespace servotwin
