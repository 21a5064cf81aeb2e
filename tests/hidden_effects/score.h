// Answers against truths: the figures of the benchmark.
//
// A cause that is the nature of the machine's friction (`own`) is neither a find nor a false alarm.
// The answer to a case is its first cause besides; "none" if there is none, "unexplained" if the
// verdict says so.
//
// Any thread.
#pragma once

#include <ostream>
#include <string>
#include <vector>

#include "tests/hidden_effects/answer.h"
#include "tests/hidden_effects/cases.h"

namespace servotwin::hidden_effects {

enum class Kind { kSingle, kFaint, kPair, kClean, kBlind, kOutside, kChanged };

struct Outcome {
  Kind kind = Kind::kClean;
  Case made;  ///< without its text
  Answer answer;

  /// The causes besides the machine's own.
  [[nodiscard]] std::vector<NamedCause> named() const;
  /// The first of them, or "none", "unexplained", "failed".
  [[nodiscard]] std::string first() const;
};

/// Upper end of the one-sided 95 % interval of a share of which `count` in `of` were seen (Clopper
/// and Pearson).
[[nodiscard]] double upper_bound(int count, int of);

void print_scores(const std::vector<Outcome>& outcomes, const std::vector<std::string>& left_out,
                  std::ostream& out);

/// One line: name, seed, truth, named, RMS before and after, noise, seconds, machine, failure.
void print_line(const Outcome& outcome, std::ostream& out);

}  // namespace servotwin::hidden_effects
