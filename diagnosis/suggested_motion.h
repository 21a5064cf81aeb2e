// The motion that would decide between causes that a recording cannot tell apart.
//
// Every cause has what it depends on (speed, travel since the reversal, place, acceleration, time
// ..) and a piece of motion in which that changes while the rest does not. Two rivals are told
// apart by the pieces of both together, since their models then predict unlike errors. Where no
// motion of this axis does that, the reason is said instead (docs/theory.md 10).
//
// The motion stays within the way, the speed, the acceleration and the jerk that the recording
// shows, and begins where the axis stood at its end. SI units. Any thread.
#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "diagnosis/test_motion.h"

namespace servotwin {

struct Diagnosis;
struct SegmentedAxis;

/// Two causes of the contract that cannot be told apart; `rival` empty: one that is not sure. Both
/// empty: nothing is known but that something is there.
struct Doubt {
  std::string cause, rival;
};

/// What is known of the sizes in which the causes live; 0: nothing.
struct TestSizes {
  double period = 0.0;        ///< in position [m | rad]
  double travel = 0.0;        ///< after which friction slides or a gap is crossed [m | rad]
  double encoder_step = 0.0;  ///< [m | rad]
};

struct SuggestedTest {
  std::string words;                 ///< what to do and how to read it, or why nothing decides
  std::optional<TestMotion> motion;  ///< none: no motion of this axis alone decides
};

/// Of no doubts: nothing. Throws std::invalid_argument for a cause that is not of the contract.
[[nodiscard]] std::optional<SuggestedTest> suggested_test(const std::vector<Doubt>& doubts,
                                                          const SeenMotion& seen,
                                                          const TestSizes& sizes);

/// What the diagnosis leaves in doubt, tested on this axis.
[[nodiscard]] std::optional<SuggestedTest> suggested_test(const Diagnosis& diagnosis,
                                                          const SegmentedAxis& axis);

/// The identifiers of the contract.
[[nodiscard]] std::vector<std::string_view> contract_ids();

}  // namespace servotwin
