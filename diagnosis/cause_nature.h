// What every cause of the contract depends on, and the pieces of motion in which that changes by
// itself. Engineering knowledge; docs/theory.md 10.
#pragma once

#include <array>
#include <string_view>

namespace servotwin {

/// Pieces of motion, in the order in which a test runs them: what is gentle first.
enum Piece : unsigned {
  kStandstill = 1u << 0,
  kReversals = 1u << 1,
  kRests = 1u << 2,
  kSpeeds = 1u << 3,
  kTwoSpeeds = 1u << 4,
  kStrokes = 1u << 5,
  kAccelerations = 1u << 6,
  kSweep = 1u << 7,
  kRepeats = 1u << 8,
};

/// What a cause depends on, and where that shows alone.
struct CauseNature {
  std::string_view id;
  unsigned pieces;
  const char* shows;         // continues "<cause> "
  const char* besides = "";  // what the path alone does not do
};

inline constexpr const char* kPast =
    "it has happened: give the model from before with --model, or the new one shows it all along";
inline constexpr const char* kLoadEncoder =
    "it needs a record of an encoder at the load or of a laser: one at the motor cannot see it";

inline constexpr std::array<CauseNature, 24> kNatures{{
    {"stribeck", kSpeeds | kReversals,
     "follows the speed: it differs between creeping and feed, wherever and however long"},
    {"presliding", kReversals,
     "follows the way since the reversal and turns with it, at any acceleration"},
    {"asymmetric_friction", kSpeeds, "differs between the directions, at rest not at all"},
    {"position_dependent_friction", kStrokes,
     "comes back at the same place with the sign of the direction, smoothly"},
    {"added_friction", kRepeats | kSpeeds,
     "begins at a moment or place and stays, at all speeds alike", kPast},
    {"backlash", kReversals | kAccelerations,
     "is a step of one width at every reversal, whatever the force"},
    {"compliance", kAccelerations | kSweep,
     "grows in proportion to the acceleration and rings at its own frequency"},
    {"cogging", kTwoSpeeds,
     "is a force by the place that keeps its size at any speed, and vanishes in no direction"},
    {"lead_error", kTwoSpeeds, "is an error by the place of one size at any speed", kLoadEncoder},
    {"encoder_error", kTwoSpeeds,
     "is by the place as well, but the loop follows it: what it does grows with the speed"},
    {"gravity_offset", kSpeeds | kStandstill, "is there at rest and at all speeds alike"},
    {"inertia_change", kAccelerations,
     "goes with the acceleration, and leaves constant speed and reversals as they are", kPast},
    {"viscous_drift", kRepeats | kSpeeds,
     "is in proportion to the speed and fades from one cycle to the next as the axis warms: begin "
     "cold"},
    {"time_delay", kAccelerations | kSweep,
     "shifts everything by one time, so that its phase grows in proportion to the frequency"},
    {"feedforward_mismatch", kAccelerations | kSweep,
     "is in proportion to the commanded speed or acceleration up to the bandwidth of the loop and "
     "no further",
     "an earlier model of the axis to compare with (--model)"},
    {"gain_change", kAccelerations | kSweep | kReversals,
     "scales every error, that of friction at reversals too, and moves the bandwidth", kPast},
    {"torque_saturation", kAccelerations,
     "is there at the largest acceleration and gone at a third of it"},
    {"periodic_disturbance", kStandstill | kTwoSpeeds,
     "keeps its frequency at any speed and at rest"},
    {"impulse_disturbance", kRepeats, "does not come back at the same place or moment of a cycle"},
    {"cutting_force", kRepeats, "is gone when the same motion runs in air",
     "run it without cutting, and once more in the cut"},
    {"cross_coupling", kStandstill | kAccelerations,
     "is there only while the other axis accelerates",
     "let the other axis move during the first rest and stand afterwards, and record both"},
    {"dwell_stiction", kRests, "grows with the logarithm of the rest before the move"},
    {"thermal_growth", kRepeats,
     "grows from cycle to cycle with the way from the fixed bearing: begin cold", kLoadEncoder},
    {"dropped_samples", kRepeats,
     "is in the record and not in the machine: it does not come back when the motion is recorded "
     "again"},
}};

/// Pairs that need more, or other, motion than the pieces of both, or that nothing decides.
struct PairNature {
  std::string_view a, b;
  unsigned pieces;  // 0: nothing decides
  const char* words;
};
inline constexpr std::array<PairNature, 11> kPairNatures{{
    {"asymmetric_friction", "gravity_offset", 0,
     "a weight and unlike friction in the two directions are the same constant force on one axis "
     "in one attitude, and what friction holds at rest is not known; what changes when the "
     "counterbalance or the load changes is the weight"},
    {"lead_error", "thermal_growth", kStrokes | kRepeats,
     "over one stroke both are a length that is wrong; only from cycle to cycle does one of them "
     "grow"},
    {"time_delay", "gain_change", kAccelerations | kSweep,
     "at low frequency both are an error in proportion to the speed; above the bandwidth of the "
     "loop only the delay's phase goes on growing"},
    {"time_delay", "feedforward_mismatch", kAccelerations | kSweep,
     "at low frequency both are an error in proportion to the speed; above the bandwidth of the "
     "loop only the delay's phase goes on growing"},
    {"gain_change", "feedforward_mismatch", kAccelerations | kSweep | kReversals,
     "both are an error in proportion to the speed; only the gain changes what a reversal of "
     "friction does"},
    {"backlash", "compliance", kReversals | kAccelerations | kSweep,
     "under rising acceleration the gap stays a step of one width, the spring gives in a straight "
     "line"},
    {"backlash", "presliding", kReversals,
     "small reversals are lost in a gap altogether and return nothing; presliding gives a closed "
     "loop that grows with them"},
    {"compliance", "presliding", kReversals | kAccelerations | kSweep,
     "at a slow reversal of small amplitude the spring does nothing, and presliding all it does"},
    {"stribeck", "presliding", kSpeeds | kReversals,
     "creeping at one speed over a long way shows the one, tiny reversals the other"},
    {"stribeck", "dwell_stiction", kSpeeds | kRests,
     "creeping without a stop shows the one; moves of one kind after unlike rests the other"},
    {"position_dependent_friction", "added_friction", kStrokes | kRepeats,
     "a cover segment or clamp is a step at a place or moment, unlike on the way out and back; "
     "wear is smooth and the same on both"},
}};

}  // namespace servotwin
