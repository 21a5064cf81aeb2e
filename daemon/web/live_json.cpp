#include "daemon/web/live_json.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <nlohmann/json.hpp>

#include "daemon/publish/status_figures.h"
#include "identification/model/json_number.h"

namespace servotwin::daemon {
namespace {

using nlohmann::json;

// Significant digits: commands to 1 nm in 10 m; an error of 1 m to 0.1 um, one of 1 mm to 0.1 nm.
constexpr int kCommandDigits = 11;
constexpr int kErrorDigits = 7;

void append(std::string& out, double value, int digits) {
  if (!std::isfinite(value)) {
    out += "null";
    return;
  }
  char text[40];
  const auto end =
      std::to_chars(text, text + sizeof text, value, std::chars_format::general, digits);
  out.append(text, end.ptr);
}

void append(std::string& out, const char* name, const std::vector<double>& values, int digits) {
  out.append(",\"").append(name).append("\":[");
  for (const double value : values) {
    append(out, value, digits);
    out += ',';
  }
  if (!values.empty()) out.pop_back();
  out += ']';
}

void append(std::string& out, const std::string& name, const LiveSeries& series, int digits) {
  append(out, name.c_str(), series.value, digits);
  if (series.least.empty()) return;
  append(out, (name + "_min").c_str(), series.least, digits);
  append(out, (name + "_max").c_str(), series.greatest, digits);
}

json figures_json(const LiveFigures& figures) {
  return {{"rms_m", number_or_null(figures.rms)}, {"max_m", number_or_null(figures.max)}};
}

json axis_json(const AxisDescription& axis) {
  return {{"name", axis.name}, {"rotary", axis.rotary}, {"torque_unit", axis.torque_unit}};
}

json clocks_json(const std::optional<ClockDifference>& clocks) {
  if (!clocks) return nullptr;
  return {{"known", clocks->settled},
          {"ahead_s", number_or_null(clocks->settled ? clocks->ahead_s : kAbsent)},
          {"drift_ppm", number_or_null(clocks->settled ? 1e6 * clocks->drift : kAbsent)},
          {"absent", clocks->absent}};
}

}  // namespace

const char* name_of(AlarmState state) noexcept {
  constexpr const char* kNames[]{"off", "learning", "watching", "raised"};
  return kNames[static_cast<std::size_t>(state)];
}

const char* state_name(DaemonState state) noexcept {
  constexpr const char* kNames[]{"starting", "waiting", "running", "stopping"};
  return kNames[static_cast<std::size_t>(state)];
}

const char* state_name(AxisState state) noexcept {
  constexpr const char* kNames[]{"no model", "settling", "predicting", "bad sample"};
  return kNames[static_cast<std::size_t>(state)];
}

json status_json(const LiveStatus& live, const MachineDescription& machine,
                 const std::vector<AlarmState>& alarms) {
  const MachineStatus& status = live.status;
  json axes = json::array();
  for (std::size_t i = 0; i < machine.axes.size(); ++i) {
    json axis = axis_json(machine.axes[i]);
    axis["alarm"] = i < alarms.size() ? name_of(alarms[i]) : "off";
    if (i < status.axes.size()) {
      const AxisStatus& known = status.axes[i];
      axis["model_version"] = known.model_version;
      axis["holdout_rms_m"] = number_or_null(known.holdout_rms);
      axis["activity"] = known.activity;
      axis["refused"] = known.refused;
      axis["last_refusal"] = known.last_refusal;
    }
    const LiveAxisFigures figures = i < live.axes.size() ? live.axes[i] : LiveAxisFigures{};
    axis["last_second"] = {{"measured", figures_json(figures.measured)},
                           {"predicted", figures_json(figures.predicted)},
                           {"residual", figures_json(figures.residual)}};
    axes.push_back(axis);
  }
  json buses = json::array();
  for (const BusStatus& bus : status.buses) {
    buses.push_back({{"name", bus.name},
                     {"up", bus.up},
                     {"frames", bus.frames},
                     {"dropped", bus.dropped},
                     {"packets_lost", bus.packets_lost},
                     {"downs", bus.downs},
                     {"missing", bus.missing},
                     {"late", bus.late},
                     {"unexpected", bus.unexpected},
                     {"error_frames", bus.error_frames}});
  }
  json out = figures_of(status);
  out.update({{"schema", "servotwin.status/1"},
              {"state", state_name(status.state)},
              {"time_ns", status.time_ns},
              {"cycle_s", number_or_null(machine.axes.empty() ? kAbsent : machine.cycle_s)},
              {"publish_p50_s", number_or_null(status.publish_p50_s)},
              {"publish_p99_s", number_or_null(status.publish_p99_s)},
              {"publish_p999_s", number_or_null(status.publish_p999_s)},
              {"publish_max_s", number_or_null(status.publish_max_s)},
              {"buses", std::move(buses)},
              {"clocks", clocks_json(status.clocks)},
              {"contour_last_second", figures_json(live.contour)},
              {"measured_contour_last_second", figures_json(live.measured_contour)},
              {"not_recording", status.not_recording},
              {"axes", axes}});
  return out;
}

json octaves_json(const Histogram& histogram) {
  json out = json::array();
  std::uint64_t below = 0;
  for (int octave = kFirstOctave; octave <= kLastOctave + 1; ++octave) {
    const bool last = octave > kLastOctave;
    const std::uint64_t all =
        last ? std::max(below, histogram.count()) : histogram.below_octave(octave);
    out.push_back(
        {{"below_s", last ? json() : json(std::ldexp(1e-9, octave))}, {"count", all - below}});
    below = all;
  }
  const auto empty = [](const json& one) { return one["count"] == 0; };
  while (!out.empty() && empty(out.back())) out.erase(out.size() - 1);
  while (!out.empty() && empty(out.front())) out.erase(0);
  return out;
}

std::string batch_json(const LiveBatch& batch) {
  std::string out = "{\"schema\":\"servotwin.live/1\",\"first_sequence\":";
  out += std::to_string(batch.first_sequence);
  out += ",\"first_time_ns\":" + std::to_string(batch.first_time_ns);
  out += ",\"point_s\":";
  append(out, batch.point_s, 12);
  out += ",\"cycles_per_point\":" + std::to_string(batch.cycles_per_point);
  out += std::string(",\"after_gap\":") + (batch.after_gap ? "true" : "false");
  append(out, "contour", batch.contour, kErrorDigits);
  append(out, "measured_contour", batch.measured_contour, kErrorDigits);
  out += ",\"axes\":[";
  for (const LiveAxisBatch& axis : batch.axes) {
    out += "{\"model_version\":" + std::to_string(axis.model_version);
    out.append(",\"state\":\"").append(state_name(axis.state)).append("\"");
    append(out, "command", axis.command, kCommandDigits);
    append(out, "measured", axis.measured, kErrorDigits);
    append(out, "predicted", axis.predicted, kErrorDigits);
    append(out, "residual", axis.residual, kErrorDigits);
    out += "},";
  }
  if (!batch.axes.empty()) out.pop_back();
  return out + "]}";
}

}  // namespace servotwin::daemon
