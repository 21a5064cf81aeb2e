// Recognises that the machine runs a program that is known, and where in it it is.
//
//   stands at the program's start for kStanding cycles, then moves
//   --> the row at which the program begins to move, and kAligned rows beside it, each followed row
//   by row for as long as every command is within the tolerance of its row
//   --> after kConfirmed cycles the best of them is where the machine is, if it is in no other
//       program as well
//
// A program repeats sample by sample or not at all: another feed, a pause or another path ends the
// match at once, and it is not found again before its start. The work per cycle is bounded by the
// programs (kMaxPrograms), not by their length.
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

/// Whether two programs are one path: from their first motion on they are within the tolerance of
/// each other, and where one is over before the other, that stands. Neither would ever be known.
[[nodiscard]] bool same_course(const CommandedPath& a, const CommandedPath& b, double tolerance);

class ProgramMatcher {
 public:
  static constexpr std::size_t kMaxPrograms = 8;
  static constexpr int kStanding = 10;   ///< cycles at the start before it counts as one
  static constexpr int kAligned = 2;     ///< rows before and after that the motion may begin at
  static constexpr int kConfirmed = 20;  ///< cycles until a match is one

  explicit ProgramMatcher(double tolerance) noexcept : tolerance_(tolerance) {}

  struct Match {
    std::size_t program = 0;  ///< of those that are watched for
    Eigen::Index row = 0;     ///< of this cycle's command
  };

  /// The programs to watch for, at most kMaxPrograms; they outlive the matcher or the next call.
  /// What was followed is forgotten.
  void watch(std::span<const CommandedPath* const> programs) noexcept;
  /// What came before does not count any more.
  void forget() noexcept;
  /// Whether one of them has begun and is followed.
  [[nodiscard]] bool follows() const noexcept;
  /// One cycle. `command`: of every axis of the machine, by number.
  [[nodiscard]] std::optional<Match> see(std::span<const double> command) noexcept;

 private:
  static constexpr int kRows = 2 * kAligned + 1;
  struct Followed {
    const CommandedPath* program = nullptr;
    Eigen::Index first_motion = 0;  // the first row that is away from the start
    int stood = 0;                  // cycles at the start until now
    int cycles = 0;                 // followed; 0: it is not
    std::array<Eigen::Index, kRows> row{};
    std::array<bool, kRows> alive{};
    std::array<double, kRows> square{};  // of the deviations so far
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
