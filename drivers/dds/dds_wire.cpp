#include "drivers/dds/dds_wire.h"

#include <cmath>
#include <cstring>
#include <stdexcept>
#include <string>

namespace servotwin {
namespace {

static_assert(kMaxAxes == servotwin_msgs_kMaxAxes && kMaxLookAhead == servotwin_msgs_kMaxLookAhead,
              "the program and the wire agree on the largest machine");
static_assert(kMaxChunkSamples == servotwin_msgs_kMaxChunkSamples &&
                  kMaxChunkValues == servotwin_msgs_kMaxChunkValues &&
                  kMaxProgramChunks == servotwin_msgs_kMaxProgramChunks,
              "the program and the wire agree on the largest path");

/// Sets the length of a sequence; memory for `most` elements is allocated once.
template <class Sequence>
void resize(Sequence& sequence, std::size_t length, std::size_t most) {
  using Element = std::remove_pointer_t<decltype(sequence._buffer)>;
  if (sequence._buffer == nullptr) {
    sequence._buffer = static_cast<Element*>(dds_alloc(most * sizeof(Element)));  // zeroed
    sequence._maximum = static_cast<std::uint32_t>(most);
    sequence._release = true;
  }
  sequence._length = static_cast<std::uint32_t>(length);
}

void assign(char*& to, const std::string& from) {
  dds_free(to);
  to = dds_string_dup(from.c_str());
}

template <std::size_t N>
void assign(char (&to)[N], const std::string& from, const char* what) {
  if (from.size() >= N) {
    throw std::invalid_argument(std::string(what) + " '" + from + "' is longer than " +
                                std::to_string(N - 1) + " characters");
  }
  std::memcpy(to, from.c_str(), from.size() + 1);
}

std::vector<double> values(const dds_sequence_double& from) {
  return {from._buffer, from._buffer + from._length};
}
void assign(dds_sequence_double& to, const std::vector<double>& from, std::size_t most,
            const char* what) {
  if (from.size() > most) {
    throw std::invalid_argument(std::string(what) + ": " + std::to_string(from.size()) +
                                " values in a chunk, at most " + std::to_string(most) + " fit");
  }
  resize(to, from.size(), most);
  std::copy(from.begin(), from.end(), to._buffer);
}

/// Allocated once for the largest machine.
template <class Sequence>
void resize_axes(Sequence& axes, std::size_t count) {
  if (count > kMaxAxes) {
    throw std::invalid_argument("a machine has at most " + std::to_string(kMaxAxes) +
                                " axes, not " + std::to_string(count));
  }
  resize(axes, count, kMaxAxes);
}

std::string text(const char* from) { return from == nullptr ? std::string() : std::string(from); }

/// Converts the values ahead of time: rows of fixed width in the program, packed rows on the wire.
template <class Rows>
void unpack(const dds_sequence_double& from, int axes, int count, Rows& to) noexcept {
  for (std::size_t axis = 0; axis < static_cast<std::size_t>(axes); ++axis) {
    const double* row = from._buffer + axis * static_cast<std::size_t>(count);
    std::copy_n(row, count, to[axis].begin());
  }
}
template <class Rows>
void pack(const Rows& from, int axes, int count, dds_sequence_double& to) {
  resize(to, static_cast<std::size_t>(axes) * static_cast<std::size_t>(count),
         servotwin_msgs_kMaxAhead);
  double* next = to._buffer;
  for (std::size_t axis = 0; axis < static_cast<std::size_t>(axes); ++axis) {
    next = std::copy_n(from[axis].begin(), count, next);
  }
}

bool plausible(std::uint32_t axes, std::uint32_t ahead, std::uint32_t ahead_values) noexcept {
  return axes >= 1 && axes <= kMaxAxes && ahead <= kMaxLookAhead && ahead_values == axes * ahead;
}

}  // namespace

bool Wire<MachineFrame>::decode(const Sample& sample, MachineFrame& frame) noexcept {
  if (!plausible(sample.axes._length, sample.ahead_count, sample.ahead_m._length)) return false;
  frame.sequence = sample.sequence_number;
  frame.time_ns = sample.time_ns;
  frame.axis_count = static_cast<int>(sample.axes._length);
  frame.ahead_count = static_cast<int>(sample.ahead_count);
  for (std::size_t i = 0; i < sample.axes._length; ++i) {
    const auto& from = sample.axes._buffer[i];
    AxisSample& to = frame.axes[i];
    to.command = (from.flags & servotwin_msgs_kCommandInvalid) != 0 ? kAbsent : from.command_m;
    to.actual = (from.flags & servotwin_msgs_kActualInvalid) != 0 ? kAbsent : from.actual_m;
    to.torque = from.torque;
  }
  unpack(sample.ahead_m, frame.axis_count, frame.ahead_count, frame.ahead);
  return true;
}

void Wire<MachineFrame>::encode(const MachineFrame& frame, Sample& sample) {
  sample.sequence_number = frame.sequence;
  sample.time_ns = frame.time_ns;
  resize(sample.axes, static_cast<std::size_t>(frame.axis_count), kMaxAxes);
  for (std::size_t i = 0; i < sample.axes._length; ++i) {
    const AxisSample& from = frame.axes[i];
    sample.axes._buffer[i] = {from.command, from.actual, from.torque, 0};
  }
  sample.ahead_count = static_cast<std::uint32_t>(frame.ahead_count);
  pack(frame.ahead, frame.axis_count, frame.ahead_count, sample.ahead_m);
}

bool Wire<MachineDescription>::decode(const Sample& sample, MachineDescription& description) {
  if (sample.axes._length < 1 || sample.axes._length > kMaxAxes) return false;
  if (!(sample.cycle_s >= kMinCycle_s && sample.cycle_s <= kMaxCycle_s)) return false;
  description.cycle_s = sample.cycle_s;
  description.axes.clear();
  for (std::size_t i = 0; i < sample.axes._length; ++i) {
    const auto& from = sample.axes._buffer[i];
    if (!usable_name(from.name)) return false;
    for (const AxisDescription& other : description.axes) {
      if (other.name == from.name) return false;
    }
    description.axes.push_back({from.name, from.rotary, from.torque_unit});
  }
  return true;
}

void Wire<MachineDescription>::encode(const MachineDescription& description, Sample& sample) {
  resize_axes(sample.axes, description.axes.size());
  sample.cycle_s = description.cycle_s;
  for (std::size_t i = 0; i < description.axes.size(); ++i) {
    auto& to = sample.axes._buffer[i];
    if (!usable_name(description.axes[i].name)) {
      throw std::invalid_argument("axis name '" + description.axes[i].name +
                                  "': " + std::string(kUsableNameRule));
    }
    assign(to.name, description.axes[i].name, "axis name");
    to.rotary = description.axes[i].rotary;
    assign(to.torque_unit, description.axes[i].torque_unit, "torque unit");
  }
}

bool Wire<MachinePrediction>::decode(const Sample& sample, MachinePrediction& prediction) noexcept {
  if (!plausible(sample.axes._length, sample.ahead_count, sample.ahead_error_m._length))
    return false;
  prediction.sequence = sample.sequence_number;
  prediction.time_ns = sample.time_ns;
  prediction.axis_count = static_cast<int>(sample.axes._length);
  prediction.ahead_count = static_cast<int>(sample.ahead_count);
  prediction.contour_error = sample.contour_error_m;
  prediction.measured_contour_error = sample.measured_contour_error_m;
  for (std::size_t i = 0; i < sample.axes._length; ++i) {
    const auto& from = sample.axes._buffer[i];
    prediction.axes[i] = {from.predicted_error_m, from.standard_deviation_m,
                          from.measured_error_m,  from.residual_m,
                          from.model_version,     static_cast<AxisState>(from.state)};
  }
  unpack(sample.ahead_error_m, prediction.axis_count, prediction.ahead_count, prediction.ahead);
  return true;
}

void Wire<MachinePrediction>::encode(const MachinePrediction& prediction, Sample& sample) {
  sample.sequence_number = prediction.sequence;
  sample.time_ns = prediction.time_ns;
  resize(sample.axes, static_cast<std::size_t>(prediction.axis_count), kMaxAxes);
  for (std::size_t i = 0; i < sample.axes._length; ++i) {
    const AxisPrediction& from = prediction.axes[i];
    sample.axes._buffer[i] = {
        from.predicted_error, from.standard_deviation,
        from.measured_error,  from.residual,
        from.model_version,   static_cast<servotwin_msgs_AxisState>(from.state)};
  }
  sample.ahead_count = static_cast<std::uint32_t>(prediction.ahead_count);
  pack(prediction.ahead, prediction.axis_count, prediction.ahead_count, sample.ahead_error_m);
  sample.contour_error_m = prediction.contour_error;
  sample.measured_contour_error_m = prediction.measured_contour_error;
}

bool Wire<ModelAnnouncement>::decode(const Sample& sample, ModelAnnouncement& model) {
  if (sample.axis[0] == '\0' || sample.version < 1) return false;
  model = {sample.axis,          sample.version,      sample.parent,
           text(sample.created), text(sample.reason), text(sample.model_json)};
  return true;
}

void Wire<ModelAnnouncement>::encode(const ModelAnnouncement& model, Sample& sample) {
  assign(sample.axis, model.axis, "axis name");
  sample.version = model.version;
  sample.parent = model.parent;
  assign(sample.created, model.created);
  assign(sample.reason, model.reason);
  assign(sample.model_json, model.model_json);
}

bool Wire<ModelProposal>::decode(const Sample& sample, ModelProposal& proposal) {
  if (sample.axis[0] == '\0') return false;
  proposal = {sample.axis, text(sample.origin), sample.force, text(sample.model_json)};
  return true;
}

void Wire<ModelProposal>::encode(const ModelProposal& proposal, Sample& sample) {
  assign(sample.axis, proposal.axis, "axis name");
  assign(sample.origin, proposal.origin);
  sample.force = proposal.force;
  assign(sample.model_json, proposal.model_json);
}

bool Wire<DiagnosisAnnouncement>::decode(const Sample& sample, DiagnosisAnnouncement& diagnosis) {
  if (sample.axis[0] == '\0') return false;
  diagnosis = {sample.axis, text(sample.diagnosis_json)};
  return true;
}

void Wire<DiagnosisAnnouncement>::encode(const DiagnosisAnnouncement& diagnosis, Sample& sample) {
  assign(sample.axis, diagnosis.axis, "axis name");
  assign(sample.diagnosis_json, diagnosis.diagnosis_json);
}

bool Wire<MachineStatus>::decode(const Sample& sample, MachineStatus& status) {
  if (sample.axes._length > kMaxAxes) return false;
  status.time_ns = sample.time_ns;
  status.state = static_cast<DaemonState>(sample.state);
  status.frame_rate_hz = sample.frame_rate_hz;
  status.frames = sample.frames;
  status.lost = sample.lost;
  status.malformed = sample.malformed;
  status.time_jumps = sample.time_jumps;
  status.not_finite = sample.not_finite;
  status.overruns = sample.overruns;
  status.predictions_dropped = sample.predictions_dropped;
  status.rows_dropped = sample.rows_dropped;
  status.wake_p50_s = sample.wake_p50_s;
  status.wake_p99_s = sample.wake_p99_s;
  status.work_p50_s = sample.work_p50_s;
  status.work_p99_s = sample.work_p99_s;
  status.work_max_s = sample.work_max_s;
  status.axes.clear();
  for (std::size_t i = 0; i < sample.axes._length; ++i) {
    const auto& from = sample.axes._buffer[i];
    status.axes.push_back({from.name, from.model_version, from.holdout_rms_m, text(from.activity),
                           from.refused, text(from.last_refusal)});
  }
  for (std::size_t i = 0; i < status.axes.size() && i < sample.rotary._length; ++i)
    status.axes[i].rotary = sample.rotary._buffer[i];
  constexpr auto kLast = static_cast<std::uint8_t>(AlarmState::kRaised);
  for (std::size_t i = 0; i < status.axes.size() && i < sample.alarm._length; ++i) {
    if (sample.alarm._buffer[i] <= kLast)
      status.axes[i].alarm = static_cast<AlarmState>(sample.alarm._buffer[i]);
  }
  status.last_error = text(sample.last_error);
  status.repeated = sample.repeated;
  return true;
}

void Wire<MachineStatus>::encode(const MachineStatus& status, Sample& sample) {
  sample.time_ns = status.time_ns;
  sample.state = static_cast<servotwin_msgs_DaemonState>(status.state);
  sample.frame_rate_hz = status.frame_rate_hz;
  sample.frames = status.frames;
  sample.lost = status.lost;
  sample.malformed = status.malformed;
  sample.time_jumps = status.time_jumps;
  sample.not_finite = status.not_finite;
  sample.overruns = status.overruns;
  sample.predictions_dropped = status.predictions_dropped;
  sample.rows_dropped = status.rows_dropped;
  sample.wake_p50_s = status.wake_p50_s;
  sample.wake_p99_s = status.wake_p99_s;
  sample.work_p50_s = status.work_p50_s;
  sample.work_p99_s = status.work_p99_s;
  sample.work_max_s = status.work_max_s;
  resize(sample.axes, status.axes.size(), kMaxAxes);
  for (std::size_t i = 0; i < status.axes.size(); ++i) {
    auto& to = sample.axes._buffer[i];
    assign(to.name, status.axes[i].name, "axis name");
    to.model_version = status.axes[i].model_version;
    to.holdout_rms_m = status.axes[i].holdout_rms;
    assign(to.activity, status.axes[i].activity);
    to.refused = status.axes[i].refused;
    assign(to.last_refusal, status.axes[i].last_refusal);
  }
  resize(sample.rotary, status.axes.size(), kMaxAxes);
  for (std::size_t i = 0; i < status.axes.size(); ++i)
    sample.rotary._buffer[i] = status.axes[i].rotary;
  resize(sample.alarm, status.axes.size(), kMaxAxes);
  for (std::size_t i = 0; i < status.axes.size(); ++i)
    sample.alarm._buffer[i] = static_cast<std::uint8_t>(status.axes[i].alarm);
  assign(sample.last_error, status.last_error);
  sample.repeated = status.repeated;
}

// Other numbers are not checked; this one would move an axis.
bool Wire<MachineOffset>::decode(const Sample& sample, MachineOffset& offset) noexcept {
  if (sample.axes._length < 1 || sample.axes._length > kMaxAxes) return false;
  offset.sequence = sample.sequence_number;
  offset.time_ns = sample.time_ns;
  offset.axis_count = static_cast<int>(sample.axes._length);
  for (std::size_t i = 0; i < sample.axes._length; ++i) {
    const auto& from = sample.axes._buffer[i];
    if (!std::isfinite(from.offset_m)) return false;
    offset.axes[i] = {from.offset_m, from.expires_ns, from.send, from.refusal};
  }
  return true;
}

void Wire<MachineOffset>::encode(const MachineOffset& offset, Sample& sample) {
  sample.sequence_number = offset.sequence;
  sample.time_ns = offset.time_ns;
  resize(sample.axes, static_cast<std::size_t>(offset.axis_count), kMaxAxes);
  for (std::size_t i = 0; i < sample.axes._length; ++i) {
    const AxisOffset& from = offset.axes[i];
    sample.axes._buffer[i] = {from.offset, from.expires_ns, from.send, from.refusal};
  }
}

bool Wire<ProgramChunk>::decode(const Sample& sample, ProgramChunk& chunk) {
  if (!usable_name(sample.program)) return false;
  chunk.program = sample.program;
  chunk.revision = sample.revision;
  chunk.chunk = sample.chunk;
  chunk.chunks = sample.chunks;
  chunk.learn = sample.learn;
  chunk.axes.clear();
  for (std::size_t i = 0; i < sample.axes._length; ++i)
    chunk.axes.emplace_back(sample.axes._buffer[i].name);
  chunk.time_s = values(sample.time_s);
  chunk.command = values(sample.command_m);
  return true;
}

void Wire<ProgramChunk>::encode(const ProgramChunk& chunk, Sample& sample) {
  assign(sample.program, chunk.program, "program name");
  sample.revision = chunk.revision;
  sample.chunk = chunk.chunk;
  sample.chunks = chunk.chunks;
  sample.learn = chunk.learn;
  resize_axes(sample.axes, chunk.axes.size());
  for (std::size_t i = 0; i < chunk.axes.size(); ++i)
    assign(sample.axes._buffer[i].name, chunk.axes[i], "axis name");
  assign(sample.time_s, chunk.time_s, kMaxChunkSamples, "time_s");
  assign(sample.command_m, chunk.command, kMaxChunkValues, "command_m");
}

bool Wire<CorrectionChunk>::decode(const Sample& sample, CorrectionChunk& chunk) {
  const std::uint32_t count = sample.corrected_m._length;
  if (sample.error_before_m._length != count || sample.error_after_m._length != count ||
      sample.contour_before_m._length != sample.contour_after_m._length ||
      sample.chunk >= sample.chunks) {
    return false;
  }
  chunk.program = sample.program;
  chunk.revision = sample.revision;
  chunk.chunk = sample.chunk;
  chunk.chunks = sample.chunks;
  chunk.state = static_cast<CorrectionState>(sample.state);
  chunk.reason = text(sample.reason);
  chunk.created_ns = sample.created_ns;
  chunk.valid_until_ns = sample.valid_until_ns;
  chunk.cycle_s = sample.cycle_s;
  chunk.axes.clear();
  for (std::size_t i = 0; i < sample.axes._length; ++i) {
    const auto& from = sample.axes._buffer[i];
    chunk.axes.push_back({from.name, from.rotary, from.model_version, from.before_rms_m,
                          from.before_max_m, from.after_rms_m, from.after_max_m});
  }
  chunk.contour_before_rms = sample.contour_before_rms_m;
  chunk.contour_before_max = sample.contour_before_max_m;
  chunk.contour_after_rms = sample.contour_after_rms_m;
  chunk.contour_after_max = sample.contour_after_max_m;
  chunk.corrected = values(sample.corrected_m);
  chunk.error_before = values(sample.error_before_m);
  chunk.error_after = values(sample.error_after_m);
  chunk.contour_before = values(sample.contour_before_m);
  chunk.contour_after = values(sample.contour_after_m);
  return true;
}

void Wire<CorrectionChunk>::encode(const CorrectionChunk& chunk, Sample& sample) {
  assign(sample.program, chunk.program, "program name");
  sample.revision = chunk.revision;
  sample.chunk = chunk.chunk;
  sample.chunks = chunk.chunks;
  sample.state = static_cast<servotwin_msgs_CorrectionState>(chunk.state);
  assign(sample.reason, chunk.reason);
  sample.created_ns = chunk.created_ns;
  sample.valid_until_ns = chunk.valid_until_ns;
  sample.cycle_s = chunk.cycle_s;
  resize_axes(sample.axes, chunk.axes.size());
  for (std::size_t i = 0; i < chunk.axes.size(); ++i) {
    const AxisCorrectionFigures& from = chunk.axes[i];
    auto& to = sample.axes._buffer[i];
    assign(to.name, from.name, "axis name");
    to.rotary = from.rotary;
    to.model_version = from.model_version;
    to.before_rms_m = from.before_rms;
    to.before_max_m = from.before_max;
    to.after_rms_m = from.after_rms;
    to.after_max_m = from.after_max;
  }
  sample.contour_before_rms_m = chunk.contour_before_rms;
  sample.contour_before_max_m = chunk.contour_before_max;
  sample.contour_after_rms_m = chunk.contour_after_rms;
  sample.contour_after_max_m = chunk.contour_after_max;
  assign(sample.corrected_m, chunk.corrected, kMaxChunkValues, "corrected_m");
  assign(sample.error_before_m, chunk.error_before, kMaxChunkValues, "error_before_m");
  assign(sample.error_after_m, chunk.error_after, kMaxChunkValues, "error_after_m");
  assign(sample.contour_before_m, chunk.contour_before, kMaxChunkSamples, "contour_before_m");
  assign(sample.contour_after_m, chunk.contour_after, kMaxChunkSamples, "contour_after_m");
}

}  // namespace servotwin
