#include "ilc/gate.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

namespace servotwin {
namespace {

// Of limits. Below, products of limits and steps lose their digits, and no promise holds.
constexpr double kMinLimit = 1e-30;
bool usable(double limit) noexcept { return limit >= kMinLimit && std::isfinite(limit); }

constexpr std::int64_t kForever = std::numeric_limits<std::int64_t>::max();
constexpr std::int64_t kNever = std::numeric_limits<std::int64_t>::min();

/// a - b and a + b of any stamps, without overflow.
std::int64_t difference(std::int64_t a, std::int64_t b) noexcept {
  std::int64_t out = 0;
  if (__builtin_sub_overflow(a, b, &out)) return a > b ? kForever : kNever;
  return out;
}
std::int64_t sum(std::int64_t a, std::int64_t b) noexcept {
  std::int64_t out = 0;
  if (__builtin_add_overflow(a, b, &out)) return a > 0 ? kForever : kNever;
  return out;
}
double seconds(std::int64_t ns) noexcept { return static_cast<double>(ns) * 1e-9; }

// Rounding of slope and curvature must not refuse a signal that is just within.
constexpr double kRounding = 1.0 + 1e-9;

}  // namespace

std::string_view name_of(Refusal refusal) noexcept {
  constexpr std::array<std::string_view, kRefusals> kNames{"none",
                                                           "no_limits",
                                                           "model_not_validated",
                                                           "model_stale",
                                                           "other_axis_state",
                                                           "not_finite",
                                                           "peak",
                                                           "rate",
                                                           "bandwidth",
                                                           "expired",
                                                           "time_stands",
                                                           "ends_too_soon"};
  const auto index = static_cast<std::size_t>(refusal);
  return index < kRefusals ? kNames[index] : "unknown";
}

Gate::Gate(const GateLimits& limits) noexcept
    : limits_(limits),
      usable_(usable(limits.peak) && usable(limits.rate) && usable(limits.bandwidth_hz) &&
              usable(limits.ramp_s) && usable(limits.validity_s) && limits.validity_s < 1e9 &&
              usable(limits.model_age_s) && limits.cycle_s > 0.0) {}

Refusal Gate::judge(const GateRequest& request, double step_s) noexcept {
  // The requests are followed whether they are permitted or not: a slope is one of the signal.
  const int before = requests_;
  const double slope = before >= 1 ? (request.offset - request_) / step_s : 0.0;
  const double curvature = before >= 2 ? (slope - slope_) / step_s : 0.0;
  const bool finite =
      std::isfinite(request.offset) && std::isfinite(slope) && std::isfinite(curvature);
  requests_ = finite ? std::min(before + 1, 2) : 0;
  request_ = request.offset;
  slope_ = slope;

  if (!request.model_validated) return Refusal::kModelNotValidated;
  const std::int64_t age_ns = difference(request.now_ns, request.model_validated_ns);
  if (age_ns < 0 || seconds(age_ns) > limits_.model_age_s) return Refusal::kModelStale;
  if (!request.axis_state_matches) return Refusal::kOtherAxisState;
  if (!finite) return Refusal::kNotFinite;
  if (request.expires_ns < request.now_ns) return Refusal::kExpired;
  if (std::abs(request.offset) > limits_.peak) return Refusal::kPeak;
  if (std::abs(slope) > limits_.rate * kRounding) return Refusal::kRate;
  const double omega = 2.0 * std::numbers::pi * limits_.bandwidth_hz;
  if (std::abs(slope) > omega * limits_.peak * kRounding) return Refusal::kBandwidth;
  if (std::abs(curvature) > omega * omega * limits_.peak * kRounding) return Refusal::kBandwidth;
  return ends_too_soon(request, step_s) ? Refusal::kEndsTooSoon : Refusal::kNone;
}

bool Gate::ends_too_soon(const GateRequest& request, double step_s) const noexcept {
  if (request.expires_ns >= ends_ns_) return false;  // what is out fades out by then
  const double left_s = seconds(difference(request.expires_ns, request.now_ns));
  const double fastest = std::min(limits_.rate, limits_.peak / limits_.ramp_s);
  const double moves_s = std::min(step_s, limits_.cycle_s);
  return gain_ * limits_.ramp_s - moves_s > left_s ||
         std::abs(out_) - limits_.rate * moves_s > fastest * left_s;
}

GateOutput Gate::refused(Refusal refusal) noexcept {
  ++counts_[static_cast<std::size_t>(refusal)];
  return {out_, expires_ns_, limits_.live && usable_, refusal};
}

GateOutput Gate::pass(const GateRequest& request) noexcept {
  if (!usable_) return refused(Refusal::kNoLimits);
  // Where the drive applies nothing, this cycle starts the clock and the fade starts with the next.
  const bool starts = first_ || request.now_ns > expires_ns_;
  if (starts) {
    out_ = gain_ = 0.0;
    ends_ns_ = kForever;
    requests_ = 0;
  } else if (request.now_ns <= last_ns_) {
    return refused(
        Refusal::kTimeStands);  // no time, no step: the drive keeps what it has until it expires
  }
  const double step_s = starts ? 0.0 : seconds(difference(request.now_ns, last_ns_));

  const Refusal refusal = judge(request, step_s);
  ++counts_[static_cast<std::size_t>(refusal)];
  const double moves_s = std::min(step_s, limits_.cycle_s);
  const double fade = moves_s / limits_.ramp_s;
  if (refusal == Refusal::kNone) {
    held_ = request.offset;
    ends_ns_ = request.expires_ns;
    gain_ = std::min(1.0, gain_ + fade);
  } else {
    gain_ = std::max(0.0, gain_ - fade);
  }
  const double left_s = seconds(difference(ends_ns_, request.now_ns));
  gain_ = std::min(gain_, left_s / limits_.ramp_s);
  const double most = limits_.rate * moves_s, last = limits_.rate * left_s;
  out_ += std::clamp(std::clamp(gain_ * held_, -last, last) - out_, -most, most);
  out_ = std::clamp(out_, -limits_.peak, limits_.peak);
  first_ = false;
  last_ns_ = request.now_ns;
  expires_ns_ =
      std::min(ends_ns_, sum(request.now_ns, static_cast<std::int64_t>(limits_.validity_s * 1e9)));
  return {out_, expires_ns_, limits_.live, refusal};
}

}  // namespace servotwin
