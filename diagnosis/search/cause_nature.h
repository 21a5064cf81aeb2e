// What every cause of the contract depends on, and the elementary test motions in which that
// variable changes separately. Engineering knowledge; docs/theory.md 10.
#pragma once

#include <array>
#include <stdexcept>
#include <string>
#include <string_view>

namespace servotwin {

/// Elementary test motions, in the order in which a test runs them: the gentlest first.
enum TestPart : unsigned {
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

/// What a cause depends on, and the test motions that isolate it.
struct CauseNature {
  std::string_view id;
  unsigned parts;
  const char* shows;         // how it is recognised; continues "<cause> "
  const char* besides = "";  // what is needed in addition to the test motion
  // The shape parameter at whose upper bound the cause ends and something else begins.
  std::string_view ends_at = "";
  const char* beyond = "";  // what begins there; continues "<parameter> at its limit 0.2: "
};

inline constexpr const char* kPastChange =
    "the change is over: give the model from before it with --model, since a new model includes it";
inline constexpr const char* kLoadEncoder =
    "record an encoder at the load or a laser interferometer: a motor encoder does not measure it";

inline constexpr std::array<CauseNature, 24> kNatures{{
    {"stribeck", kSpeeds | kReversals,
     "depends on speed only: it differs between creeping and feed speeds at any position and time"},
    {"presliding", kReversals, "depends on the travel since the reversal, at any acceleration", "",
     "breakaway_displacement", "what builds up over so long a travel is something else"},
    {"asymmetric_friction", kSpeeds, "differs between the two directions and vanishes at rest"},
    {"position_dependent_friction", kStrokes,
     "repeats at the same position with the sign of the direction and varies smoothly"},
    {"added_friction", kRepeats | kSpeeds,
     "sets in at a time or position and stays, equally at all speeds", kPastChange},
    {"backlash", kReversals | kAccelerations,
     "is a step of the same width at every reversal, whatever the force"},
    {"compliance", kAccelerations | kSweep,
     "is proportional to the acceleration and oscillates at its natural frequency", "",
     "damping_ratio", "more is a filter than a vibration"},
    {"cogging", kTwoSpeeds,
     "is a force that repeats with position, of the same amplitude at any speed and in both "
     "directions"},
    {"lead_error", kTwoSpeeds,
     "is an error that repeats with position, of the same size at any speed", kLoadEncoder},
    {"encoder_error", kTwoSpeeds,
     "repeats with position too, but the loop follows it: its effect grows with the speed"},
    {"gravity_offset", kSpeeds | kStandstill, "is the same at rest and at all speeds"},
    {"inertia_change", kAccelerations,
     "is proportional to the acceleration and changes neither constant speed nor reversals",
     kPastChange},
    {"viscous_drift", kRepeats | kSpeeds,
     "is proportional to the speed and decreases from cycle to cycle as the axis warms up: start "
     "cold"},
    {"time_delay", kAccelerations | kSweep,
     "delays the whole record by a fixed time, so that its phase is proportional to the frequency"},
    {"feedforward_mismatch", kAccelerations | kSweep,
     "is proportional to the commanded speed or acceleration up to the bandwidth of the loop, and "
     "not above",
     "give an earlier model of the axis to compare with (--model)"},
    {"gain_change", kAccelerations | kSweep | kReversals,
     "scales every error, also that of friction at reversals, and shifts the bandwidth",
     kPastChange},
    {"torque_saturation", kAccelerations,
     "appears at the highest acceleration and not at a third of it"},
    {"periodic_disturbance", kStandstill | kTwoSpeeds,
     "has the same frequency at any speed and at rest"},
    {"impulse_disturbance", kRepeats, "does not repeat at the same position or time of a cycle"},
    {"cutting_force", kRepeats, "is absent when the same motion runs without cutting",
     "run the test once without cutting and once while cutting"},
    {"cross_coupling", kStandstill | kAccelerations,
     "appears only while the other axis accelerates",
     "move the other axis during the first rest, keep it at rest afterwards, and record both"},
    {"dwell_stiction", kRests,
     "grows with the logarithm of the duration of the rest before the move"},
    {"thermal_growth", kRepeats,
     "grows from cycle to cycle, in proportion to the distance from the fixed bearing: start cold",
     kLoadEncoder},
    {"dropped_samples", kRepeats,
     "is a fault of the record, not of the machine: it does not repeat when the motion is recorded "
     "again"},
}};

/// Pairs of causes that need other test motions than those of both causes together, or that no test
/// distinguishes.
struct PairNature {
  std::string_view a, b;
  unsigned parts;  // 0: no test distinguishes the two
  const char* words;
};
inline constexpr std::array<PairNature, 11> kPairNatures{{
    {"asymmetric_friction", "gravity_offset", 0,
     "on one axis in one attitude a weight and friction that differs between the directions are "
     "the "
     "same constant force, and the friction force at rest is not known; the part that changes with "
     "the counterbalance or the load is the weight"},
    {"lead_error", "thermal_growth", kStrokes | kRepeats,
     "over one stroke both are an error of length; only thermal growth increases from cycle to "
     "cycle"},
    {"time_delay", "gain_change", kAccelerations | kSweep,
     "at low frequency both are an error proportional to the speed; above the bandwidth of the "
     "loop only the phase of the delay keeps growing"},
    {"time_delay", "feedforward_mismatch", kAccelerations | kSweep,
     "at low frequency both are an error proportional to the speed; above the bandwidth of the "
     "loop only the phase of the delay keeps growing"},
    {"gain_change", "feedforward_mismatch", kAccelerations | kSweep | kReversals,
     "both are an error proportional to the speed; only the gain changes the error of friction at "
     "reversals"},
    {"backlash", "compliance", kReversals | kAccelerations | kSweep,
     "with increasing acceleration the gap stays a step of the same width, while the deflection of "
     "a spring increases in proportion"},
    {"backlash", "presliding", kReversals,
     "reversals smaller than the gap do not move the load at all; presliding gives a closed "
     "hysteresis loop that grows with the amplitude"},
    {"compliance", "presliding", kReversals | kAccelerations | kSweep,
     "at a slow reversal of small amplitude a spring has no effect and presliding its full "
     "effect"},
    {"stribeck", "presliding", kSpeeds | kReversals,
     "creeping at constant speed over a long travel shows stribeck, tiny reversals show "
     "presliding"},
    {"stribeck", "dwell_stiction", kSpeeds | kRests,
     "creeping without a stop shows stribeck; equal moves after rests of different length show "
     "dwell_stiction"},
    {"position_dependent_friction", "added_friction", kStrokes | kRepeats,
     "a cover segment or a clamp is a step at a position or time that differs between the two "
     "directions of travel; wear varies smoothly and is the same in both"},
}};

/// The entry of this cause of the contract; throws std::invalid_argument for another one.
inline const CauseNature& nature_of(std::string_view id) {
  for (const CauseNature& nature : kNatures) {
    if (nature.id == id) return nature;
  }
  throw std::invalid_argument("there is no cause '" + std::string(id) + "'");
}

}  // namespace servotwin
