// Where axis frames come from: a port with a null, a replaying and a DDS implementation.
//
// `receive` is the only place where the real-time loop sleeps. One thread. What happens inside it
// is the source's business (a DDS source allocates there); it throws nothing.
#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "drivers/dds.h"
#include "drivers/replay.h"
#include "twin/sample.h"

namespace servotwin::daemon {

enum class Received : std::uint8_t {
  kFrame,
  kNothing,  ///< the time to wait was over
  kEnd,      ///< there will be no more
};

/// How a source is, for the status.
struct SourceState {
  bool silent = false;            ///< frames that came before have stopped
  std::uint64_t malformed = 0;    ///< frames refused so far
  std::vector<BusStatus> buses;   ///< that it assembles frames from
  std::string offsets_held_back;  ///< why no offset is sent any more; empty: they are
};

class FrameSource {
 public:
  virtual ~FrameSource() = default;
  /// Waits for the next frame for at most `timeout_s`.
  virtual Received receive(MachineFrame& frame, double timeout_s) noexcept = 0;
  /// A source that need not go on when its time has come waits while `behind` says so: a recording
  /// can, a machine cannot. Before the first receive(); `behind` is asked by its thread.
  virtual void wait_while(const std::function<bool()>& /*behind*/) {}
  /// Sends offsets to the drives where these are on its buses. The thread of receive().
  virtual void send(const MachineOffset& /*offset*/) noexcept {}
  /// How long ago the frame that came last was due or sent [ns], by the clocks of this host.
  [[nodiscard]] virtual std::int64_t age_ns() const noexcept = 0;
  /// How the source is. `now_ns`: steady. Any thread.
  [[nodiscard]] virtual SourceState state(std::int64_t /*now_ns*/) const { return {}; }
  /// What happened since the last call. `now_ns`: steady. Any one thread but that of receive().
  [[nodiscard]] virtual std::vector<SourceNews> news(std::int64_t /*now_ns*/) { return {}; }
};

/// No machine: nothing ever comes.
class NullSource final : public FrameSource {
 public:
  Received receive(MachineFrame&, double) noexcept override { return Received::kEnd; }
  [[nodiscard]] std::int64_t age_ns() const noexcept override { return 0; }
};

/// Recordings, one after the other, as if their machine were running now. Between two of them the
/// sequence starts again, as after a restart of the machine.
class ReplaySource final : public FrameSource {
 public:
  /// `speed`: times as fast as recorded; 0: as fast as frames are asked for. The recordings must be
  /// of one machine: throws std::runtime_error if axes or cycle differ.
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
  std::int64_t started_ns_ = 0;  // when the recording that is playing began
  std::int64_t due_ns_ = 0;
  bool waits_ = false;  // next_ is read and its time has not come
  MachineFrame next_;
};

/// A machine on the network. Where several writers say that they are the machine, the first is
/// followed until it leaves or is silent; the frames of the others are ignored, and that is said.
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
  std::atomic<std::uint64_t> silences_{0};   // that are over
  std::atomic<std::int64_t> silence_ns_{0};  // how long the last of them was
  std::atomic<std::uint64_t> ignored_{0};    // frames of other writers

  // Of news().
  bool told_silent_ = false;
  std::uint64_t told_silences_ = 0, told_ignored_ = 0;
  std::int64_t told_ignored_ns_ = 0;
};

}  // namespace servotwin::daemon
