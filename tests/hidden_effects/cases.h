// Recordings of random machines in which effects are hidden, from fixed seeds.
//
// The size of an effect is chosen so that what it does to the tracking error stands to the noise of
// the record (encoder noise, encoder step, torque noise) as its class wants: clear from 5 times on,
// faint 1 to 3 times. A machine on which no plausible size does that is drawn again. What an effect
// does is the RMS difference to the same machine without it, less what another tuning of the
// machine would do as well (absorbed.h): a delay of 50 us moves the error by a lot, and no record
// could tell it from a little less feed-forward.
//
// dev and test differ in seeds and in ranges; test has the wider ones. The friction family of a
// machine is its own nature (`own`): to name it is neither a find nor a false alarm.
//
// SI units. Deterministic: the same part, effects and index give the same text, bit for bit.
// Errors: std::invalid_argument for unknown effects, std::runtime_error where no machine can show
// them. Any thread.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "tests/hidden_effects/effects.h"
#include "tests/hidden_effects/machine.h"

namespace servotwin::hidden_effects {

enum class Part { kDev, kTest };
enum class Class { kClear, kFaint };

inline constexpr double kClearFrom = 5.0;                  // of the noise
inline constexpr double kFaintFrom = 1.0, kFaintTo = 3.0;  // of the noise

struct Truth {
  std::string id;
  Parameters parameters;
  double contribution_rms = 0.0;  ///< of its own [m]: decides its class
  double difference_rms = 0.0;    ///< with what another tuning would do as well [m]
  bool clear = true;
  bool observable = true;  ///< false: the right answer is that no cause is named
};

struct Case {
  std::string name;  ///< dev/backlash/3, test/clean/0, dev/cogging+stribeck/2
  std::uint64_t seed = 0;
  std::vector<Truth> hidden;
  std::vector<std::string> own;
  double sample_time_s = 0.0, noise_rms = 0.0;
  int draws = 1;        ///< of machines, until one showed the effects as wished
  std::string machine;  ///< in a line, for people
  std::string csv;  ///< time[s],X.command[mm],X.actual[mm] and the same of Y where it is recorded

  [[nodiscard]] bool hides(const std::string& id) const;
  [[nodiscard]] bool owns(const std::string& id) const;
};

/// What the machines of this part are drawn from.
[[nodiscard]] const Ranges& ranges_of(Part part);
/// No case shares its seed with another of either part.
[[nodiscard]] std::uint64_t seed_of(const std::string& name);
/// A recording of axis X alone.
[[nodiscard]] std::string csv_of(const Trace& trace, double sample_time);

/// A machine without any of the effects.
[[nodiscard]] Case clean_case(Part part, int index);

[[nodiscard]] Case single_case(Part part, const std::string& id, Class size, int index);

/// Two clear effects, drawn by the index.
[[nodiscard]] Case pair_case(Part part, int index);

/// An effect that is there and that the record cannot show.
[[nodiscard]] Case blind_case(Part part, const std::string& id, int index);

}  // namespace servotwin::hidden_effects
