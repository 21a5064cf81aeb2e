// The axis that is measured on: records of it at 1 kHz, and its model.
//
// The record is from the virtual machine, which shares no code with what is measured: P-PI control
// at 8 kHz whose closed loop has the thesis's poles (9.87 Hz, 31.31 Hz, 0.44) but for the delay of
// its sampling, GMS friction, an encoder of 1 um. Records begin and end at rest and are the same on
// every run. Any one thread.
#pragma once

#include <ostream>

#include "twin/model.h"
#include "twin/sample.h"

namespace servotwin::bench {

/// In production, 12 s.
[[nodiscard]] Segment production_record();

/// What a joint identification wants: fast motion in the first half, slow reversals in the second.
[[nodiscard]] Segment fast_and_slow_record(double seconds);

/// Order 3 with Coulomb friction: what the rigid-body catalogue can say about that axis.
[[nodiscard]] Model production_model();

/// Two columns with all their digits, `command[m],actual[m]`, so that another program reads the
/// same numbers.
void write_csv(const Segment& record, std::ostream& out);

}  // namespace servotwin::bench
