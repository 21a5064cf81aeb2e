#include "daemon/loop/program_matcher.h"

#include <algorithm>
#include <cmath>

namespace servotwin::daemon {
namespace {

/// The first row that differs from the start by more than the tolerance.
Eigen::Index first_motion_of(const CommandedPath& program, double tolerance) noexcept {
  const std::vector<Eigen::ArrayXd>& path = program.command;
  const auto away = [&](Eigen::Index row) {
    return std::any_of(path.begin(), path.end(), [&](const Eigen::ArrayXd& axis) {
      return std::abs(axis(row) - axis(0)) > tolerance;
    });
  };
  Eigen::Index row = 0;
  while (row < program.rows() && !away(row)) ++row;
  return row;
}

/// The rows until the machine stands for good.
Eigen::Index last_motion_of(const CommandedPath& program, double tolerance) noexcept {
  const std::vector<Eigen::ArrayXd>& path = program.command;
  Eigen::Index row = program.rows() - 1;
  const auto there = [&](const Eigen::ArrayXd& axis) {
    return std::abs(axis(row) - axis(axis.size() - 1)) <= tolerance;
  };
  while (row > 0 && std::all_of(path.begin(), path.end(), there)) --row;
  return row;
}

/// The commands of an axis of the machine; null if it is not in the program.
const Eigen::ArrayXd* command_of(const CommandedPath& program, std::size_t axis) noexcept {
  const auto found = std::find(program.axes.begin(), program.axes.end(), axis);
  return found == program.axes.end() ? nullptr : &program.command[found - program.axes.begin()];
}

/// Rows of a program from `first` on. Behind its end it stands.
struct Stretch {
  const CommandedPath& program;
  Eigen::Index first = 0;

  [[nodiscard]] double at(const Eigen::ArrayXd& axis, Eigen::Index k) const noexcept {
    return axis(std::clamp<Eigen::Index>(first + k, 0, axis.size() - 1));
  }
};

/// Whether every axis of `a` is alike in `b`, or stands where `b` does not have it.
bool alike_or_standing(const Stretch& a, const Stretch& b, Eigen::Index rows, double tolerance) {
  for (std::size_t i = 0; i < a.program.axes.size(); ++i) {
    const Eigen::ArrayXd& one = a.program.command[i];
    const Eigen::ArrayXd* const other = command_of(b.program, a.program.axes[i]);
    for (Eigen::Index k = 0; k < rows; ++k) {
      const double there = other == nullptr ? one(0) : b.at(*other, k);
      if (!(std::abs(a.at(one, k) - there) <= tolerance)) return false;
    }
  }
  return true;
}

/// The rule by which two programs are the same for as many rows.
bool alike(const Stretch& a, const Stretch& b, Eigen::Index rows, double tolerance) {
  return alike_or_standing(a, b, rows, tolerance) && alike_or_standing(b, a, rows, tolerance);
}

/// The same from their first motion on. Commands that differ within the tolerance may leave the
/// start a few rows earlier or later, as for the matcher.
bool alike_from_motion(const Stretch& a, const Stretch& b, Eigen::Index rows, double tolerance) {
  constexpr Eigen::Index kShift = ProgramMatcher::kAlignmentRows;
  for (Eigen::Index shift = -kShift; shift <= kShift; ++shift) {
    if (alike({a.program, a.first + shift}, b, rows, tolerance)) return true;
  }
  return false;
}

}  // namespace

bool same_course(const CommandedPath& a, const CommandedPath& b, double tolerance) {
  const Eigen::Index from_a = first_motion_of(a, tolerance), from_b = first_motion_of(b, tolerance);
  const Eigen::Index rows = std::max(a.rows() - from_a, b.rows() - from_b);
  return rows > 0 && alike({a, 0}, {b, 0}, 1, tolerance) &&
         alike_from_motion({a, from_a}, {b, from_b}, rows, tolerance);
}

bool begin_alike(const CommandedPath& a, const CommandedPath& b, double tolerance) {
  const Eigen::Index from_a = first_motion_of(a, tolerance), from_b = first_motion_of(b, tolerance);
  const Eigen::Index rows =
      std::min(last_motion_of(a, tolerance) - from_a, last_motion_of(b, tolerance) - from_b) + 1;
  return rows > 0 && alike_from_motion({a, from_a}, {b, from_b}, rows, tolerance);
}

void ProgramMatcher::watch(std::span<const CommandedPath* const> programs) noexcept {
  count_ = std::min(programs.size(), kMaxPrograms);
  for (std::size_t i = 0; i < count_; ++i) {
    Followed& one = programs_[i] = Followed();
    one.program = programs[i];
    one.first_motion = first_motion_of(*one.program, tolerance_);
  }
}

bool ProgramMatcher::follows() const noexcept {
  return std::any_of(programs_.begin(), programs_.begin() + static_cast<std::ptrdiff_t>(count_),
                     [](const Followed& one) { return one.cycles > 0; });
}

void ProgramMatcher::forget() noexcept {
  for (Followed& one : programs_) one.stood = one.cycles = 0;
}

bool ProgramMatcher::at(const CommandedPath& program, Eigen::Index row,
                        std::span<const double> command, double& square) const noexcept {
  for (std::size_t i = 0; i < program.axes.size(); ++i) {
    const double away = command[program.axes[i]] - program.command[i](row);
    if (!(std::abs(away) <= tolerance_)) return false;
    square += away * away;
  }
  return true;
}

void ProgramMatcher::follow(Followed& one, std::span<const double> command) noexcept {
  const CommandedPath& program = *one.program;
  if (one.cycles == 0) {
    double ignored = 0.0;
    if (at(program, 0, command, ignored)) {
      one.stood = std::min(one.stood + 1, kStandstillCycles);
      return;
    }
    const bool begins = one.stood == kStandstillCycles && one.first_motion < program.rows();
    one.stood = 0;
    if (!begins) return;
    for (int i = 0; i < kRows; ++i) {
      const auto n = static_cast<std::size_t>(i);
      // One row less: all candidates are advanced below, as in every cycle.
      one.row[n] = one.first_motion + i - kAlignmentRows - 1;
      one.alive[n] = one.row[n] >= -1;
      one.square[n] = 0.0;
    }
  }
  ++one.cycles;
  bool any = false;
  for (std::size_t n = 0; n < one.row.size(); ++n) {
    if (!one.alive[n]) continue;
    ++one.row[n];
    one.alive[n] = one.row[n] < program.rows() && at(program, one.row[n], command, one.square[n]);
    any = any || one.alive[n];
  }
  if (!any) {
    one.cycles = 0;
  } else if (one.cycles == kConfirmationCycles) {
    const std::size_t best = best_of(one);
    for (std::size_t n = 0; n < one.alive.size(); ++n) one.alive[n] = n == best;
  }
}

std::size_t ProgramMatcher::best_of(const Followed& one) noexcept {
  std::size_t best = one.row.size();
  for (std::size_t n = 0; n < one.row.size(); ++n) {
    if (one.alive[n] && (best == one.row.size() || one.square[n] < one.square[best])) best = n;
  }
  return best;
}

std::optional<ProgramMatcher::Match> ProgramMatcher::see(std::span<const double> command) noexcept {
  std::size_t followed = 0;
  std::optional<Match> out;
  for (std::size_t i = 0; i < count_; ++i) {
    Followed& one = programs_[i];
    follow(one, command);
    if (one.cycles == 0) continue;
    ++followed;
    if (one.cycles >= kConfirmationCycles) out = Match{i, one.row[best_of(one)]};
  }
  return followed == 1 ? out : std::nullopt;
}

}  // namespace servotwin::daemon
