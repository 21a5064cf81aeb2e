#include "cli/live/can_watch.h"

#include <cmath>
#include <memory>

#include "cli/common/command.h"
#include "cli/common/interrupt.h"
#include "cli/common/live_record.h"
#include "cli/common/options.h"
#include "cli/common/output.h"
#include "daemon/between/clock.h"
#include "daemon/identify/held_out.h"
#include "daemon/input/can_source.h"
#include "daemon/loop/real_time_loop.h"
#include "diagnosis/statistics/text.h"
#include "drivers/can/can_map.h"
#include "drivers/can/socketcan.h"
#include "drivers/common/text.h"
#include "twin/shown_units.h"

namespace servotwin::cli {
namespace {

constexpr std::int64_t kRefresh_ns = 1'000'000'000;

/// The loop of the daemon, with models from files.
class Predictor {
 public:
  Predictor(const CanMap& map, const std::vector<std::filesystem::path>& files)
      : models_(map.machine.axes.size()),
        loop_(map.machine.cycle_s, models_, predictions_, rows_, nobody_) {
    const auto records = models_of(map.machine, files, stdout);
    for (std::size_t i = 0; i < records.size(); ++i) {
      if (!records[i]) continue;
      ModelRecord record = *records[i];
      record.version = std::max(record.version, 1);  // 0 is no model to the loop
      models_[i].publish(daemon::twin_in_force(record, map.machine, i));
    }
  }
  /// Valid until the next cycle.
  const MachinePrediction& cycle(const MachineFrame& frame) {
    loop_.on_frame(frame, {});
    daemon::CycleRow row;
    rows_.pop(row);
    if (!predictions_.pop(prediction_)) prediction_ = {};
    return prediction_;
  }

 private:
  std::vector<daemon::LatestValue<daemon::TwinInForce>> models_;
  daemon::Ring<MachinePrediction> predictions_{2};
  daemon::Ring<daemon::CycleRow> rows_{2};
  daemon::WakeUp nobody_;
  daemon::RealTimeLoop loop_;
  MachinePrediction prediction_;
};

struct Second {
  MachineFrame last;
  std::vector<double> actual;  // the last one received, per axis
  std::vector<RunningError> tracking, residual;
  std::vector<AxisState> state;
  std::uint64_t cycles = 0;
};

/// ", not predicted 0.021 um RMS 0.053 MAX"; empty without a model.
std::string left_by_the_model(AxisState state, const ErrorFigures& residual, const char* unit) {
  if (state == AxisState::kNoModel) return "";
  if (!std::isfinite(residual.rms)) return ", settling";
  return text(", not predicted %.3f %s RMS %.3f MAX", residual.rms / kMicro, unit,
              residual.max / kMicro);
}

std::string line_of(const Second& second, const CanMap& map, const CanCounts& now,
                    const CanCounts& before, double seconds) {
  std::string line =
      text("%.0f s: ", seconds) + counted(second.cycles, "cycle") +
      text(", %zu incomplete", static_cast<std::size_t>(now.incomplete - before.incomplete));
  for (std::size_t i = 0; i < map.machine.axes.size() && second.cycles > 0; ++i) {
    const AxisDescription& axis = map.machine.axes[i];
    const ErrorFigures figures = second.tracking[i].figures();
    const double shown = axis.rotary ? 1.0 : 1e-3;
    const char* unit = micro(axis.rotary);
    line += text("; %s %.4f %s, error %.3f %s RMS %.3f MAX", axis.name.c_str(),
                 second.actual[i] / shown, axis.rotary ? "rad" : "mm", figures.rms / kMicro, unit,
                 figures.max / kMicro);
    line += left_by_the_model(second.state[i], second.residual[i].figures(), unit);
  }
  return line;
}

}  // namespace

void watch_can(const CanWatchOptions& options) {
  if (options.map.empty())
    throw UsageError("--can-map F.toml is required: it maps the bits of frames to signals");
  CanMap map = load_can_map(options.map);
  if (map.buses.size() != options.interfaces.size()) {
    throw UsageError(text("the mapping has %zu buses (%s), and --can names %zu", map.buses.size(),
                          listed(map.buses).c_str(), options.interfaces.size()));
  }
  map.buses = options.interfaces;
  const auto predictor = std::make_unique<Predictor>(map, options.models);
  std::vector<std::unique_ptr<CanBus>> buses;
  for (const std::string& interface : options.interfaces)
    buses.push_back(std::make_unique<SocketCan>(interface));
  daemon::CanSource source(std::move(map), std::move(buses), Pacing::kByStamp);

  const Interrupt interrupt;
  const std::int64_t begin = daemon::steady_ns();
  std::int64_t next = begin + kRefresh_ns;
  Second second;
  second.tracking.resize(source.map().machine.axes.size());
  second.residual.resize(second.tracking.size());
  second.state.resize(second.tracking.size(), AxisState::kNoModel);
  second.actual.resize(second.tracking.size(), kAbsent);
  CanCounts before = source.counts();
  std::uint64_t total = 0;
  while (!interrupt.came()) {
    if (source.receive(second.last, 0.05) == daemon::Received::kFrame) {
      ++second.cycles;
      ++total;
      const MachinePrediction& prediction = predictor->cycle(second.last);
      for (std::size_t i = 0; i < second.tracking.size(); ++i) {
        const AxisSample& axis = second.last.axes[i];
        second.state[i] = prediction.axes[i].state;
        if (second.state[i] == AxisState::kPredicting)
          second.residual[i].add(prediction.axes[i].residual);
        second.tracking[i].add(axis.command - axis.actual);
        if (std::isfinite(axis.actual)) second.actual[i] = axis.actual;
      }
    }
    const std::int64_t now = daemon::steady_ns();
    const double seconds = static_cast<double>(now - begin) * 1e-9;
    const bool over = options.seconds > 0.0 && seconds >= options.seconds;
    if (now >= next || over) {
      next += kRefresh_ns;
      const CanCounts counts = source.counts();
      for (const SourceNews& line : source.news(now)) say(stdout, "note: " + line.text);
      say(stdout, line_of(second, source.map(), counts, before, seconds));
      std::fflush(stdout);
      before = counts;
      second.cycles = 0;
      for (auto* errors : {&second.tracking, &second.residual}) {
        for (RunningError& error : *errors) error = {};
      }
    }
    if (over) break;
  }
  if (total == 0) {
    throw std::runtime_error("no cycle was received on " + listed(options.interfaces) +
                             "; according to the mapping, a cycle begins with " +
                             can_id_text(source.map().start.id, source.map().start.extended));
  }
}

}  // namespace servotwin::cli
