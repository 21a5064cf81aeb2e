// servotwin watch: what the daemon predicts and how right it is, live.
#include <unistd.h>

#include <chrono>
#include <cmath>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>

#include "cli/can_watch.h"
#include "cli/command.h"
#include "cli/interrupt.h"
#include "cli/live_record.h"
#include "cli/number_check.h"
#include "cli/options.h"
#include "cli/output.h"
#include "cli/summary_text.h"
#include "drivers/dds.h"

namespace servotwin::cli {
namespace {

// The loop's sleep: short enough that the readers' 64 messages do not run over at 1 kHz.
constexpr double kWait_s = 0.02;
constexpr double kRefresh_s = 1.0;
// A daemon that has waited speaks through another writer once its machine is there: only who has
// been away for this long has gone.
constexpr double kGone_s = 2.0;

struct Arguments {
  BusOptions bus;
  bool summary = false;
  double seconds = 0.0;
  std::filesystem::path result;
  std::vector<std::string> can;
  std::filesystem::path can_map;
  std::vector<std::filesystem::path> models;
};

double since(std::chrono::steady_clock::time_point start) {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

/// All that is said about one machine, taken in the order that keeps frames ahead of their
/// predictions.
class Subscriber {
 public:
  explicit Subscriber(const DdsPlace& place)
      : node_(place),
        predictions_(node_),
        frames_(node_),
        models_(node_),
        diagnoses_(node_),
        statuses_(node_) {}

  /// Waits a little for a prediction; true if any came.
  bool receive(LiveRecord& record) {
    double wait_s = kWait_s;
    bool any = false;
    while (predictions_.receive(prediction_, wait_s)) {
      take_frames(record);
      record.on_prediction(prediction_, predictions_.written_ns());
      predicts_ = predictions_.writer();
      any = true;
      wait_s = 0.0;
    }
    take_frames(record);
    while (statuses_.receive(status_, 0.0)) {
      record.on_status(status_);
      daemon_ = statuses_.writer();
    }
    while (models_.receive(model_, 0.0)) record.on_model(model_);
    while (diagnoses_.receive(diagnosis_, 0.0)) record.on_diagnosis(diagnosis_);
    return any;
  }
  [[nodiscard]] const DdsNode& node() const { return node_; }
  /// Nothing more will come: the daemon is not there, or the machine that it listened to. A daemon
  /// that replays recordings itself has no machine on the bus, and ends with them.
  [[nodiscard]] bool over() const {
    return !daemon_there() || (machine_ != 0 && !frames_.matched(machine_));
  }
  /// That somebody writes predictions is not enough: topics are shared by all machines of a domain.
  [[nodiscard]] bool daemon_there() const {
    return (daemon_ != 0 && statuses_.matched(daemon_)) ||
           (predicts_ != 0 && predictions_.matched(predicts_));
  }

 private:
  void take_frames(LiveRecord& record) {
    while (frames_.receive(frame_, 0.0)) {
      record.on_frame(frame_, frames_.written_ns());
      machine_ = frames_.writer();
    }
  }

  DdsNode node_;
  DdsReader<MachinePrediction> predictions_;
  DdsReader<MachineFrame> frames_;
  DdsReader<ModelAnnouncement> models_;
  DdsReader<DiagnosisAnnouncement> diagnoses_;
  DdsReader<MachineStatus> statuses_;
  MachinePrediction prediction_;
  MachineFrame frame_;
  ModelAnnouncement model_;
  DiagnosisAnnouncement diagnosis_;
  MachineStatus status_;
  dds_instance_handle_t daemon_ = 0, predicts_ = 0, machine_ = 0;  // who spoke last; 0: nobody yet
};

/// Shows the last second; on a terminal over what was shown before.
class Display {
 public:
  explicit Display(const Arguments& arguments)
      : arguments_(arguments), screen_(arguments.result.empty() && ::isatty(STDOUT_FILENO) == 1) {}

  void show(const LiveRecord& record, double seconds) {
    if (!arguments_.result.empty()) {
      say(stdout, line_json(record, arguments_.bus.place.machine, seconds).dump());
    } else if (!screen_) {
      say(stdout, line_of(record, seconds));
    } else {
      if (shown_ > 0) std::fputs(text("\x1b[%zuA\x1b[J", shown_).c_str(), stdout);
      const auto lines = screen_lines(record, arguments_.bus.text(), seconds);
      for (const std::string& line : lines) say(stdout, line);
      shown_ = lines.size();
    }
    std::fflush(stdout);
  }

 private:
  const Arguments& arguments_;
  bool screen_;
  std::size_t shown_ = 0;
};

void run(const Arguments& arguments) {
  if (!arguments.can.empty()) {
    if (arguments.summary || !arguments.result.empty() || arguments.bus.dds)
      throw UsageError("--summary, --json and --dds are not for --can, where no daemon speaks");
    watch_can({arguments.can, arguments.can_map, arguments.models, arguments.seconds});
    return;
  }
  if (!arguments.models.empty())
    throw UsageError("--model is for --can; over DDS the daemon says what it predicts");
  if (!arguments.can_map.empty()) throw UsageError("--can-map is for --can");
  if (!arguments.summary && !arguments.result.empty() && !is_stdout(arguments.result)) {
    throw UsageError(
        "--json without --summary writes a line per second to standard output; give no file");
  }
  std::FILE* people = people_beside({arguments.result});
  Subscriber subscriber(arguments.bus.place);
  LiveRecord record;
  Display display(arguments);
  const Interrupt interrupt;
  const auto start = std::chrono::steady_clock::now();
  double last_s = 0.0, shown_s = 0.0, over_s = 0.0;
  {
    std::optional<Progress> progress;
    if (arguments.summary) progress.emplace("watching " + arguments.bus.text());
    while (!interrupt.came()) {
      if (subscriber.receive(record)) last_s = since(start);
      const double now_s = since(start);
      record.silent_for(now_s - last_s, subscriber.daemon_there());
      if (arguments.seconds > 0.0 && now_s >= arguments.seconds) break;
      const bool spoken = record.predictions() > 0 || record.status();
      if (!(spoken && record.silent() && subscriber.over())) over_s = now_s;
      if (arguments.summary && now_s - over_s > kGone_s) break;
      if (!arguments.summary && now_s - shown_s >= kRefresh_s) {
        display.show(record, now_s);
        record.clear_lately();
        shown_s += kRefresh_s;
      }
    }
  }
  if (record.predictions() == 0 && !record.status()) {
    throw std::runtime_error("no prediction came for " + arguments.bus.text() +
                             "; start servotwind with this machine and domain" +
                             other_daemons(subscriber.node()));
  }
  if (!arguments.summary) return;
  for (const std::string& line : summary_lines(record, arguments.bus.text())) say(people, line);
  if (!arguments.result.empty())
    write_json(arguments.result, summary_json(record, arguments.bus.place.machine,
                                              record.predictions() > 0 ? last_s : since(start)));
  if (record.predictions() == 0) {
    throw std::runtime_error("no prediction came for " + arguments.bus.text() +
                             (subscriber.daemon_there()
                                  ? "; a daemon is there, but no frames reach it"
                                  : "; its daemon has gone"));
  }
}

}  // namespace

Command add_watch(CLI::App& app) {
  const auto arguments = std::make_shared<Arguments>();
  CLI::App& command = *app.add_subcommand(
      "watch", "Live predicted error of a machine over DDS, or what it says on CAN.");
  arguments->bus.declare(command);
  command
      .add_option("--can", arguments->can, "listen to CAN interfaces, one per bus of the mapping")
      ->type_name("IF,..")
      ->delimiter(',');
  command
      .add_option("--can-map", arguments->can_map, "which bits of which frames are which signal")
      ->type_name("F.toml");
  command
      .add_option("--model", arguments->models,
                  "with --can: models of axes whose errors are to be predicted")
      ->type_name("M.json");
  command.add_flag("--summary", arguments->summary,
                   "collect until machine or daemon leave the bus, then print one screen");
  command.add_option("--seconds", arguments->seconds, "end after this time")
      ->type_name("S")
      ->check(between(1e-3, 1e9));
  command
      .add_option_function<std::string>(
          "--json",
          [arguments](const std::string& given) {
            arguments->result = given.empty() ? "-" : given;
          },
          "JSON (servotwin.watch/1): a line per second on standard output, with --summary one "
          "object "
          "into OUT; - or nothing is standard output")
      ->type_name("OUT")
      ->expected(0, 1);
  return {&command, [arguments] { run(*arguments); }};
}

}  // namespace servotwin::cli
