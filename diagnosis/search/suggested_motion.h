// The test motion that would distinguish causes which a recording does not distinguish.
//
// Every cause depends on some variable (speed, travel since the reversal, position, acceleration,
// time ..) and has an elementary motion in which that variable changes while the others do not. Two
// rival causes are distinguished by the elementary motions of both together, since their models
// then predict different errors. Where no motion of this axis does that, the reason is given
// instead (docs/theory.md 10).
//
// The motion stays within the travel, speed, acceleration and jerk of the recording, and begins
// where the axis stood at the end of the recording. Where the recording hardly accelerates, the
// motion reaches its speed within a second all the same, and says so. SI units. Any thread.
#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "diagnosis/search/test_motion.h"

namespace servotwin {

struct Diagnosis;
struct SegmentedAxis;

/// Two causes of the contract that are not distinguished. `rival` empty: one cause of low
/// confidence. Both empty: the error has a cause, but none is known.
struct Doubt {
  std::string cause, rival;
};

/// The known scales of the causes; 0: not known.
struct TestSizes {
  double period = 0.0;        ///< of a periodic cause, in position [m | rad]
  double travel = 0.0;        ///< until friction slides or a gap is crossed [m | rad]
  double encoder_step = 0.0;  ///< [m | rad]
};

struct SuggestedTest {
  std::string words;  ///< what to run and how to interpret it, or why no test decides
  std::optional<TestMotion> motion;  ///< empty: no motion of this axis alone decides
};

/// The test for these doubts; nothing where there is none. Throws std::invalid_argument for a cause
/// that is not of the contract.
[[nodiscard]] std::optional<SuggestedTest> suggested_test(const std::vector<Doubt>& doubts,
                                                          const SeenMotion& seen,
                                                          const TestSizes& sizes);

/// The test for what this diagnosis leaves undecided, within the motion of this recording of the
/// axis.
[[nodiscard]] std::optional<SuggestedTest> suggested_test(const Diagnosis& diagnosis,
                                                          const SegmentedAxis& axis);

/// The identifiers of all causes of the contract.
[[nodiscard]] std::vector<std::string_view> contract_ids();

}  // namespace servotwin
