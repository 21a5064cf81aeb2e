// The gate of one axis: every position correction leaves the program through it. It limits size,
// rate, bandwidth and duration; it is no safety function.
//
// Whatever comes in, the offset y_k that goes out at t_k and is valid until V_k obeys
//   |y_k| <= peak,   |y_k - y_(k-1)| <= rate min(t_k - t_(k-1), cycle_s),
//   V_k <= min(t_k + validity, E_k),   |y_k| <= min(peak / ramp_s, rate) (E_k - t_k),
// where E_k is the expiry of the last permitted request (none: no bound), and y_(k-1) is the last
// offset, or 0 if its validity is over by t_k. Where steps are longer than cycle_s, the last bound
// is later by the time by which they are longer: the rate comes first. The limit of the rate holds
// for the offset in the drive only once the drive has ramped out an expired offset. The gate cannot
// know when: after a gap its caller sends nothing for that long (daemon/loop/live_offsets.h,
// docs/decisions/0011). So no offset is applied for longer than
// its request allows, and it has faded to 0 when the request ends. The fade obeys
//   gain_k <= (E_k - t_k) / ramp_s,
// so only a request that is valid for ramp_s or longer is ever applied in full.
//
// A permitted request is faded in within ramp_s. A request that is not permitted is refused by name
// and counted, and the active offset is faded out within the same time. A request above the limits
// is refused, not clipped: a clipped correction is not the learned one. A request that ends before
// the active offset can be faded out is refused as well. Bandwidth: for a signal limited to B and
// to a peak, Bernstein's inequality (Bernstein 1912) bounds the slope by 2 pi B peak and the
// curvature by (2 pi B)^2 peak; a request beyond is refused. Default is dry run: the output is
// advice, `send` is false.
//
// Positions in the unit of the axis [m | rad]; times in ns of one clock. No dependencies, allocates
// nothing, throws nothing. One thread. Source: docs/theory.md 14.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <string_view>

namespace servotwin {

/// From the axis configuration. All must be finite and at least 1e-30, otherwise every request is
/// refused.
struct GateLimits {
  double peak = 0.0;  ///< [m | rad]
  double rate = 0.0;  ///< [m/s | rad/s]
  double bandwidth_hz = 0.0;
  double ramp_s = 0.0;       ///< fade-in time from 0 to the full correction
  double validity_s = 0.0;   ///< time for which a drive holds an offset that is not renewed
  double model_age_s = 0.0;  ///< greatest age of the validation of a model
  bool live = false;         ///< false: dry run
  /// The drive applies one offset per cycle, so an offset may change by at most rate times this
  /// time, however long ago the one before was sent.
  double cycle_s = std::numeric_limits<double>::infinity();
};

/// Numbered, never reused.
enum class Refusal : std::uint8_t {
  kNone = 0,
  kNoLimits = 1,  ///< the configuration's limits are not positive numbers
  kModelNotValidated = 2,
  kModelStale = 3,
  kOtherAxisState = 4,  ///< the axis is not in the state the correction was learned for
  kNotFinite = 5,
  kPeak = 6,
  kRate = 7,
  kBandwidth = 8,
  kExpired = 9,       ///< the request was for an earlier time
  kTimeStands = 10,   ///< the clock has not advanced
  kEndsTooSoon = 11,  ///< the request ends before the active offset can be faded out
};
inline constexpr std::size_t kRefusals = 12;
[[nodiscard]] std::string_view name_of(Refusal refusal) noexcept;

struct GateRequest {
  std::int64_t now_ns = 0;
  double offset = 0.0;          ///< correction at this moment [m | rad]
  std::int64_t expires_ns = 0;  ///< the request must not be used after this time
  bool model_validated = false;
  std::int64_t model_validated_ns = 0;  ///< time of the validation
  bool axis_state_matches = false;
};

struct GateOutput {
  double offset = 0.0;
  std::int64_t expires_ns = 0;  ///< time at which the drive must drop it
  bool send = false;            ///< false: advice only
  Refusal refusal = Refusal::kNone;
};

class Gate {
 public:
  explicit Gate(const GateLimits& limits) noexcept;
  [[nodiscard]] GateOutput pass(const GateRequest& request) noexcept;
  /// How many requests were refused for this reason.
  [[nodiscard]] std::uint64_t count(Refusal refusal) const noexcept {
    return counts_[static_cast<std::size_t>(refusal)];
  }

 private:
  [[nodiscard]] Refusal judge(const GateRequest& request, double step_s) noexcept;
  [[nodiscard]] bool ends_too_soon(const GateRequest& request, double step_s) const noexcept;
  [[nodiscard]] GateOutput refused(Refusal refusal) noexcept;

  GateLimits limits_;
  bool usable_;
  bool first_ = true;
  std::int64_t last_ns_ = 0;
  std::int64_t expires_ns_ = 0;  // V, of the active offset
  std::int64_t ends_ns_ = 0;     // E, of the request it came from
  double out_ = 0.0;             // the active offset
  double gain_ = 0.0;            // gain of the fade, 0..1
  double held_ = 0.0;            // the permitted offset that the fade scales
  // Previous requests, for slope and curvature.
  int requests_ = 0;
  double request_ = 0.0, slope_ = 0.0;
  std::array<std::uint64_t, kRefusals> counts_{};
};

}  // namespace servotwin
