#include "cli/common/summary_text.h"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "cli/common/model_text.h"
#include "cli/common/output.h"
#include "daemon/publish/status_figures.h"
#include "identification/model/json_number.h"
#include "twin/shown_units.h"

namespace servotwin::cli {
namespace {

using nlohmann::json;

constexpr const char* kWatchSchema = "servotwin.watch/1";
constexpr std::size_t kShownRefusals = 3;  // so that a summary fits on one screen

json figures_json(const ErrorFigures& figures) {
  return {{"rms_m", number_or_null(figures.rms)}, {"max_m", number_or_null(figures.max)}};
}

bool rotary(const LiveAxis& axis) { return axis.model && axis.model->rotary; }

const char* name_of(AxisState state) {
  switch (state) {
    case AxisState::kNoModel:
      return "no model";
    case AxisState::kSettling:
      return "settling";
    case AxisState::kPredicting:
      return "predicting";
    case AxisState::kBadSample:
      return "bad sample";
  }
  return "";
}

std::string microseconds(double seconds) {
  return std::isfinite(seconds) ? text("%.0f us", 1e6 * seconds) : "not known";
}

void add_status(const MachineStatus& status, std::vector<std::string>& lines) {
  std::string counted;
  for (const daemon::StatusCounter& counter : daemon::kStatusCounters) {
    const std::string count = std::to_string(status.*counter.count);
    counted += counted.empty() ? text("%-12s", counter.words) + count
                               : std::string(", ") + counter.words + " " + count;
  }
  lines.push_back(counted);
  lines.push_back("daemon      frame sent to loop p50 " + microseconds(status.wake_p50_s) +
                  ", p99 " + microseconds(status.wake_p99_s) + "; loop's work p50 " +
                  microseconds(status.work_p50_s) + ", p99 " + microseconds(status.work_p99_s) +
                  ", max " + microseconds(status.work_max_s));
}

void add_regimes(const RegimeShares& shares, bool is_rotary, std::vector<std::string>& lines) {
  std::vector<RegimeShare> sorted(shares.begin(), shares.end());
  std::sort(sorted.begin(), sorted.end(),
            [](const auto& a, const auto& b) { return a.share > b.share; });
  if (sorted.front().share <= 0.0) return;
  lines.emplace_back("what the simulation gets wrong, by what the command does:");
  for (const RegimeShare& one : sorted) {
    if (one.samples == 0) continue;
    lines.push_back(text("  %-14s %5.1f %% of the squared error in %5.1f %% of the time ",
                         std::string(servotwin::name_of(one.regime)).c_str(), 100.0 * one.share,
                         100.0 * one.time_share) +
                    figures_text({one.rms, one.max}, is_rotary));
  }
}

void add_axis(const LiveRecord& record, std::size_t index, std::vector<std::string>& lines) {
  const LiveAxis& axis = record.axes()[index];
  lines.emplace_back();
  const int version = axis.shown_version();
  if (version == 0) {
    lines.push_back("axis " + axis.name + ": no model in force");
  } else if (!axis.model) {
    lines.push_back("axis " + axis.name + text(": version %d in force, ", version) +
                    (axis.model_problem.empty() ? "not announced" : axis.model_problem));
  } else {
    lines.push_back("axis " + axis.name + text(": model version %d in force", version));
    for (const std::string& line : parameter_lines(*axis.model)) lines.push_back(line);
    for (const std::string& line : fit_lines(*axis.model, Times::kNone)) lines.push_back(line);
  }
  const PredictionErrors& errors = axis.since_promotion;
  if (errors.residual.count() > 0) {
    const ErrorFigures left = errors.residual.figures(), all = errors.tracking.figures();
    lines.push_back(
        text("live, %llu cycles since the model came into force (%llu more while it settled):",
             static_cast<unsigned long long>(errors.residual.count()),
             static_cast<unsigned long long>(axis.settling)));
    lines.push_back("  with model  " + figures_text(left, rotary(axis)) +
                    "   (measured minus predicted)");
    lines.push_back("  without     " + figures_text(all, rotary(axis)) +
                    "   (the tracking error itself)" +
                    (left.rms > 0.0 ? text(", %.0f times as much", all.rms / left.rms) : ""));
    add_regimes(record.regimes(index), rotary(axis), lines);
  }
  for (const ModelAnnouncement& one : axis.promotions) {
    lines.push_back(text("promoted    version %d", one.version) +
                    (one.parent > 0 ? text(" after %d", one.parent) : "") + ": " + one.reason);
  }
  const std::size_t shown = std::min(axis.refusals.size(), kShownRefusals);
  if (axis.refused > 0) {
    lines.push_back(text("refused     %u candidate%s", axis.refused, axis.refused == 1 ? "" : "s") +
                    (shown < axis.refused ? text("; the last %zu:", shown) : ":"));
  }
  for (std::size_t i = axis.refusals.size() - shown; i < axis.refusals.size(); ++i) {
    lines.push_back("  " + axis.refusals[i]);
  }
  if (!axis.diagnosis.empty()) lines.push_back("diagnosis   " + axis.diagnosis);
  if (!axis.activity.empty()) lines.push_back("now         " + axis.activity);
}

/// The state of the prediction of an axis now.
std::string state_of(const LiveRecord& record, const LiveAxis& axis) {
  if (record.latest() > 0) return name_of(axis.state);
  return record.daemon_there() ? "no frames" : "no daemon";
}

/// The version in force now; while nothing is predicted, the one in the status of the daemon.
int version_of(const LiveRecord& record, const LiveAxis& axis) {
  return record.latest() == 0 && axis.in_force > 0 ? axis.in_force : axis.shown_version();
}

/// Why there are no axes to show.
std::string nothing_yet(const LiveRecord& record) {
  return record.daemon_there() ? "the daemon waits for its machine" : "no daemon";
}

/// The last second of an axis.
std::string table_row(const LiveRecord& record, const LiveAxis& axis) {
  std::string row = text("%-6s %-10s", axis.name.c_str(), micro(rotary(axis)));
  for (const RunningError* errors :
       {&axis.lately.tracking, &axis.lately.predicted, &axis.lately.residual}) {
    const ErrorFigures figures = errors->figures();
    for (const double value : {figures.rms, figures.max}) {
      const std::string shown = std::isfinite(value) ? text("%.4g", 1e6 * value) : "-";
      row += text("%11s", shown.c_str());
    }
  }
  const int version = version_of(record, axis);
  return row + "   " + (version > 0 ? text("v%d, ", version) : "") + state_of(record, axis);
}

json contour_json(const ContourErrors& contour) {
  return {{"predicted", figures_json(contour.predicted.figures())},
          {"measured", figures_json(contour.measured.figures())}};
}

json head_json(const LiveRecord& record, const std::string& machine, double seconds) {
  return {{"schema", kWatchSchema},       {"machine", machine},
          {"seconds", seconds},           {"predictions", record.predictions()},
          {"missed", record.missed()},    {"rate_hz", number_or_null(record.rate_hz())},
          {"silent_s", record.silent_s()}};
}

}  // namespace

std::vector<std::string> summary_lines(const LiveRecord& record, const std::string& where) {
  std::vector<std::string> lines;
  if (record.predictions() == 0) {
    lines.push_back(where + text(": no frames came in %.0f s", record.silent_s()));
  } else {
    lines.push_back(where + text(": %llu predictions at %.0f Hz, %llu not received here",
                                 static_cast<unsigned long long>(record.predictions()),
                                 record.rate_hz(),
                                 static_cast<unsigned long long>(record.missed())));
  }
  if (record.status()) add_status(*record.status(), lines);
  lines.push_back("latency     frame sent to prediction sent p50 " +
                  microseconds(record.latency_s(0.5)) + ", p99 " +
                  microseconds(record.latency_s(0.99)) + ", max " +
                  microseconds(record.latency_s(1.0)));
  if (record.axes().empty()) lines.push_back(nothing_yet(record));
  for (std::size_t i = 0; i < record.axes().size(); ++i) add_axis(record, i, lines);
  if (const ContourErrors& contour = record.contour_since_promotion();
      contour.measured.count() > 0) {
    lines.emplace_back();
    lines.push_back("contour     predicted " + figures_text(contour.predicted.figures(), false));
    lines.push_back("            measured  " + figures_text(contour.measured.figures(), false) +
                    ", since a model came into force");
  }
  if (!record.daemon_there()) {
    lines.emplace_back();
    lines.emplace_back("the daemon has stopped; the counts are those of its last status");
  }
  if (record.status() && !record.status()->last_error.empty()) {
    lines.push_back("last error  " + record.status()->last_error);
  }
  return lines;
}

json summary_json(const LiveRecord& record, const std::string& machine, double seconds) {
  json out = head_json(record, machine, seconds);
  out["status"] = record.status() ? daemon::figures_of(*record.status()) : json();
  out["latency"] = {{"p50_s", number_or_null(record.latency_s(0.5))},
                    {"p99_s", number_or_null(record.latency_s(0.99))},
                    {"max_s", number_or_null(record.latency_s(1.0))}};
  out["axes"] = json::array();
  for (std::size_t i = 0; i < record.axes().size(); ++i) {
    const LiveAxis& axis = record.axes()[i];
    json promotions = json::array(), regimes = json::object();
    for (const ModelAnnouncement& one : axis.promotions) {
      promotions.push_back({{"version", one.version},
                            {"parent", one.parent},
                            {"created", one.created},
                            {"reason", one.reason}});
    }
    for (const RegimeShare& one : record.regimes(i)) {
      regimes[std::string(servotwin::name_of(one.regime))] = {{"rms_m", one.rms},
                                                              {"max_m", one.max},
                                                              {"share", one.share},
                                                              {"time_share", one.time_share},
                                                              {"cycles", one.samples}};
    }
    out["axes"].push_back({{"axis", axis.name},
                           {"version", axis.shown_version()},
                           {"model", axis.model ? to_json(*axis.model) : json()},
                           {"cycles", axis.since_promotion.residual.count()},
                           {"settling_cycles", axis.settling},
                           {"with_model", figures_json(axis.since_promotion.residual.figures())},
                           {"without_model", figures_json(axis.since_promotion.tracking.figures())},
                           {"by_regime", regimes},
                           {"promotions", promotions},
                           {"refused", axis.refused},
                           {"refusals", axis.refusals},
                           {"diagnosis", axis.diagnosis},
                           {"activity", axis.activity}});
  }
  out["contour"] = contour_json(record.contour_since_promotion());
  return out;
}

std::string line_of(const LiveRecord& record, double seconds) {
  std::string line = text("%7.1f s", seconds);
  if (record.axes().empty()) line += "  " + nothing_yet(record);
  for (const LiveAxis& axis : record.axes()) {
    line += "  " + axis.name;
    if (const int version = version_of(record, axis); version > 0) line += text(" v%d", version);
    line += " " + state_of(record, axis);
    const ErrorFigures left = axis.lately.residual.figures(), all = axis.lately.tracking.figures();
    if (std::isfinite(left.rms)) {
      line += text(" %.3f of %.1f %s RMS", 1e6 * left.rms, 1e6 * all.rms, micro(rotary(axis)));
    } else if (std::isfinite(all.rms)) {
      line += text(" %.1f %s RMS tracking error", 1e6 * all.rms, micro(rotary(axis)));
    }
  }
  if (record.status())
    line += text("  lost %llu", static_cast<unsigned long long>(record.status()->lost));
  return line;
}

json line_json(const LiveRecord& record, const std::string& machine, double seconds) {
  json out = head_json(record, machine, seconds);
  out["contour"] = contour_json(record.contour_lately());
  out["axes"] = json::array();
  for (const LiveAxis& axis : record.axes()) {
    out["axes"].push_back({{"axis", axis.name},
                           {"version", version_of(record, axis)},
                           {"state", state_of(record, axis)},
                           {"cycles", axis.lately.residual.count()},
                           {"with_model", figures_json(axis.lately.residual.figures())},
                           {"without_model", figures_json(axis.lately.tracking.figures())}});
  }
  return out;
}

std::vector<std::string> screen_lines(const LiveRecord& record, const std::string& where,
                                      double seconds) {
  std::vector<std::string> lines;
  lines.push_back(where +
                  text(", %.0f s, %llu predictions (%llu not received here)", seconds,
                       static_cast<unsigned long long>(record.predictions()),
                       static_cast<unsigned long long>(record.missed())) +
                  (record.silent()
                       ? text("; %s for %.0f s", record.daemon_there() ? "no frames" : "no daemon",
                              record.silent_s())
                       : "") +
                  "; Ctrl-C ends");
  if (record.status()) add_status(*record.status(), lines);
  lines.push_back("latency     frame sent to prediction sent p50 " +
                  microseconds(record.latency_s(0.5)) + ", p99 " +
                  microseconds(record.latency_s(0.99)));
  lines.emplace_back();
  lines.emplace_back(
      "last second          measured error       predicted error          residual           "
      "model");
  lines.emplace_back(
      "                      RMS        MAX        RMS        MAX        RMS        MAX");
  for (const LiveAxis& axis : record.axes()) lines.push_back(table_row(record, axis));
  if (record.axes().empty()) lines.push_back(nothing_yet(record));
  const auto contour = [](const RunningError& errors) {
    return errors.count() > 0 ? figures_text(errors.figures(), false)
                              : std::string("not available");
  };
  lines.push_back("contour error, predicted: " + contour(record.contour_lately().predicted));
  lines.push_back("               measured:  " + contour(record.contour_lately().measured));
  for (const LiveAxis& axis : record.axes()) {
    if (!axis.activity.empty()) lines.push_back(axis.name + " now        " + axis.activity);
    if (!axis.diagnosis.empty()) lines.push_back(axis.name + " diagnosis  " + axis.diagnosis);
  }
  return lines;
}

}  // namespace servotwin::cli
