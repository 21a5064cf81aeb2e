// Recognises by the commands that the machine runs a known program, and at which row it is.
//
//   the machine stands at the start of the program for kStandstillCycles cycles, then moves
//   --> candidates: the first row with motion and kAlignmentRows rows before and after it; each of
//   them is followed row by row as long as every command is within the tolerance of its row
//   --> after kConfirmationCycles cycles the candidate with the smallest deviation is the match, if
//   no other program is followed as well
//
// A program repeats sample by sample or not at all: another feed rate, a pause or another path ends
// the match at once, and the program is recognised again only from its start. The work per cycle
// depends on the number of programs (at most kMaxPrograms), not on their length.
//
// Positions in the axes' own units [m | rad]. One thread; see() allocates nothing, throws nothing.
#pragma once

#include <array>
#include <cstddef>
#include <optional>
#include <span>
#include <vector>

#include "daemon/between/offset_plan.h"

namespace servotwin::daemon {

// Programs are compared from their first motion on, which may be kAlignmentRows apart. An axis that
// one of them does not have must stand in the other: the machine runs both at once then.

/// Whether two programs are the same path: their commands are within `tolerance` of each other,
/// and after the end of the shorter one the longer one stands still. If both were watched, neither
/// would be recognised.
[[nodiscard]] bool same_course(const CommandedPath& a, const CommandedPath& b, double tolerance);

/// Whether one of the programs is the begin of the other, to the last motion of the shorter one:
/// while the machine runs it, neither is recognised.
[[nodiscard]] bool begin_alike(const CommandedPath& a, const CommandedPath& b, double tolerance);

class ProgramMatcher {
 public:
  static constexpr std::size_t kMaxPrograms = 8;
  /// Cycles at the start position that are needed before a start.
  static constexpr int kStandstillCycles = 10;
  /// Rows by which the begin of motion may be early or late.
  static constexpr int kAlignmentRows = 2;
  static constexpr int kConfirmationCycles = 20;  ///< cycles of motion until a match is confirmed

  explicit ProgramMatcher(double tolerance) noexcept : tolerance_(tolerance) {}

  struct Match {
    std::size_t program = 0;  ///< index in the programs that are watched
    Eigen::Index row = 0;     ///< of this cycle's command
  };

  /// Sets the programs to watch, at most kMaxPrograms; they must live until the next call or the
  /// end of the matcher. Programs that are being followed are forgotten.
  void watch(std::span<const CommandedPath* const> programs) noexcept;
  /// Forgets the cycles so far, after a gap.
  void forget() noexcept;
  /// Whether a program has begun and is being followed.
  [[nodiscard]] bool follows() const noexcept;
  /// One cycle. `command`: of every axis of the machine, by index [m | rad].
  [[nodiscard]] std::optional<Match> see(std::span<const double> command) noexcept;

 private:
  static constexpr int kRows = 2 * kAlignmentRows + 1;
  struct Followed {
    const CommandedPath* program = nullptr;
    Eigen::Index first_motion = 0;  // the first row that differs from the start
    int stood = 0;                  // consecutive cycles at the start
    int cycles = 0;                 // of motion followed; 0: not followed
    std::array<Eigen::Index, kRows> row{};
    std::array<bool, kRows> alive{};
    std::array<double, kRows> square{};  // sum of squared deviations
  };

  [[nodiscard]] bool at(const CommandedPath& program, Eigen::Index row,
                        std::span<const double> command, double& square) const noexcept;
  void follow(Followed& one, std::span<const double> command) noexcept;
  [[nodiscard]] static std::size_t best_of(const Followed& one) noexcept;

  double tolerance_;
  std::size_t count_ = 0;
  std::array<Followed, kMaxPrograms> programs_;
};

}  // namespace servotwin::daemon
