// servotwin watch: shows live what the daemon predicts and how large the residual is.
#include <unistd.h>

#include <chrono>
#include <cmath>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>

#include "cli/common/command.h"
#include "cli/common/interrupt.h"
#include "cli/common/option_table.h"
#include "cli/common/options.h"
#include "cli/common/output.h"
#include "cli/common/summary_text.h"
#include "cli/live/can_watch.h"
#include "cli/live/subscriber.h"

namespace servotwin::cli {
namespace {

constexpr double kRefresh_s = 1.0;

struct WatchArguments {
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

/// Shows the last second; on a terminal in place of the second before.
class Display {
 public:
  explicit Display(const WatchArguments& arguments)
      : arguments_(arguments), screen_(arguments.result.empty() && ::isatty(STDOUT_FILENO) == 1) {}

  void show(const LiveRecord& record, double seconds) {
    if (!arguments_.result.empty()) {
      write_line(line_json(record, arguments_.bus.place.machine, seconds).dump());
    } else if (!screen_) {
      say(stdout, line_of(record, seconds));
    } else {
      auto lines = screen_lines(record, arguments_.bus.text(), seconds);
      if (shown_ > 0) lines.front().insert(0, text("\x1b[%zuA\x1b[J", shown_));
      for (const std::string& line : lines) say(stdout, line);
      shown_ = lines.size();
    }
    std::fflush(stdout);
  }

 private:
  const WatchArguments& arguments_;
  bool screen_;
  std::size_t shown_ = 0;
};

void run(const WatchArguments& arguments) {
  if (!arguments.can.empty()) {
    if (arguments.summary || !arguments.result.empty() || arguments.bus.dds)
      throw UsageError(
          "--summary, --json and --dds cannot be used with --can, which needs no daemon");
    watch_can({arguments.can, arguments.can_map, arguments.models, arguments.seconds});
    return;
  }
  if (!arguments.models.empty())
    throw UsageError("--model is for --can; over DDS the daemon publishes its predictions");
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
    throw std::runtime_error("no prediction was received for " + arguments.bus.text() +
                             "; start servotwind with this machine and domain" +
                             other_daemons(subscriber.node()));
  }
  if (!arguments.summary) return;
  for (const std::string& line : summary_lines(record, arguments.bus.text())) say(people, line);
  if (!arguments.result.empty())
    write_json(arguments.result, summary_json(record, arguments.bus.place.machine,
                                              record.predictions() > 0 ? last_s : since(start)));
  say_written(people, {arguments.result});
  if (record.predictions() == 0) {
    throw std::runtime_error("no prediction was received for " + arguments.bus.text() +
                             (subscriber.daemon_there()
                                  ? "; a daemon is running, but receives no frames"
                                  : "; its daemon has stopped"));
  }
}

}  // namespace

Command add_watch(CLI::App& app) {
  const auto arguments = std::make_shared<WatchArguments>();
  OptionTable command(
      app, "watch",
      "Shows the errors of a machine live: over DDS as predicted by its daemon, or on CAN.");
  arguments->bus.declare(command);
  command.option("--can", arguments->can, "listen to CAN interfaces, one per bus of the mapping")
      .takes("IF,..")
      .comma_separated();
  command.option("--can-map", arguments->can_map, "mapping of the bits of frames to signals")
      .takes("F.toml");
  command
      .option("--model", arguments->models,
              "with --can: models of the axes whose errors are predicted")
      .takes("M.json");
  command.flag("--summary", arguments->summary,
               "collect until the machine or the daemon leaves the bus, then print a summary");
  command.option("--seconds", arguments->seconds, "end after this time")
      .takes("S")
      .between(1e-3, 1e9);
  command
      .option_read_by(
          "--json",
          [arguments](const std::string& given) {
            arguments->result = given.empty() ? "-" : given;
          },
          "JSON (servotwin.watch/1): a line per second on standard output, with --summary one "
          "object into OUT; - or no name is standard output")
      .takes("OUT")
      .value_optional();
  return {command.app(), [arguments] { run(*arguments); }};
}

}  // namespace servotwin::cli
