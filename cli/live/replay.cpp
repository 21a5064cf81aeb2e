// servotwin replay: sends a recording on a live bus, in place of the machine that made it.
#include "drivers/recordings/replay.h"

#include <algorithm>
#include <chrono>
#include <memory>
#include <string>

#include "cli/common/command.h"
#include "cli/common/interrupt.h"
#include "cli/common/option_table.h"
#include "cli/common/options.h"
#include "cli/common/output.h"
#include "cli/live/can_replay.h"
#include "daemon/input/frame_source.h"
#include "daemon/input/recorded_cycles.h"
#include "drivers/common/text.h"
#include "drivers/dds/dds.h"

namespace servotwin::cli {
namespace {

constexpr double kLongestWait_s = 0.2;  // longest delay of an interrupt

struct ReplayArguments {
  RecordingOptions recording;
  BusOptions bus;
  std::vector<std::string> can;
  std::string udp;
  bool targets = false;
  double speed = 1.0;
  int look_ahead = 0;
  double wait_s = 10.0;  // a daemon that has just been started needs about 1 s
};

void run(const ReplayArguments& arguments) {
  const bool can = !arguments.can.empty() || !arguments.udp.empty();
  if (arguments.bus.dds == can) throw UsageError("choose one bus: --dds, --can or --udp");
  if (can) {
    replay_onto_can({arguments.recording.file, arguments.recording.read_options, arguments.can,
                     arguments.udp, arguments.targets, arguments.speed});
    return;
  }
  if (arguments.targets) throw UsageError("--targets is for --can and --udp");

  daemon::RecordedCycles cycles = daemon::recorded_cycles(arguments.recording.read(stdout));
  for (const std::string& note : cycles.notes) say(stdout, "note: " + note);
  const std::string source = cycles.recording.source;
  std::vector<Replay> replays;
  replays.emplace_back(std::move(cycles.recording), cycles.cycle_s, arguments.look_ahead);
  const Replay& replay = replays.front();
  std::string axes;
  for (const AxisDescription& axis : replay.machine().axes)
    axes += (axes.empty() ? "" : ", ") + axis.name;
  say(stdout, "read " + source + ": " + counted(replay.rows(), "row") +
                  text(" at %.6g Hz, %s ", 1.0 / replay.machine().cycle_s,
                       replay.machine().axes.size() == 1 ? "axis" : "axes") +
                  axes);

  const DdsNode node(arguments.bus.place);
  // In this order, so that a reader that confirms the description has also found the writer of the
  // frames. A frame sent before that, or before the writer has found a reader, is lost without
  // being counted.
  DdsWriter<MachineFrame> frames(node);
  DdsWriter<MachineDescription> descriptions(node);
  if (!descriptions.write(replay.machine()))
    throw std::runtime_error("DDS refused the description of the machine");
  const DaemonThere there = wait_for_daemon(node, arguments.wait_s);
  if (there == DaemonThere::kKnowsNoAxes) {
    throw std::runtime_error(text("the daemon of %s has not accepted the machine after %.3g s",
                                  arguments.bus.text().c_str(), arguments.wait_s));
  }
  if (there == DaemonThere::kNobody) {
    // Readers of frames receive those of every machine of the domain: if there are daemons of other
    // machines, a reader proves nothing.
    const std::string others = other_daemons(node);
    if (!others.empty() || !frames.wait_for_readers(1, 0.0)) {
      throw std::runtime_error(text("no daemon listens to %s after %.3g s",
                                    arguments.bus.text().c_str(), arguments.wait_s) +
                               others + "; start servotwind with this machine and domain first" +
                               (others.empty() ? "" : ", or name one of these machines"));
    }
    say(stdout,
        "note: no daemon serves " + arguments.bus.text() + "; other subscribers read its frames");
  } else if (!descriptions.wait_for_readers(1, arguments.wait_s) ||
             !descriptions.wait_for_delivery(arguments.wait_s) ||
             !frames.wait_for_readers(1, arguments.wait_s)) {
    throw std::runtime_error("the daemon did not confirm the description of the machine");
  }

  DdsReader<MachineStatus> statuses(node);
  MachineStatus status;
  const bool followed = there == DaemonThere::kReady && statuses.receive(status, arguments.wait_s);

  const std::size_t rows = replay.rows();
  const double cycle_s = replay.machine().cycle_s;
  daemon::ReplaySource machine(std::move(replays), arguments.speed);
  const Interrupt interrupt;
  const auto start = std::chrono::steady_clock::now();
  std::size_t sent = 0, late = 0;
  {
    const Progress progress(text("replaying %s, %.0f s", source.c_str(),
                                 static_cast<double>(rows) * cycle_s / arguments.speed));
    MachineFrame frame;
    daemon::Received received = daemon::Received::kNothing;
    while (!interrupt.came() &&
           (received = machine.receive(frame, kLongestWait_s)) != daemon::Received::kEnd) {
      if (received == daemon::Received::kNothing) continue;
      if (frames.write(frame)) ++sent;
      if (static_cast<double>(machine.age_ns()) * 1e-9 > cycle_s / arguments.speed) ++late;
    }
  }
  const double taken_s =
      std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  const bool delivered = frames.wait_for_delivery(arguments.wait_s);
  say(stdout, text("sent %zu of %zu frames in %.2f s, %zu of them more than a cycle late", sent,
                   rows, taken_s, late));
  if (frames.failed() > 0) {
    throw std::runtime_error("DDS refused " +
                             counted(static_cast<std::size_t>(frames.failed()), "frame"));
  }
  if (!delivered) throw std::runtime_error("the readers did not confirm the last frames");
  while (statuses.receive(status, 0.0)) {
  }
  if (followed && !statuses.matched(statuses.writer())) {
    throw std::runtime_error("the daemon of " + arguments.bus.text() +
                             " stopped before the end and has not received all frames");
  }
}

}  // namespace

Command add_replay(CLI::App& app) {
  const auto arguments = std::make_shared<ReplayArguments>();
  OptionTable command(app, "replay", "Plays a recording on a live bus, in place of a machine.");
  arguments->recording.mends = false;  // the bus gets what the machine sent
  arguments->recording.declare(command, "LOG", kRecordingHelp);
  arguments->bus.declare(command);
  command
      .option("--can", arguments->can,
              "send to CAN interfaces, one per bus of the log or of the mapping")
      .takes("IF,..")
      .comma_separated();
  command.option("--udp", arguments->udp, "send to CAN over UDP (cannelloni's format)")
      .takes("HOST:PORT");
  command.flag(
      "--targets", arguments->targets,
      "on CAN, act as the controller: send the commands as target positions of the mapping");
  command
      .option("--speed", arguments->speed,
              "speed of the replay, in multiples of the recorded one (default 1)")
      .takes("F")
      .between(1e-3, 1e3);
  command
      .option("--look-ahead", arguments->look_ahead,
              "number of cycles by which commands are sent ahead of time (default 0)")
      .takes("N")
      .between(0, kMaxLookAhead);
  command
      .option("--wait", arguments->wait_s,
              "how long to wait for a daemon, and at the end for its confirmation (default 10)")
      .takes("S")
      .between(0.0, 1e9);
  return {command.app(), [arguments] { run(*arguments); }};
}

}  // namespace servotwin::cli
