// servotwin preview: asks a running daemon for the predicted errors of a path, or for its
// correction.
#include <algorithm>
#include <chrono>
#include <cmath>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <thread>

#include "cli/common/command.h"
#include "cli/common/model_text.h"
#include "cli/common/option_table.h"
#include "cli/common/options.h"
#include "cli/common/output.h"
#include "daemon/between/clock.h"
#include "daemon/correct/program_chunks.h"
#include "daemon/input/recorded_cycles.h"
#include "daemon/store/store.h"
#include "drivers/dds/dds.h"

namespace servotwin::cli {
namespace {

constexpr std::string_view kSeparator = "; ";  // of the parts of the daemon's answer

struct PreviewArguments {
  RecordingOptions path;
  BusOptions bus;
  bool learn = false;
  std::string name;
  std::filesystem::path table;
  double wait_s = 60.0;
};

/// Waits until the daemon of this machine reads programs and its answers will be received; throws
/// if there is none. Topics are shared by all machines of a domain: any reader of programs is not
/// enough. Returns the machine's axes.
std::vector<AxisStatus> find_daemon(const DdsNode& node, const BusOptions& bus,
                                    const DdsWriter<ProgramChunk>& programs,
                                    const DdsReader<CorrectionChunk>& corrections,
                                    double patience_s) {
  std::vector<AxisStatus> axes = axes_of_daemon(node, bus, patience_s);
  const std::int64_t begin = daemon::steady_ns();
  while (!corrections.matched()) {
    if (static_cast<double>(daemon::steady_ns() - begin) * 1e-9 > patience_s)
      throw no_daemon(node, bus);
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
  }
  if (!programs.wait_for_readers(1, patience_s)) throw no_daemon(node, bus);
  return axes;
}

/// The complete answer of the daemon to this revision; throws with its reason if it refuses.
std::vector<CorrectionChunk> answer_to(const ProgramChunk& asked,
                                       DdsReader<CorrectionChunk>& corrections, double patience_s) {
  std::vector<CorrectionChunk> out;
  const auto start = std::chrono::steady_clock::now();
  CorrectionChunk chunk;
  while (out.empty() || out.size() < out.front().chunks) {
    const double left_s =
        patience_s -
        std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    if (!corrections.receive(chunk, std::max(left_s, 0.0)))
      throw std::runtime_error(
          text("no answer after %.3g s; the daemon may need longer (--wait)", patience_s));
    if (chunk.program != asked.program || chunk.revision != asked.revision) continue;
    if (chunk.state == CorrectionState::kRefused)
      throw std::runtime_error("the daemon refused it: " + chunk.reason);
    if (chunk.chunk != out.size()) throw std::runtime_error("a part of the answer was lost");
    out.push_back(chunk);
  }
  return out;
}

void print(const CorrectionChunk& answer, std::FILE* people) {
  const bool learned = answer.state == CorrectionState::kLearned;
  std::string models;
  for (const AxisCorrectionFigures& axis : answer.axes)
    models += (models.empty() ? "" : ", ") + axis.name + " " + std::to_string(axis.model_version);
  say(people, text("correction    program '%s' %s with the models in force (%s), until ",
                   answer.program.c_str(), learned ? "learned" : "previewed", models.c_str()) +
                  daemon::iso_time(answer.valid_until_ns) +
                  (answer.valid_until_ns < daemon::wall_ns() ? ", which has passed" : ""));
  const auto line = [&](const std::string& what, double before_rms, double before_max,
                        double after_rms, double after_max, bool rotary) {
    say(people,
        text("  %-11s predicted ", what.c_str()) + figures_text({before_rms, before_max}, rotary));
    if (learned)
      say(people, "              corrected " + figures_text({after_rms, after_max}, rotary));
  };
  for (const AxisCorrectionFigures& axis : answer.axes)
    line(axis.name, axis.before_rms, axis.before_max, axis.after_rms, axis.after_max, axis.rotary);
  if (std::isfinite(answer.contour_before_rms))
    line("contour", answer.contour_before_rms, answer.contour_before_max, answer.contour_after_rms,
         answer.contour_after_max, false);
  // The notes after the first part, which repeats the figures above.
  for (std::size_t at = answer.reason.find(kSeparator); at != answer.reason.npos;) {
    const std::size_t from = at + kSeparator.size();
    at = answer.reason.find(kSeparator, from);
    say(people, "note: " + answer.reason.substr(from, at == answer.reason.npos ? at : at - from));
  }
}

std::string table_of(const Recording& path, const std::vector<CorrectionChunk>& answer) {
  std::vector<Column> columns{{"time[s]", path.time}};
  for (std::size_t i = 0; i < answer.front().axes.size(); ++i) {
    const AxisCorrectionFigures& axis = answer.front().axes[i];
    Column column{axis.name + ".command" + (axis.rotary ? "[rad]" : "[m]"), {}};
    for (const CorrectionChunk& chunk : answer) {
      const auto rows =
          static_cast<std::ptrdiff_t>(chunk.corrected.size() / answer.front().axes.size());
      const auto from = chunk.corrected.begin() + static_cast<std::ptrdiff_t>(i) * rows;
      column.values.insert(column.values.end(), from, from + rows);
    }
    columns.push_back(std::move(column));
  }
  return csv(columns);
}

void run(const PreviewArguments& arguments) {
  if (!arguments.bus.dds) throw UsageError("--dds is required: the bus of the daemon");
  if (!arguments.name.empty() && !usable_name(arguments.name))
    throw UsageError("--name " + arguments.name + ": " + std::string(kUsableNameRule));
  std::FILE* people = people_beside({arguments.table});
  const Recording path = daemon::recorded_cycles(arguments.path.read(people)).recording;
  const std::vector<ProgramChunk> chunks = daemon::program_chunks(
      path, arguments.name.empty() ? daemon::program_name(arguments.path.file) : arguments.name,
      arguments.learn, static_cast<std::uint64_t>(daemon::wall_ns()));

  const DdsNode node(arguments.bus.place);
  DdsReader<CorrectionChunk> corrections(node);
  DdsWriter<ProgramChunk> programs(node);
  std::vector<AxisDescription> machine;
  for (const AxisStatus& axis : find_daemon(node, arguments.bus, programs, corrections,
                                            std::min(arguments.wait_s, kMaxDiscovery_s)))
    machine.push_back({axis.name, axis.rotary, ""});
  daemon::require_kinds(path, machine, arguments.bus.text());
  for (const ProgramChunk& chunk : chunks) {
    if (!programs.write(chunk)) throw std::runtime_error("DDS refused a part of the program");
  }
  std::vector<CorrectionChunk> answer;
  {
    const Progress progress(arguments.learn ? "learning" : "predicting");
    answer = answer_to(chunks.front(), corrections, arguments.wait_s);
  }
  print(answer.front(), people);
  if (!arguments.table.empty()) write_result(arguments.table, table_of(path, answer));
  say_written(people, {arguments.table});
}

}  // namespace

Command add_preview(CLI::App& app) {
  const auto arguments = std::make_shared<PreviewArguments>();
  OptionTable command(
      app, "preview",
      "Asks a running daemon for the predicted errors of a path, or for its correction.");
  arguments->path.mends = false;  // the daemon gets the commands as the machine will
  arguments->path.declare(command, "PATH",
                          "table of commands, one row per cycle of the machine, or a recording "
                          "whose encoders are ignored");
  arguments->bus.declare(command);
  command.flag(
      "--learn", arguments->learn,
      "let the daemon learn a correction; it keeps it and recognises the program when it runs");
  command
      .option(
          "--name", arguments->name,
          "name of the program (default: that of the file); a program of the same name is replaced")
      .takes("NAME");
  command.option("--out", arguments->table, "write the corrected commands to this file")
      .takes("CORRECTED.csv");
  command.option("--wait", arguments->wait_s, "how long to wait for the answer (default 60)")
      .takes("S")
      .between(0.1, 1e6);
  return {command.app(), [arguments] { run(*arguments); }};
}

}  // namespace servotwin::cli
