// What of a tracking error is a lag behind the command: nearly all of it in a drive without
// velocity feed-forward, which is no fault.
//
//   e = T v + rest,   v the commanded velocity;   share = 1 - |rest|^2 / |e|^2 by least squares
//
// Any thread; errors: none.
#pragma once

#include <span>
#include <string>

#include "twin/sample.h"

namespace servotwin {

struct CommandLag {
  double tracking_rms = kAbsent;  ///< of command - actual [m | rad]; NaN: not known
  double time_s = kAbsent;        ///< T; negative: ahead of the command
  double share = 0.0;             ///< of the squared tracking error, 0 .. 1

  /// Whether it is what the owner sees, and nothing else.
  [[nodiscard]] bool is_all() const noexcept { return share >= kWholeShare && time_s > 0.0; }

 private:
  static constexpr double kWholeShare = 0.9;
};

/// Samples before `lead` of a segment do not count.
[[nodiscard]] CommandLag command_lag(std::span<const Segment> segments);

/// How large the error is, of a lag on the hold-out; the beginning of a sentence.
[[nodiscard]] std::string tracking_text(const CommandLag& lag, const std::string& axis,
                                        bool rotary);
/// One sentence for people; empty if nothing is known.
[[nodiscard]] std::string lag_text(const CommandLag& lag, const std::string& axis, bool rotary);

}  // namespace servotwin
