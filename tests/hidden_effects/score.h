// Compares answers with the truth: the figures of the benchmark.
//
// A cause that belongs to the machine's own friction (`own`) is neither a hit nor a false alarm.
// The answer to a case is its first other cause; "none" if there is none, "unexplained" if that is
// the verdict.
//
// Any thread.
#pragma once

#include <optional>
#include <ostream>
#include <string>
#include <vector>

#include "tests/hidden_effects/answer.h"
#include "tests/hidden_effects/cases.h"
#include "tests/hidden_effects/gaps.h"

namespace servotwin::hidden_effects {

enum class Kind { kSingle, kFaint, kPair, kClean, kBlind, kOutside, kChanged };

struct Outcome {
  Kind kind = Kind::kClean;
  Case made;  ///< without its text
  Answer answer;
  std::optional<Gaps> gaps = {};  ///< where they were asked for

  /// The named causes without the machine's own.
  [[nodiscard]] std::vector<NamedCause> named() const;
  /// The first of them, or "none", "unexplained", "failed".
  [[nodiscard]] std::string first() const;
};

/// Upper end of the one-sided 95 % confidence interval of a share, where `count` of `of` were
/// observed (Clopper and Pearson).
[[nodiscard]] double upper_bound(int count, int of);

/// The figures of the benchmark as text.
void print_scores(const std::vector<Outcome>& outcomes, const std::vector<std::string>& left_out,
                  std::ostream& out);

/// Of the outcomes with gaps: effect by effect how many cases the twin does not represent, and why
/// the missed ones were missed.
void print_gaps(const std::vector<Outcome>& outcomes, std::ostream& out);

/// One line: name, seed, truth, named, RMS before and after, noise, seconds, machine, failure.
void print_line(const Outcome& outcome, std::ostream& out);

}  // namespace servotwin::hidden_effects
