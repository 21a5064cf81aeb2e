#include "daemon/correct/repeating_motion.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <unordered_map>

#include "daemon/loop/program_matcher.h"
#include "ilc/path_ends.h"

namespace servotwin::daemon {
namespace {

using Commands = std::span<const std::vector<double>>;

// Smallest change of a command in a row that is motion, as a share of the tolerance: a filtered
// command creeps towards its end for ever.
constexpr double kMotionShare = 1e-3;
constexpr std::size_t kRest = ProgramMatcher::kStandstillCycles;

struct Move {
  std::size_t first = 0, end = 0;  // the rows with motion: first to end - 1
  std::uint32_t axes = 0;          // that move
  std::size_t kind = 0;            // the first move that is the same
  double deviation = 0.0;          // from that one
};

/// The axes that move into this row, as bits.
std::uint32_t moved_into(std::size_t row, Commands command, double least) {
  std::uint32_t axes = 0;
  for (std::size_t i = 0; i < command.size(); ++i) {
    const double before = command[i][row - 1], now = command[i][row];
    const bool same = std::isnan(before) ? std::isnan(now) : std::abs(now - before) <= least;
    if (!same) axes |= 1U << i;
  }
  return axes;
}

/// The moves that are over. One that was cut at the begin of the record is no other's equal.
std::vector<Move> moves_of(Commands command, double least) {
  const std::size_t rows = command.empty() ? 0 : command.front().size();
  std::vector<Move> moves;
  Move move;
  std::size_t still = 1;  // rows since the last motion
  for (std::size_t row = 1; row < rows; ++row) {
    const std::uint32_t axes = moved_into(row, command, least);
    if (axes == 0) {
      if (++still == kRest && move.axes != 0) {
        moves.push_back(move);
        move = Move();
      }
      continue;
    }
    if (move.axes == 0) move.first = row;
    move.axes |= axes;
    move.end = row + 1;
    still = 0;
  }
  return moves;
}

/// The largest difference between two moves, from the row before their begin on; nothing if they
/// are not the same.
std::optional<double> difference(const Move& a, const Move& b, Commands command, double tolerance) {
  if (a.axes != b.axes || a.end - a.first != b.end - b.first) return std::nullopt;
  double largest = 0.0;
  for (std::size_t i = 0; i < command.size(); ++i) {
    if ((a.axes >> i & 1U) == 0) continue;
    const double* const one = &command[i][a.first - 1];
    const double* const other = &command[i][b.first - 1];
    for (std::size_t k = 0; k <= a.end - a.first; ++k) {
      const double away = std::abs(one[k] - other[k]);
      if (!(away <= tolerance)) return std::nullopt;
      largest = std::max(largest, away);
    }
  }
  return largest;
}

void find_kinds(std::vector<Move>& moves, Commands command, double tolerance) {
  std::unordered_map<std::size_t, std::vector<std::size_t>> of_length;  // the first of each kind
  for (std::size_t i = 0; i < moves.size(); ++i) {
    Move& move = moves[i];
    std::vector<std::size_t>& known = of_length[move.end - move.first];
    move.kind = i;
    for (const std::size_t other : known) {
      const std::optional<double> away = difference(moves[other], move, command, tolerance);
      if (!away) continue;
      move.kind = other;
      move.deviation = *away;
      break;
    }
    if (move.kind == i) known.push_back(i);
  }
}

/// The moves with which the record ends: `count` of them, of which each is the same as the one
/// `period` moves before. The shortest period that is there kMinRepetitions times; 0: none.
struct Tail {
  std::size_t period = 0, count = 0;
};
Tail tail_of(const std::vector<Move>& moves) {
  const std::size_t size = moves.size();
  const auto kind = [&](std::size_t from_end) { return moves[size - 1 - from_end].kind; };
  std::vector<std::size_t> z(size);  // how far the sequence from i on is that from 0 on
  std::size_t left = 0, right = 0;
  for (std::size_t i = 1; i < size; ++i) {
    if (i < right) z[i] = std::min(right - i, z[i - left]);
    while (i + z[i] < size && kind(z[i]) == kind(i + z[i])) ++z[i];
    if (i + z[i] > right) {
      left = i;
      right = i + z[i];
    }
    if (z[i] + i >= kMinRepetitions * i) return {i, z[i] + i};
  }
  return {};
}

/// The pauses before the moves of one place in the period.
struct Pause {
  std::size_t shortest = std::numeric_limits<std::size_t>::max(), longest = 0;  // rows
  [[nodiscard]] bool differs(std::size_t longest_inner) const {
    return shortest != longest || shortest >= longest_inner;
  }
};

}  // namespace

std::optional<RepeatingMotion> repeating_motion(Commands command, double sample_time_s,
                                                double tolerance) {
  std::vector<Move> moves = moves_of(command, kMotionShare * tolerance);
  find_kinds(moves, command, tolerance);
  const Tail tail = tail_of(moves);
  if (tail.period == 0) return std::nullopt;
  const std::size_t period = tail.period, size = moves.size(), begin = size - tail.count;

  std::vector<Pause> pauses(period);
  for (std::size_t i = begin + 1; i < size; ++i) {
    Pause& pause = pauses[i % period];
    const std::size_t rows = moves[i].first - moves[i - 1].end;
    pause.shortest = std::min(pause.shortest, rows);
    pause.longest = std::max(pause.longest, rows);
  }
  const auto longest_inner =
      static_cast<std::size_t>(std::llround(kLongestInnerPause_s / sample_time_s));
  const auto differs = [&](std::size_t move) {
    return pauses[move % period].differs(longest_inner);
  };
  // A repetition begins after a pause that differs, or else after the longest one.
  const auto begins_rather = [&](std::size_t a, std::size_t b) {
    return differs(a) != differs(b) ? differs(b) : pauses[a].shortest < pauses[b].shortest;
  };
  std::size_t start = 0;
  for (std::size_t place = 1; place < period; ++place) {
    if (begins_rather(start, place)) start = place;
  }

  RepeatingMotion out;
  std::size_t shown = 0;  // first move of the repetition before the last: a pause comes after it
  std::size_t next = begin + (start + period - begin % period) % period;
  for (; next + period <= size; next += period) {
    if (next + 2 * period <= size) shown = next;
    out.begins.push_back(moves[next].first);
  }
  if (out.begins.size() < kMinRepetitions) return std::nullopt;
  for (std::size_t i = begin; i < size; ++i)
    out.deviation = std::max(out.deviation, moves[i].deviation);

  const auto end_rest = static_cast<std::size_t>(std::ceil(kEndRest_s / sample_time_s));
  const auto rest_before = [&](std::size_t move) {
    return std::min(end_rest, pauses[move % period].shortest);
  };
  for (std::size_t from = shown, to = from; from < shown + period; from = to) {
    std::uint32_t axes = 0;
    do {
      axes |= moves[to++].axes;
    } while (to < shown + period && !differs(to));
    if (moves[to - 1].end - moves[from].first < kMinPartMotion) continue;
    // The row before the first motion is at rest as well.
    const std::size_t first = moves[from].first - 1 - rest_before(from);
    out.parts.push_back({first, moves[to - 1].end + rest_before(to) - first, axes});
  }
  if (out.parts.empty()) return std::nullopt;
  return out;
}

}  // namespace servotwin::daemon
