// The interface of a source of axis frames, and its implementations for no machine, for replayed
// recordings and for DDS.
//
// `receive` is the only place where the real-time loop sleeps. One thread. It throws nothing, but
// it may allocate (the DDS source does).
#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "drivers/dds/dds.h"
#include "drivers/recordings/replay.h"
#include "twin/sample.h"

namespace servotwin::daemon {

enum class Received : std::uint8_t {
  kFrame,
  kNothing,  ///< timeout
  kEnd,      ///< the source has ended
};

/// State of a source, for the status.
struct SourceState {
  bool silent = false;            ///< frames were received before, and have stopped
  std::uint64_t malformed = 0;    ///< frames refused so far
  std::vector<BusStatus> buses;   ///< buses that the source reads
  std::string offsets_held_back;  ///< why offsets are not sent any more; empty: they are sent
  std::optional<ClockDifference> clocks;  ///< of two sources that are joined
};

class FrameSource {
 public:
  virtual ~FrameSource() = default;
  /// Waits for the next frame for at most `timeout_s`.
  virtual Received receive(MachineFrame& frame, double timeout_s) noexcept = 0;
  /// Lets a source that can wait (a recording, not a machine) hold its next frame while `behind`
  /// returns true. Call it before the first receive(); `behind` is called by the thread of
  /// receive().
  virtual void wait_while(const std::function<bool()>& /*behind*/) {}
  /// Sends offsets to the drives that are on the buses of the source. `until_ns`: steady clock;
  /// none leaves later. Returns the axes whose offset did not leave (bit i: axis i). Thread of
  /// receive().
  virtual std::uint32_t send(const MachineOffset& /*offset*/, std::int64_t /*until_ns*/) noexcept {
    return 0;
  }
  /// Tells the prediction of a cycle to a PLC on the buses of the source. Thread of receive().
  virtual void tell(const MachinePrediction& /*prediction*/) noexcept {}
  /// Whether the residual alarm of an axis is raised, for tell(). Any thread.
  virtual void show_alarm(std::size_t /*axis*/, bool /*raised*/) noexcept {}
  /// Whether the stamps of the frames are those of this host's wall clock. If not, they are of a
  /// clock that this host does not know.
  [[nodiscard]] virtual bool stamped_here() const noexcept { return false; }
  /// Time since the last received frame was due (replay) or sent [ns], by the clocks of this host.
  [[nodiscard]] virtual std::int64_t age_ns() const noexcept = 0;
  /// The state of the source. `now_ns`: steady clock. Any thread.
  [[nodiscard]] virtual SourceState state(std::int64_t /*now_ns*/) const { return {}; }
  /// What has happened since the last call. `now_ns`: steady clock. Always the same thread, not
  /// that of receive().
  [[nodiscard]] virtual std::vector<SourceNews> news(std::int64_t /*now_ns*/) { return {}; }
};

/// No machine: there are no frames.
class NullSource final : public FrameSource {
 public:
  Received receive(MachineFrame&, double) noexcept override { return Received::kEnd; }
  [[nodiscard]] std::int64_t age_ns() const noexcept override { return 0; }
};

/// Replays recordings one after the other in real time. The sequence numbers start again with every
/// recording, as after a restart of the machine.
class ReplaySource final : public FrameSource {
 public:
  /// `speed`: multiple of the recorded speed; 0: as fast as frames are requested. Throws
  /// std::runtime_error if there is no recording, or if axes or cycle of the recordings differ.
  ReplaySource(std::vector<Replay> recordings, double speed);
  void wait_while(const std::function<bool()>& behind) override { behind_ = behind; }
  Received receive(MachineFrame& frame, double timeout_s) noexcept override;
  [[nodiscard]] std::int64_t age_ns() const noexcept override;
  [[nodiscard]] const MachineDescription& machine() const noexcept {
    return recordings_.front().machine();
  }

 private:
  [[nodiscard]] bool next() noexcept;

  std::vector<Replay> recordings_;
  double speed_;
  std::function<bool()> behind_ = [] { return false; };
  std::size_t playing_ = 0;
  std::int64_t started_ns_ = 0;  // when the current recording began
  std::int64_t due_ns_ = 0;
  bool waits_ = false;  // next_ has been read and is not due yet
  MachineFrame next_;
};

/// A machine on the network. If several writers send frames of the machine, the first is followed
/// until it leaves or is silent; frames of the others are ignored and reported.
class DdsSource final : public FrameSource {
 public:
  /// Without a frame for this long the machine is silent [ns].
  static constexpr std::int64_t kSilence_ns = 1'000'000'000;

  explicit DdsSource(const DdsNode& node) : reader_(node) {}
  Received receive(MachineFrame& frame, double timeout_s) noexcept override;
  [[nodiscard]] std::int64_t age_ns() const noexcept override;
  [[nodiscard]] SourceState state(std::int64_t now_ns) const override;
  [[nodiscard]] std::vector<SourceNews> news(std::int64_t now_ns) override;

 private:
  bool accept(std::int64_t now_ns) noexcept;
  [[nodiscard]] bool silent(std::int64_t now_ns) const noexcept;

  DdsReader<MachineFrame> reader_;
  dds_instance_handle_t followed_ = 0;
  std::atomic<std::uint64_t> malformed_{0};
  std::atomic<std::int64_t> last_ns_{0};     // steady; 0: no frame has come
  std::atomic<std::uint64_t> silences_{0};   // number of silences that have ended
  std::atomic<std::int64_t> silence_ns_{0};  // length of the last of them
  std::atomic<std::uint64_t> ignored_{0};    // frames of other writers

  // Of news().
  bool reported_silent_ = false;
  std::uint64_t reported_silences_ = 0, reported_ignored_ = 0;
  std::int64_t reported_ignored_ns_ = 0;
};

}  // namespace servotwin::daemon
