// The messages on the network besides frames, as types of the program. Wire format:
// msgs/servotwin.idl. Linear axes in m, rotary axes in rad; a missing number is NaN.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "twin/sample.h"

namespace servotwin {

/// Longest name of a machine or an axis: what the messages hold (msgs/servotwin.idl).
inline constexpr std::size_t kMaxNameLength = 63;

/// Whether this is a valid name of a machine or an axis: it is used in file names, column names and
/// messages.
[[nodiscard]] inline bool usable_name(std::string_view name) noexcept {
  constexpr std::string_view kAllowed =
      "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789._-";
  return !name.empty() && name.size() <= kMaxNameLength && name.front() != '.' &&
         name.find_first_not_of(kAllowed) == name.npos;
}

inline constexpr std::string_view kUsableNameRule =
    "must be 1 to 63 letters, digits or any of . _ -, not beginning with a dot";

struct AxisDescription {
  std::string name;
  bool rotary = false;
  std::string torque_unit;  ///< "N", "Nm", "A", "V", "%" or empty
};

/// Range of the cycle of a machine [s]: from twice the rate of the fastest current loops to
/// positions that are polled.
inline constexpr double kMinCycle_s = 1e-5, kMaxCycle_s = 1.0;

/// The description of a machine: its axes in the order of its frames.
struct MachineDescription {
  double cycle_s = 0.0;  ///< kMinCycle_s to kMaxCycle_s
  std::vector<AxisDescription> axes;
};

enum class AxisState : std::uint8_t {
  kNoModel,
  kSettling,  ///< simulated for less than the model's settling time since the last start
  kPredicting,
  kBadSample,  ///< the command of this cycle is not a number
};

struct AxisPrediction {
  double predicted_error = kAbsent;     ///< from commands alone
  double standard_deviation = kAbsent;  ///< hold-out RMS of the model in force
  double measured_error = kAbsent;      ///< command - actual
  double residual = kAbsent;            ///< measured - predicted
  std::int32_t model_version = 0;       ///< 0: none
  AxisState state = AxisState::kNoModel;
  double command = kAbsent;  ///< of the frame; not sent, since subscribers receive the frame
};

/// The prediction for one servo cycle. Fixed size and trivially copyable: it is passed between
/// threads by value.
struct MachinePrediction {
  std::uint64_t sequence = 0;  ///< of the frame
  std::int64_t time_ns = 0;    ///< of the frame
  int axis_count = 0;
  int ahead_count = 0;
  double contour_error = kAbsent;           ///< predicted, where axes form a path (twin/contour.h)
  double measured_contour_error = kAbsent;  ///< the same of the encoder values
  std::array<AxisPrediction, kMaxAxes> axes{};
  std::array<std::array<double, kMaxLookAhead>, kMaxAxes>
      ahead{};  ///< predicted errors of coming cycles
  /// When the frame was due, sent or complete, by the steady clock; 0: unknown. Not sent.
  std::int64_t due_ns = 0;
};

/// The offset that the drive of one axis adds to its command (ilc/gate.h).
struct AxisOffset {
  double offset = 0.0;          ///< [m | rad], finite
  std::int64_t expires_ns = 0;  ///< when the drive must drop it, by the clock of the frames
  bool send = false;            ///< false: for information only; no drive may apply it
  std::uint32_t refusal = 0;    ///< reason, in the numbering of ilc/gate.h; 0: none
};

/// The live offsets of one servo cycle.
struct MachineOffset {
  std::uint64_t sequence = 0;  ///< of the frame
  std::int64_t time_ns = 0;    ///< of the frame
  int axis_count = 0;
  std::array<AxisOffset, kMaxAxes> axes{};
};

/// The largest size of a chunk of a program or a correction, and the largest number of chunks.
inline constexpr std::size_t kMaxChunkSamples = 1024;
inline constexpr std::size_t kMaxChunkValues = kMaxAxes * kMaxChunkSamples;
inline constexpr std::uint32_t kMaxProgramChunks = 256;

/// A part of a commanded path to be previewed or learned, as received: only the name and the sizes
/// have been checked.
struct ProgramChunk {
  std::string program;  ///< usable_name, up to 63 characters
  std::uint64_t revision = 0;
  std::uint32_t chunk = 0, chunks = 1;
  bool learn = false;
  std::vector<std::string> axes;
  std::vector<double> time_s;   ///< at most kMaxChunkSamples
  std::vector<double> command;  ///< [axis * samples + sample], at most kMaxChunkValues [m | rad]
};

enum class CorrectionState : std::uint8_t { kRefused, kPreviewed, kLearned, kWithdrawn };

/// Predicted tracking error of one axis over a program [m | rad].
struct AxisCorrectionFigures {
  std::string name;
  bool rotary = false;
  int model_version = 0;
  double before_rms = kAbsent, before_max = kAbsent, after_rms = kAbsent, after_max = kAbsent;
};

/// The result for a program, in the same chunks of samples as the program. A refusal and a
/// withdrawal are one chunk without samples.
struct CorrectionChunk {
  std::string program;
  std::uint64_t revision = 0;
  std::uint32_t chunk = 0, chunks = 1;
  CorrectionState state = CorrectionState::kRefused;
  std::string reason;               ///< one line for people
  std::int64_t created_ns = 0;      ///< since 1970
  std::int64_t valid_until_ns = 0;  ///< since 1970
  double cycle_s = 0.0;
  std::vector<AxisCorrectionFigures> axes;
  double contour_before_rms = kAbsent, contour_before_max = kAbsent;  ///< [m]
  double contour_after_rms = kAbsent, contour_after_max = kAbsent;    ///< [m]
  std::vector<double> corrected, error_before, error_after;           ///< [axis * samples + sample]
  std::vector<double> contour_before, contour_after;  ///< [sample]; empty without a path
};

/// A model that came into force.
struct ModelAnnouncement {
  std::string axis;
  int version = 0;
  int parent = 0;
  std::string created;  ///< ISO 8601, UTC
  std::string reason;
  std::string model_json;
};

/// A model that is to come into force.
struct ModelProposal {
  std::string axis;
  std::string origin;      ///< where it is from, for people
  bool force = false;      ///< without being judged
  std::string model_json;  ///< servotwin.model/1, not checked
};

/// The last diagnosis of an axis.
struct DiagnosisAnnouncement {
  std::string axis;
  std::string diagnosis_json;  ///< servotwin.diagnosis/1
};

enum class DaemonState : std::uint8_t { kStarting, kWaiting, kRunning, kStopping };

/// Of the residual of an axis; the numbers of the wire.
enum class AlarmState : std::uint8_t {
  kOff,       ///< not configured
  kLearning,  ///< the normal residual is being learned
  kWatching,
  kRaised,
};

struct AxisStatus {
  std::string name;
  int model_version = 0;
  double holdout_rms = kAbsent;
  std::string activity;       ///< what the identification of this axis is doing
  std::uint32_t refused = 0;  ///< candidates that did not come into force, since the daemon started
  std::string last_refusal{};  ///< why the last of them did not
  bool rotary = false;         ///< rad in place of m
  AlarmState alarm = AlarmState::kOff;
};

/// An event at the source of the frames: one line of text.
struct SourceNews {
  std::string text;
  bool good = false;  ///< a problem is over
};

/// How the clock of a second source differs from that of the first.
struct ClockDifference {
  bool settled = false;      ///< the next two are known
  double ahead_s = 0.0;      ///< what the second shows more than the first at the same moment
  double drift = 0.0;        ///< by how much that grows: 1e-6 is 1 us each second
  std::uint64_t absent = 0;  ///< cycles of the first for which the second had nothing
};

/// The counters of a bus from whose frames cycles are assembled (drivers/README.md).
struct BusStatus {
  std::string name;
  bool up = true;
  std::uint64_t frames = 0;
  std::uint64_t dropped = 0;       ///< by the kernel, because they were not read in time
  std::uint64_t packets_lost = 0;  ///< CAN over UDP
  std::uint64_t downs = 0;         ///< how often the interface went down or disappeared
  std::uint64_t missing = 0;       ///< messages that were not received in their cycle
  std::uint64_t late = 0;          ///< messages after the deadline of their cycle
  std::uint64_t unexpected = 0;    ///< frames of ids that the mapping does not have
  std::uint64_t error_frames = 0;
};

struct MachineStatus {
  std::int64_t time_ns = 0;
  DaemonState state = DaemonState::kStarting;
  double frame_rate_hz = 0.0;
  std::uint64_t frames = 0, lost = 0, malformed = 0, time_jumps = 0, not_finite = 0, overruns = 0;
  std::uint64_t predictions_dropped = 0, rows_dropped = 0;
  double wake_p50_s = kAbsent, wake_p99_s = kAbsent;  ///< from sending the frame to the loop
  double work_p50_s = kAbsent, work_p99_s = kAbsent, work_max_s = kAbsent;  ///< of the loop
  std::vector<AxisStatus> axes;
  std::string last_error;
  std::uint64_t repeated = 0;  ///< frames with the sequence number of the one before; ignored
  // For the page and programs that ask over HTTP; not sent over DDS.
  /// From the time when a frame was due, sent or complete to handing its prediction to the network.
  double publish_p50_s = kAbsent, publish_p99_s = kAbsent, publish_p999_s = kAbsent,
         publish_max_s = kAbsent;
  std::vector<BusStatus> buses;
  std::optional<ClockDifference> clocks{};  ///< of two sources that are joined
  std::string
      not_recording;  ///< why cycles are not recorded although configured; empty: they are recorded
};

}  // namespace servotwin
