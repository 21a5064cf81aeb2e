// One run of a known program as the real-time loop measured it: measured errors beside predicted
// ones. Crosses threads by value.
#pragma once

#include <array>
#include <cstdint>
#include <string_view>

#include "twin/sample.h"

namespace servotwin::daemon {

/// How a run ended. Numbered, never reused.
enum class RunEnd : std::uint8_t {
  kFinished = 0,
  kLeft = 1,      ///< the commands no longer follow the program
  kResidual = 2,  ///< outside its band: the model no longer describes the machine
  kContour = 3,   ///< the path error was larger than predicted without a correction
  kGap = 4,       ///< cycles were lost
  kDisarmed = 5,
  kRefused = 6,  ///< by the gate
  kNotDelivered =
      7,  ///< a drive does not have the offset that was sent, or it did not leave in time
};

[[nodiscard]] constexpr std::string_view name_of(RunEnd end) noexcept {
  constexpr std::array<std::string_view, 8> kNames{
      "finished", "left", "residual", "contour", "gap", "disarmed", "refused", "not delivered"};
  const auto index = static_cast<std::size_t>(end);
  return index < kNames.size() ? kNames[index] : "unknown";
}

/// Sums of squared errors over the counted cycles [m^2 | rad^2].
struct RunSquares {
  double measured = 0.0;  ///< deviation from the program's command
  double before = 0.0;    ///< predicted without correction
  double after = 0.0;     ///< predicted with correction
};

struct OffsetRun {
  std::uint64_t learned = 0;  ///< LearnedProgram::number
  bool live = false;          ///< false: dry run, nothing was sent
  RunEnd end = RunEnd::kFinished;
  int axis = -1;             ///< index of the axis whose residual or gate ended the run; -1: none
  std::uint8_t refusal = 0;  ///< of the gate, if that ended the run
  double at_s = 0.0;         ///< time in the program at which the run ended
  std::uint64_t cycles = 0;  ///< counted cycles: those after the correction was faded in
  std::array<RunSquares, kMaxAxes> axes{};  ///< in the order of the program's axes
  RunSquares contour;                       ///< if the program has a path
};

}  // namespace servotwin::daemon
