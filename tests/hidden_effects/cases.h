// Recordings of random machines with hidden effects, from fixed seeds.
//
// The size of an effect is chosen by its class: its contribution to the tracking error is at least
// 5 times the noise of the record (encoder noise, encoder step, torque noise) if it is clear, and 1
// to 3 times if it is faint. If no plausible size reaches that, another machine is drawn. The
// contribution is the RMS difference to the same machine without the effect, minus the part that
// another tuning of the machine would produce as well (absorbed.h): a delay of 50 us changes the
// error much, but is not distinguishable from slightly less feed-forward.
//
// The parts dev and test differ in seeds and in ranges; those of test are wider. The friction
// family of a machine is its own property (`own`): naming it is neither a hit nor a false alarm.
//
// SI units. Deterministic: the same part, effects and index give the same text, bit for bit.
// Errors: std::invalid_argument for unknown effects, std::runtime_error where no drawn machine
// reaches the class. Any thread.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "tests/hidden_effects/effects.h"
#include "tests/hidden_effects/machine.h"

namespace servotwin::hidden_effects {

enum class Part { kDev, kTest };
enum class Class { kClear, kFaint, kLarge };
/// Which recordings contain the motor's torque; kHalf: those whose seed is odd. All else in them
/// is the same.
enum class Torque { kNone, kHalf, kAll };
/// What recordings contain beside command and encoder. The motor's encoder, of the same noise and
/// step, is in those in which the encoder is that of the load. `filtered`: the control of every
/// machine has a filter of the command or a current loop that lags; all else is the same.
struct Recorded {
  Recorded(Torque of_which = Torque::kNone, bool and_motor = false)
      : torque(of_which), motor(and_motor) {}
  Torque torque;
  bool motor;
  bool filtered = false;
  /// The control of a machine that reaches its force limit stops its integrator in one of three
  /// ways, not always in the first; all else is the same.
  bool windups = false;
};

inline constexpr double kClearFrom = 5.0;                  // of the noise
inline constexpr double kFaintFrom = 1.0, kFaintTo = 3.0;  // of the noise
inline constexpr double kLargeFrom = 50.0;                 // of the noise

struct Truth {
  std::string id;
  Parameters parameters;
  double contribution_rms = 0.0;  ///< specific to the effect [m]: decides its class
  double difference_rms = 0.0;    ///< including what another tuning would produce [m]
  bool clear = true;
  bool observable = true;  ///< false: the correct answer is to name no cause
};

struct Case {
  std::string name;  ///< dev/backlash/3, test/clean/0, dev/cogging+stribeck/2
  std::uint64_t seed = 0;
  std::vector<Truth> hidden;
  std::vector<std::string> own;
  double sample_time_s = 0.0;
  double noise_rms = 0.0;    ///< of the encoder's noise and step, and of the torque's noise [m]
  double reading_rms = 0.0;  ///< of the encoder's noise and step alone [m]
  int draws = 1;             ///< number of machines drawn until one reached the class
  std::string machine;       ///< description in one line
  bool torque = false;       ///< it is recorded
  Rig rig;                   ///< of axis X with its effects, but for d(t)
  /// time[s],X.command[mm],X.actual[mm], with X.actual_motor and X.torque where they are recorded,
  /// and the same of Y.
  std::string csv;

  [[nodiscard]] bool hides(const std::string& id) const;
  [[nodiscard]] bool owns(const std::string& id) const;
};

/// The ranges from which the machines of this part are drawn.
[[nodiscard]] const Ranges& ranges_of(Part part);
/// The seed of a case; different for every case of both parts.
[[nodiscard]] std::uint64_t seed_of(const std::string& name);
/// A recording of axis X alone.
[[nodiscard]] std::string csv_of(const Trace& trace, double sample_time);

/// A machine without any of the effects.
[[nodiscard]] Case clean_case(Part part, int index, const Recorded& recorded = {});

/// A machine with one effect.
[[nodiscard]] Case single_case(Part part, const std::string& id, Class size, int index,
                               const Recorded& recorded = {});

/// Two clear effects, drawn by the index.
[[nodiscard]] Case pair_case(Part part, int index, const Recorded& recorded = {});

/// An effect that is present but not observable in the record.
[[nodiscard]] Case blind_case(Part part, const std::string& id, int index,
                              const Recorded& recorded = {});

}  // namespace servotwin::hidden_effects
