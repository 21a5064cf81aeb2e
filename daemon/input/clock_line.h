// The line from the time stamps of another clock to this host's steady clock, from when frames with
// these stamps came. A frame is never early: the line lies below all of them and touches those that
// were delayed least, so that jitter of the network does not move it (Moon, Skelly, Towsley,
// "Estimation and removal of clock skew from network delay measurements", INFOCOM 1999). What every
// frame is delayed at least stays in the line: over a network some 0.1 ms, over loopback some 0.05.
//
// One thread. Allocates nothing, throws nothing.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

namespace servotwin::daemon {

class ClockLine {
 public:
  /// A frame with the stamp `stamp_ns` came at `arrival_ns` of the steady clock. A stamp that does
  /// not fit (the clock was set, the machine started again) begins a new line.
  void add(std::int64_t stamp_ns, std::int64_t arrival_ns) noexcept;
  /// Whether there are enough frames: false before, and for three seconds after a clock was set.
  [[nodiscard]] bool settled() const noexcept { return settled_; }
  /// The time of the steady clock when the other one showed `stamp_ns`.
  [[nodiscard]] std::int64_t steady_ns(std::int64_t stamp_ns) const noexcept;
  /// How much faster the steady clock runs, 1e-6 is 1 ppm; 0 until it is known.
  [[nodiscard]] double drift() const noexcept { return drift_; }
  /// How often a line began anew.
  [[nodiscard]] std::uint64_t restarts() const noexcept { return restarts_; }

 private:
  struct Point {
    double stamp_s = 0.0;   ///< since the first frame of the line
    double delay_ns = 0.0;  ///< arrival minus stamp, over that of the first frame
  };
  void begin(std::int64_t stamp_ns, std::int64_t arrival_ns) noexcept;
  void fit() noexcept;
  [[nodiscard]] double line_at(double stamp_s) const noexcept {
    return delay_ns_ + 1e9 * drift_ * stamp_s;
  }

  /// The least delay of each interval, oldest first; the newest is still open.
  static constexpr std::size_t kPoints = 64;
  std::array<Point, kPoints> points_;
  std::size_t count_ = 0;
  double interval_end_s_ = 0.0, last_stamp_s_ = 0.0;
  double least_above_ns_ = 0.0;  ///< of the open interval, over the line
  int intervals_above_ = 0;
  std::int64_t first_stamp_ns_ = 0, first_arrival_ns_ = 0;
  double delay_ns_ = 0.0, drift_ = 0.0;
  bool settled_ = false, begun_ = false;
  std::uint64_t restarts_ = 0;
};

}  // namespace servotwin::daemon
