// One run of a known program, as the real-time loop saw it: what was measured beside what was
// predicted for it. Crosses threads by value.
#pragma once

#include <array>
#include <cstdint>
#include <string_view>

#include "twin/sample.h"

namespace servotwin::daemon {

/// How a run ended. Numbered, never reused.
enum class RunEnd : std::uint8_t {
  kFinished = 0,
  kLeft = 1,      ///< the commands were the program's no longer
  kResidual = 2,  ///< beyond the predicted band: the machine is not the model's any more
  kContour = 3,   ///< the path was followed worse than it would be without
  kGap = 4,       ///< cycles were lost
  kDisarmed = 5,
  kRefused = 6,  ///< by the gate
};

[[nodiscard]] constexpr std::string_view name_of(RunEnd end) noexcept {
  constexpr std::array<std::string_view, 7> kNames{"finished", "left",     "residual", "contour",
                                                   "gap",      "disarmed", "refused"};
  const auto index = static_cast<std::size_t>(end);
  return index < kNames.size() ? kNames[index] : "unknown";
}

/// Sums of squares over the cycles that count [m^2 | rad^2 each].
struct RunSquares {
  double measured = 0.0;  ///< against the program's command
  double before = 0.0;    ///< predicted without correction
  double after = 0.0;     ///< predicted with it
};

struct OffsetRun {
  std::uint64_t learned = 0;  ///< LearnedProgram::number
  bool live = false;          ///< false: dry, nothing was sent
  RunEnd end = RunEnd::kFinished;
  int axis = -1;             ///< of the machine, whose residual or gate ended it; -1: none
  std::uint8_t refusal = 0;  ///< of the gate, where that ended it
  double at_s = 0.0;         ///< of the program, where it ended
  std::uint64_t cycles = 0;  ///< that count: the correction was in as a whole
  std::array<RunSquares, kMaxAxes> axes{};  ///< as the program's axes
  RunSquares contour;                       ///< of a path
};

}  // namespace servotwin::daemon
