// Which causes this recording cannot show, whatever the machine does: for want of a sensor, of
// motion, or of something to compare with. That such a cause is not named says nothing.
//
// Engineering knowledge; docs/theory.md 10. Any thread.
#pragma once

#include <string>
#include <vector>

#include "identification/recording/segments.h"

namespace servotwin {

struct NotObservable {
  std::string id;   ///< of the contract
  std::string why;  ///< one line, and what would show it
};

/// What is known beside the recording.
struct Beside {
  bool earlier_model = false;    ///< there is one to compare with
  bool encoder_in_loop = false;  ///< the recorded encoder is known to be the position loop's own
  bool integrator = false;       ///< the identified loop has one (order 3)
  bool cuts_heard = false;       ///< as diagnosis/cuts.h
};

/// In the order of the contract.
[[nodiscard]] std::vector<NotObservable> not_observable(const SegmentedAxis& axis,
                                                        const Beside& beside);

}  // namespace servotwin
