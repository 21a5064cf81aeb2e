// Two streams of frames as one: the cycles of the first, with what the second has at the same
// moment. Both clocks are brought to the steady clock of this host (clock_line.h), and the values
// of the second are interpolated between its samples.
//
// A cycle is ready as soon as the second stream has a sample after it, or after three cycles of the
// slower stream: then what the second lacks is NaN, as it is between samples that are further
// apart. Positions that go round are interpolated as they are: the streams must not have any. Until
// the clocks are known, some three seconds, all of it is NaN.
//
// A pure function of frames and times. One thread; allocates nothing after construction, throws
// nothing then.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "daemon/input/clock_line.h"
#include "drivers/common/messages.h"
#include "twin/sample.h"

namespace servotwin::daemon {

/// Where the two channels of an axis are: the number of the stream, 0 or 1, and the axis in it.
struct JoinedAxis {
  struct Place {
    std::size_t stream = 0, axis = 0;
  };
  Place command, actual;  ///< the torque comes with `actual`
};

class FrameJoin {
 public:
  /// A cycle of the second stream.
  struct Sample {
    std::int64_t stamp_ns = 0, arrival_ns = 0;
    std::array<AxisSample, kMaxAxes> axes;
  };

  /// `cycles_s`: of the two streams. `by_wall_clock`: whose stamps are of this host's wall clock,
  /// which then need not be found. Throws std::invalid_argument if there are no axes, too many, or
  /// one that is in no stream.
  FrameJoin(std::vector<JoinedAxis> axes, std::array<double, 2> cycles_s,
            std::array<bool, 2> by_wall_clock);

  /// How many axes the frames of a stream have at least.
  [[nodiscard]] int axes_of(std::size_t stream) const noexcept { return axes_of_[stream]; }
  /// What the wall clock shows more than the steady clock.
  void set_wall_ahead(std::int64_t ns) noexcept { wall_ahead_ns_ = ns; }
  /// A frame of the first stream. The oldest that waits is lost if 16 wait: call take() before.
  void add_first(const MachineFrame& frame, std::int64_t arrival_ns) noexcept;
  void add_second(const Sample& sample) noexcept;
  /// The oldest cycle, if it is ready; `now_ns`: steady clock.
  [[nodiscard]] bool take(MachineFrame& frame, std::int64_t now_ns) noexcept;
  [[nodiscard]] bool waiting() const noexcept { return waiting_count_ > 0; }
  /// The moment of the last cycle that was taken, steady clock.
  [[nodiscard]] std::int64_t moment_ns() const noexcept { return moment_ns_; }
  [[nodiscard]] const ClockDifference& clocks() const noexcept { return clocks_; }
  /// Cycles for which the second had a sample.
  [[nodiscard]] std::uint64_t present() const noexcept { return present_; }
  /// Whether it is known what the clock of a stream shows.
  [[nodiscard]] bool clock_known(std::size_t stream) const noexcept {
    return by_wall_clock_[stream] || lines_[stream].settled();
  }

 private:
  struct Waiting {
    MachineFrame frame;
    std::int64_t arrival_ns = 0;
  };
  /// The samples of the second stream around one moment, and their weights.
  struct Between {
    std::array<const Sample*, 3> samples{};
    std::array<double, 3> weights{};  ///< of positions
    double after = 0.0;               ///< weight of the last of them in what is not smooth
  };

  [[nodiscard]] std::int64_t steady_of(std::size_t stream, std::int64_t stamp_ns) const noexcept;
  [[nodiscard]] bool clocks_known() const noexcept { return clock_known(0) && clock_known(1); }
  [[nodiscard]] const Sample& back(std::size_t before) const noexcept;
  [[nodiscard]] bool between(std::int64_t moment_ns, Between& out) const noexcept;
  void join(const MachineFrame& first, std::int64_t moment_ns, MachineFrame& frame) noexcept;
  void compare_clocks(std::int64_t stamp_ns) noexcept;

  std::vector<JoinedAxis> axes_;
  std::int64_t wait_ns_;
  std::array<bool, 2> by_wall_clock_;
  std::array<int, 2> axes_of_{};
  std::int64_t wall_ahead_ns_ = 0;
  std::array<ClockLine, 2> lines_;

  static constexpr std::size_t kSamples = 64, kWaiting = 16;
  std::array<Sample, kSamples> samples_;  // a ring; the newest is back(0)
  std::size_t sample_count_ = 0, newest_ = 0;
  std::array<Waiting, kWaiting> waiting_;  // a ring
  std::size_t first_waiting_ = 0, waiting_count_ = 0;
  std::int64_t moment_ns_ = 0;
  ClockDifference clocks_;
  std::uint64_t present_ = 0;
};

}  // namespace servotwin::daemon
