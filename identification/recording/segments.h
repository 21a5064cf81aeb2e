// From a recording to unbroken, evenly sampled segments of one axis, with a report of what was
// repaired or dropped.
//
// Missing samples and rows without a value (NaN) are bridged by linear interpolation up to a limit;
// beyond it the recording is split there. Samples at uneven times are resampled linearly onto a
// grid at their median step. identification/recording/stamps.h evaluates the time stamps. A torque
// and the encoder of a motor beside that of the load are bridged the same way but split nothing:
// where they are missing for longer they stay NaN. Times in
// seconds, as stamped in the recording. Errors: std::runtime_error, one line. Any thread.
#pragma once

#include <cstddef>
#include <limits>
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

#include "identification/recording/stamps.h"
#include "twin/sample.h"

namespace servotwin {

struct SegmentLimits {
  double bridge_gap_s = 0.005;  ///< longest gap that is bridged; a gap of
  int bridge_samples = 3;       ///< this many missing samples is always bridged
  int shortest = 10;            ///< shortest segment [samples]; shorter ones are dropped
  StampLimits stamps;
};

struct SegmentReport {
  struct Split {
    double time_s = 0.0;    ///< of the last sample before it
    double length_s = 0.0;  ///< to the first sample after it
  };
  struct Stretch {
    double begin_s = 0.0, end_s = 0.0;
    std::size_t samples = 0;
  };
  std::string axis;
  std::size_t rows = 0;       ///< of the recording
  std::size_t used_rows = 0;  ///< of them in segments
  double duration_s = 0.0;    ///< from the first stamp to the last
  double sample_time_s = 0.0;
  double rate_hz = 0.0;
  Spacing spacing = Spacing::kEven;
  std::vector<Stretch> segments;
  std::vector<Split> splits;
  std::size_t gaps_bridged = 0;     ///< stretches that were interpolated
  std::size_t samples_bridged = 0;  ///< samples that were interpolated, over gaps and NaN rows
  double longest_bridged_s = 0.0;   ///< from the sample before it to the sample after it
  std::size_t nan_bridged = 0;      ///< rows without command or actual that were interpolated over
  std::size_t nan_dropped = 0;      ///< such rows where the recording was split, or at its ends
  struct Gaps {
    std::size_t bridged = 0, missing = 0;  ///< samples
  };
  Gaps motor, torque;                                    ///< of channels that split nothing
  std::size_t short_stretches = 0;                       ///< dropped
  std::size_t short_rows = 0;                            ///< in them
  std::size_t repeated = 0, repaired = 0, unplaced = 0;  ///< as in Stamps
  double resolution_s = 0.0, jitter_rms = 0.0, jitter_max = 0.0;  ///< as in Stamps

  /// What was read, repaired or dropped, one item per line, for output.
  [[nodiscard]] std::vector<std::string> lines() const;
};

/// `actual` of the segments is empty if the recording has no encoder values at all.
struct SegmentedAxis {
  std::string source;  ///< the recording's
  std::string axis;
  bool rotary = false;
  std::string torque_unit;  ///< empty without torque
  std::string neighbour;    ///< name of the axis whose command and encoder the segments contain too
  double sample_time_s = 0.0;
  std::vector<Segment> segments;  ///< at least one
  SegmentReport report;
};

/// With command and encoder of `neighbour` beside it; empty: of the first other axis that has one
/// at the same times. Throws if there is no such axis, no command, no usable time, or no segment
/// that is long enough.
[[nodiscard]] SegmentedAxis segment_axis(const Recording& recording, std::string_view axis,
                                         const SegmentLimits& limits = {},
                                         std::string_view neighbour = {});

/// Adds another recording of the same axis: its segments follow those of `axis`, one second after
/// their end, whatever their own stamps are. The new start of its first segment [s]. Torque, the
/// motor's encoder, or the other axis of the plane, is kept where both have it. Throws if one is
/// rotary and the other not, if their rates or the units of their torques differ, or if only one
/// has an encoder.
double append(SegmentedAxis& axis, SegmentedAxis next);

/// Whether any segment has a torque signal.
[[nodiscard]] bool has_torque(const SegmentedAxis& axis);

/// `size` samples of a segment, from sample `begin` on.
[[nodiscard]] Segment part_of(const Segment& whole, Eigen::Index begin, Eigen::Index size);

/// Parts of these segments with the samples before them as lead-in: friction, play and integrator
/// begin a part in a state that only the motion before it tells. As many samples as contain an
/// encoder's travel of `travel` [m | rad]; all where there is none so far.
[[nodiscard]] std::vector<Segment> with_lead_in(
    const std::vector<Segment>& parts, const std::vector<Segment>& segments,
    double travel = std::numeric_limits<double>::infinity());

/// The part of the segments between two times of the recording [s]. Parts of less than 20 samples
/// are dropped.
[[nodiscard]] std::vector<Segment> cut(const std::vector<Segment>& segments, double from_s,
                                       double to_s);

/// Throws UnusableRecording where a segment has no encoder values.
void require_encoder(const SegmentedAxis& axis);

/// Throws if command or encoder is constant, or there is no encoder: nothing can be identified from
/// an axis at rest. Throws UnusableRecording if the command is faster or longer than any machine:
/// its unit is wrong.
void require_motion(const SegmentedAxis& axis);

/// What no diagnosis can use, whatever else was recorded: wrong units, too few samples in a second,
/// exchanged columns.
struct UnusableRecording : std::runtime_error {
  using std::runtime_error::runtime_error;
};

}  // namespace servotwin
