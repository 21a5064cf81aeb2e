#include "daemon/web/metrics.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <functional>
#include <utility>

#include "daemon/publish/status_figures.h"
#include "daemon/web/live_json.h"

namespace servotwin::daemon {
namespace {

std::string value_text(double value) {
  if (std::isnan(value)) return "NaN";
  if (std::isinf(value)) return value > 0.0 ? "+Inf" : "-Inf";
  char text[40];
  const auto end = std::to_chars(text, text + sizeof text, value);
  return {text, end.ptr};
}

/// Escapes a text for the quotes of a label.
std::string escaped_label(const std::string& text) {
  std::string out;
  for (const char c : text) {
    if (c == '\n') {
      out += "\\n";
      continue;
    }
    if (c == '\\' || c == '"') out += '\\';
    out += c;
  }
  return out;
}

std::string label(const char* name, const std::string& value) {
  return std::string(name) + "=\"" + escaped_label(value) + "\"";
}

class Text {
 public:
  /// Begins a metric; the following samples belong to it.
  void family(const std::string& name, const char* type, const char* help) {
    name_ = "servotwin_" + name;
    out_ += "# HELP " + name_ + " " + help + "\n# TYPE " + name_ + " " + type + "\n";
  }
  void sample(double value, const std::string& labels = "", const char* suffix = "") {
    out_ += name_ + suffix + (labels.empty() ? "" : "{" + labels + "}") + " " + value_text(value) +
            "\n";
  }
  void gauge(const char* name, const char* help, double value) {
    family(name, "gauge", help);
    sample(value);
  }
  void counter(const char* name, const char* help, std::uint64_t value) {
    family(name, "counter", help);
    sample(static_cast<double>(value));
  }
  void histogram(const char* name, const char* help, const Histogram& histogram) {
    family(name, "histogram", help);
    std::uint64_t below = 0;
    for (int octave = kFirstOctave; octave <= kLastOctave; ++octave) {
      below = histogram.below_octave(octave);
      sample(static_cast<double>(below), label("le", value_text(std::ldexp(1e-9, octave))),
             "_bucket");
    }
    // The loop counts at the same time: no bucket may be smaller than the one before.
    const auto all = static_cast<double>(std::max(below, histogram.count()));
    sample(all, label("le", "+Inf"), "_bucket");
    sample(histogram.sum_s(), "", "_sum");
    sample(all, "", "_count");
  }
  std::string take() { return std::move(out_); }

 private:
  std::string name_, out_;
};

void write_counters(const MachineStatus& status, Text& text) {
  for (const StatusCounter& counter : kStatusCounters)
    text.counter(counter.metric, counter.help, status.*counter.count);
  text.gauge("recording_stopped", "1 if cycles that should be recorded are not recorded.",
             status.not_recording.empty() ? 0.0 : 1.0);
}

void write_buses(const std::vector<BusStatus>& buses, Text& text) {
  const auto each = [&](const char* name, const char* type, const char* help, auto member) {
    text.family(name, type, help);
    for (const BusStatus& bus : buses)
      text.sample(static_cast<double>(bus.*member), label("bus", bus.name));
  };
  each("bus_up", "gauge", "1 if the interface is up.", &BusStatus::up);
  each("bus_frames_total", "counter", "Frames received.", &BusStatus::frames);
  each("bus_frames_dropped_total", "counter",
       "Frames dropped by the kernel: they were not read in time.", &BusStatus::dropped);
  each("bus_packets_lost_total", "counter", "Packets of CAN over UDP that were lost.",
       &BusStatus::packets_lost);
  each("bus_messages_missing_total", "counter", "Messages missing in their cycle.",
       &BusStatus::missing);
  each("bus_messages_late_total", "counter", "Messages received after the deadline of their cycle.",
       &BusStatus::late);
  each("bus_frames_unexpected_total", "counter", "Frames with an id that is not in the mapping.",
       &BusStatus::unexpected);
  each("bus_error_frames_total", "counter", "Error frames of the interface.",
       &BusStatus::error_frames);
  each("bus_downs_total", "counter", "How often the interface went down or was removed.",
       &BusStatus::downs);
}

void write_clocks(const ClockDifference& clocks, Text& text) {
  text.gauge("clocks_known", "1 if two joined sources are aligned by their clocks.",
             clocks.settled ? 1.0 : 0.0);
  text.gauge("clock_ahead_seconds", "What the clock of the second source shows more.",
             clocks.settled ? clocks.ahead_s : kAbsent);
  text.gauge("clock_drift_ratio", "By how much that grows, seconds per second.",
             clocks.settled ? clocks.drift : kAbsent);
  text.counter("cycles_without_second_source_total",
               "Cycles for which the second source had nothing.", clocks.absent);
}

void write_axes(const MetricsInput& input, Text& text) {
  const std::vector<AxisDescription>& axes = input.description.axes;
  const auto each = [&](const char* name, const char* type, const char* help,
                        const std::function<double(std::size_t)>& value) {
    text.family(name, type, help);
    for (std::size_t i = 0; i < axes.size(); ++i)
      text.sample(value(i), label("axis", axes[i].name));
  };
  const auto known = [&](std::size_t i) {
    return i < input.live.status.axes.size() ? input.live.status.axes[i] : AxisStatus{};
  };
  const auto seen = [&](std::size_t i) {
    return i < input.live.axes.size() ? input.live.axes[i] : LiveAxisFigures{};
  };
  each("model_version", "gauge", "Version of the model in force; 0: none.",
       [&](std::size_t i) { return known(i).model_version; });
  each("model_holdout_rms", "gauge",
       "Residual RMS of the model in force on held-out motion, in m or rad.",
       [&](std::size_t i) { return known(i).holdout_rms; });
  each("models_refused_total", "counter", "Candidates that did not come into force.",
       [&](std::size_t i) { return known(i).refused; });
  each("tracking_error_rms", "gauge",
       "RMS of command minus encoder value over the last second, in m or rad.",
       [&](std::size_t i) { return seen(i).measured.rms; });
  each("tracking_error_max", "gauge",
       "Largest absolute difference of command and encoder over the last second, in m or rad.",
       [&](std::size_t i) { return seen(i).measured.max; });
  each("predicted_error_rms", "gauge",
       "RMS of the predicted error over the last second, in m or rad.",
       [&](std::size_t i) { return seen(i).predicted.rms; });
  each("residual_rms", "gauge",
       "RMS of measured minus predicted error over the last second, in m or rad.",
       [&](std::size_t i) { return seen(i).residual.rms; });
  each("residual_max", "gauge", "Largest absolute residual over the last second, in m or rad.",
       [&](std::size_t i) { return seen(i).residual.max; });
  text.family("alarm", "gauge", "State of the residual alarm: 1 for the current state.");
  for (std::size_t i = 0; i < input.alarms.size() && i < axes.size(); ++i) {
    for (const AlarmState state :
         {AlarmState::kOff, AlarmState::kLearning, AlarmState::kWatching, AlarmState::kRaised}) {
      text.sample(input.alarms[i] == state ? 1.0 : 0.0,
                  label("axis", axes[i].name) + "," + label("state", name_of(state)));
    }
  }
}

}  // namespace

std::string metrics_text(const MetricsInput& input) {
  Text text;
  text.family("build_info", "gauge", "Version of the program and name of its machine.");
  text.sample(1.0, label("machine", input.machine) + "," + label("version", input.version));
  text.gauge("uptime_seconds", "Time since the daemon started.", input.uptime_s);
  text.gauge("healthy", "1 if /healthz answers 200.", input.healthy ? 1.0 : 0.0);
  text.gauge("store_lost", "1 if a part of the store was lost or could not be used at the start.",
             input.store_lost ? 1.0 : 0.0);
  text.gauge("store_damaged", "1 if damage of the store was found since the start.",
             input.store_damaged ? 1.0 : 0.0);
  text.gauge("frame_rate_hz", "Servo cycles per second, over the last second.",
             input.live.status.frame_rate_hz);
  write_counters(input.live.status, text);
  if (input.wake != nullptr)
    text.histogram("wake_seconds",
                   "Time from a frame being due or sent until the real-time loop has it.",
                   *input.wake);
  if (input.work != nullptr)
    text.histogram("work_seconds", "Time that the real-time loop works on one cycle.", *input.work);
  if (input.published != nullptr)
    text.histogram(
        "publish_seconds",
        "Time from a frame being due, sent or complete until its prediction is handed to DDS.",
        *input.published);
  if (!input.live.status.buses.empty()) write_buses(input.live.status.buses, text);
  if (input.live.status.clocks) write_clocks(*input.live.status.clocks, text);
  write_axes(input, text);
  text.gauge("contour_error_rms", "RMS of the predicted contour error over the last second, in m.",
             input.live.contour.rms);
  text.gauge("measured_contour_error_rms",
             "RMS of the measured contour error over the last second, in m.",
             input.live.measured_contour.rms);
  text.gauge("recordings_bytes", "Size of all recorded files of this machine.",
             input.recordings_bytes);
  text.gauge("recordings_files", "Number of recorded files of this machine.",
             input.recordings_files);
  text.gauge("streams", "Live streams that are open.", static_cast<double>(input.streams));
  text.counter("streams_dropped_total", "Live streams ended because their reader was too slow.",
               input.slow_streams);
  text.counter("live_batches_dropped_total",
               "Batches of live cycles dropped because the web thread was too slow.",
               input.batches_dropped);
  return text.take();
}

}  // namespace servotwin::daemon
