// A drive behind the gate, and what the gate promises it (ilc/gate.h), checked from outside, by its
// inputs and outputs only.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "ilc/gate.h"

namespace servotwin {

class GatePromises {
 public:
  explicit GatePromises(const GateLimits& limits) : limits_(limits) {}

  /// The promise that this output breaks; null: none. Every output in turn.
  [[nodiscard]] const char* broken(const GateRequest& request, const GateOutput& out) {
    if (out.refusal == Refusal::kNoLimits)
      return out.offset != 0.0 || out.send ? "without limits nothing goes out" : nullptr;
    bool advances = request.now_ns > last_ns_;
    if (!started_ || request.now_ns > valid_ns_) {  // the drive has dropped it
      applied_ = most_ = 0.0;
      last_ns_ = request.now_ns;  // it starts anew: no step at once
      bounded_ = advances = false;
      started_ = true;
      unused_s_ = 0.0;
    }
    const double since_s = advances ? seconds(last_ns_, request.now_ns) : 0.0;
    const double step_s = std::min(since_s, limits_.cycle_s);
    unused_s_ += since_s - step_s;
    if (advances) last_ns_ = request.now_ns;
    if (out.refusal == Refusal::kNone) {
      bounded_ = true;
      ends_ns_ = request.expires_ns;
    }
    const double from = applied_;
    applied_ = out.offset;
    most_ = std::max(most_, std::abs(applied_));
    valid_ns_ = out.expires_ns;

    if (!std::isfinite(out.offset)) return "the output is finite";
    if (std::abs(out.offset) > limits_.peak) return "the peak";
    if (std::abs(out.offset - from) > kRounding * limits_.rate * step_s + 1e-15 * most_)
      return "the rate";
    if (seconds(last_ns_, out.expires_ns) > kRounding * limits_.validity_s) return "the validity";
    if (!bounded_) return out.offset != 0.0 ? "nothing without a permitted request" : nullptr;
    if (out.expires_ns > ends_ns_) return "nothing stays valid beyond the request";
    const double fastest = std::min(limits_.peak / limits_.ramp_s, limits_.rate);
    const double left_s = seconds(last_ns_, ends_ns_) + unused_s_;
    if (std::abs(out.offset) > kRounding * fastest * left_s + 1e-12 * most_)
      return "the fade ends with the request";
    return nullptr;
  }

 private:
  static constexpr double kRounding = 1.0 + 1e-9;
  /// Of any two stamps, without overflow.
  static double seconds(std::int64_t from, std::int64_t to) {
    return static_cast<double>(1e-9L *
                               (static_cast<long double>(to) - static_cast<long double>(from)));
  }

  GateLimits limits_;
  bool started_ = false, bounded_ = false;
  double applied_ = 0.0;       // by the drive
  double most_ = 0.0;          // that it applied, against which sums are rounded
  double unused_s_ = 0.0;      // of steps longer than a cycle, in which the offset did not move
  std::int64_t last_ns_ = 0;   // when it came
  std::int64_t valid_ns_ = 0;  // until when
  std::int64_t ends_ns_ = 0;   // of the last permitted request
};

}  // namespace servotwin
